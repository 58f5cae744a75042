"""The simulated tracker sees an arm that warms up as the daemon takes it."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from examples.demo import simulated_tracker
from examples.demo.simulated_tracker import BASE_IN_ROOM, FRAME_SD_M, REST_SD_M, TOOL, frames
from validation.as_deployed.board.passing_world import WARMS_S, PassingWorld
from validation.synthetic import Schedule, true_state

SPEED, FRAME_S, TURN_DEG = 6.0, 1.0, 5.0
NOISE_M = 5.0 * (REST_SD_M + FRAME_SD_M)


@pytest.mark.parametrize("powered_s", [3.0, 50.0])
def test_the_arm_warms_up_from_its_first_pulses_by_the_computers_time(
    powered_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However long the board ran before, and however fast its clock runs. It stands at each pose for two frames."""
    now = [1000.0]

    def query_board(_: Path, question: str) -> dict[str, object]:
        passed = now[0] - 1000.0
        if question == "status":
            now[0] += FRAME_S
            pulses = [1500.0 if passed >= powered_s else None] * 6
            return {"payload_g": 0.0, "t_s": SPEED * passed, "session": 1, "pulse_us": pulses}
        turned = max(0.0, passed - powered_s) // (2.0 * FRAME_S)
        return {f"joint{i}": {"angle_deg": TURN_DEG * (-1.0) ** turned} for i in range(1, 7)}

    monkeypatch.setattr(simulated_tracker, "query_board", query_board)
    monkeypatch.setattr(simulated_tracker, "time", SimpleNamespace(monotonic=lambda: now[0]))
    arm, truth = PassingWorld(3).passing
    (warming,) = truth.effects
    seen = 0
    for frame in frames(Path("board"), arm, truth, 3):
        since, target = now[0] - 1000.0 - powered_s, frame.targets.get(TOOL)
        if since > 3.0 * WARMS_S:
            break
        if target is not None and since > 2.0 * FRAME_S:
            q = np.radians(np.full((1, 6), TURN_DEG * (-1.0) ** ((since - FRAME_S) // (2.0 * FRAME_S))))
            at = Schedule(np.array([since]), np.ones(1), q[0])
            tip = BASE_IN_ROOM.rotation.T @ (target.position - BASE_IN_ROOM.position)
            np.testing.assert_allclose(tip, true_state(arm, truth, q, np.zeros(1), at).tcp_m[0], atol=NOISE_M)
            seen += 1
    assert seen > WARMS_S
    late, cold = (Schedule(np.array([t]), np.ones(1), q[0]) for t in (1e4, 0.0))
    moved = true_state(arm, truth, q, np.zeros(1), late).tcp_m - true_state(arm, truth, q, np.zeros(1), cold).tcp_m
    assert np.linalg.norm(moved) > 2.0 * NOISE_M, warming
