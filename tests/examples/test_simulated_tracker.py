"""The simulated tracker sees an arm that warms up as the daemon takes it."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from examples.demo import simulated_tracker
from examples.demo.simulated_tracker import BoardState, frames, true_tip
from lrm_math.arrays import Array
from validation.as_deployed.passing_world import WARMS_S, PassingWorld
from validation.synthetic import ArmDescription, GroundTruth

SPEED, ANGLE_DEG, LOOKS = 6.0, 20.0, 60


@pytest.mark.parametrize("powered_at", [3.5, 20.5])
def test_the_arm_warms_up_from_its_first_pulses(powered_at: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """However long the board ran before, and however fast its clock runs. One look takes a second, a pose two."""
    looks, warmed = iter(range(LOOKS)), dict[float, float]()
    now = 0.0

    def query_board(_: Path, question: str) -> dict[str, object]:
        nonlocal now
        if question == "joints":
            now = float(next(looks))
            return {f"joint{i}": {"angle_deg": ANGLE_DEG * (-1.0) ** (now // 2.0)} for i in range(1, 7)}
        pulses = [1500.0 if now > powered_at else None] * 16
        return {"payload_g": 0.0, "t_s": SPEED * now, "session": 1, "pulse_us": pulses}

    def tip(_: ArmDescription, __: GroundTruth, ___: BoardState, warming_s: float) -> Array:
        warmed[now] = warming_s
        return np.zeros(3)

    monkeypatch.setattr(simulated_tracker, "query_board", query_board)
    monkeypatch.setattr(simulated_tracker, "true_tip", tip)
    monkeypatch.setattr(simulated_tracker, "time", SimpleNamespace(monotonic=lambda: now))
    seen: Iterator[object] = frames(Path("board"), *PassingWorld(3).passing, 3)
    assert len([*islice(seen, LOOKS)]) == LOOKS
    assert len(warmed) > LOOKS // 3
    for at, since in warmed.items():
        assert since == pytest.approx(max(0.0, at - powered_at), abs=1.0)


def test_the_tip_of_an_arm_that_warms_up_follows_that_time() -> None:
    """By its law: the way of the tip is 1 − exp(−t/T) of the whole, as long as that is short."""
    rest = BoardState(np.radians(15.0 * np.arange(1, 7)), 0.0, 1e4, 1)
    cold, half, warm = (true_tip(*PassingWorld(3).passing, rest, t) for t in (0.0, np.log(2.0) * WARMS_S, 1e5))
    assert np.linalg.norm(warm - cold) > 1e-3
    np.testing.assert_allclose(half, (cold + warm) / 2.0, atol=2e-5)
