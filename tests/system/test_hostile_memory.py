"""Nobody without a lease takes the memory of a daemon that moves its arm; for longer: `make soak`."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest

from tests.soak.hostile.process_memory import flood, grown, too_much
from tests.soak.hostile.trial import trial


@pytest.mark.parametrize("kind", ["deploy", "stuff", "starve"])
def test_no_process_grows_by_much_and_none_is_kept_from_its_work(kind: str, tmp_path: Path) -> None:
    with trial(tmp_path) as t:
        growth = grown(t, partial(flood, t, kind, 2, 2.0))
        assert not too_much(growth), growth
        assert t.result(kind).moves > 0, "and the laws of the pulses hold"
