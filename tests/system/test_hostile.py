"""The attacks of the hostile suite, a few seconds each, and what strangers leave in memory; for longer: `make soak`."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path

import pytest

from tests.soak.hostile.attacks import ALL, carry_out
from tests.soak.hostile.memory import flood, grown, left_by_clients, too_much
from tests.soak.hostile.trial import trial

SHORT = (
    "link: garbled", "link: forged", "link: yanked", "link: hidden board", "link: old handshakes", "flood: malformed",
    "kills and stops",
)  # fmt: skip


@pytest.mark.parametrize("name", SHORT)
def test_under_attack_no_pulse_jumps_and_none_is_switched_on_unasked(name: str) -> None:
    assert name in ALL
    result = carry_out(name, 2.0)
    assert result.moves > 0
    assert all(map(math.isfinite, result.estops_ms)), "every emergency stop was carried out"


@pytest.mark.parametrize("kind", ["deploy", "stuff", "starve"])
def test_no_process_grows_by_much_and_none_is_kept_from_its_work(kind: str, tmp_path: Path) -> None:
    with trial(tmp_path) as t:
        growth = grown(t, partial(flood, t, (kind, kind), 2.0))
        assert not too_much(growth), growth
        assert t.result(kind).moves > 0, "and the laws of the pulses hold"


def test_clients_that_come_and_go_leave_no_memory_behind() -> None:
    """With zenoh's shared memory one alone leaves about 20 MB."""
    assert left_by_clients(100) < 30.0
