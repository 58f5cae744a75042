"""The attacks of the hostile suite, a few seconds each; for longer: `make soak`."""

from __future__ import annotations

import math

import pytest

from tests.soak.hostile.attacks import ALL, carry_out

SHORT = (
    "link: garbled",
    "link: forged",
    "link: yanked",
    "link: hidden board",
    "link: old handshakes",
    "flood: malformed",
    "kills and stops",
)


@pytest.mark.parametrize("name", SHORT)
def test_under_attack_no_pulse_jumps_and_none_is_switched_on_unasked(name: str) -> None:
    assert name in ALL
    result = carry_out(name, 2.0)
    assert result.moves > 0
    assert all(map(math.isfinite, result.estops_ms)), "every emergency stop was carried out"
