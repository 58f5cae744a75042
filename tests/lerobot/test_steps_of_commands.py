"""Goals in the servos' counts, as LeRobot's calibrated robot sends them: small steps of a wish are small steps there.

Past the axis of the first joint turning it is cheap in millimetres of the tip, however far: 5 mrad of twist are enough.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from examples.so101.feetech_servo import FeetechServo
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import effects_at
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from tests.doors.lerobot_classes import calibrated_robot_class, robot_config
from tests.doors.simulated_follower import SimulatedFollower

ARM = load_arm("so101")
NAMES = tuple(str(joint.name) for joint in ARM.joints)
STEP_DEG, LARGEST_DEG = 0.3, 1.2
"""Of the wish; of a goal: three times as much, 0.2 deg beside it, and a count."""
MODEL = """\
schema = "lrm/model/1"
arm = "so101"
effects = ["offsets"]
[parameters]
"offsets.joint2.alpha_rad" = 0.005
"offsets.joint3.alpha_rad" = 0.005
"""


def near_the_axis(q: np.ndarray) -> np.ndarray:
    """Angles (n,), rad, with the second joint where the tool is nearest to the axis of the first."""
    candidates = np.tile(q, (200, 1))
    candidates[:, 1] = np.linspace(ARM.joints[1].lower, ARM.joints[1].upper, 200)
    none = np.zeros((200, len(q)))
    tips = solve_equilibrium(model_of(ARM, effects_at(ARM, "offsets")), Poses(candidates, none[:, 0], none)).tcp
    return np.asarray(candidates[int(np.argmin(np.hypot(*tips[:, :2].T)))])


@pytest.mark.parametrize("seed", range(6))
def test_small_steps_of_a_wish_past_the_first_axis_are_small_steps_of_the_goals(tmp_path: Path, seed: int) -> None:
    (model := tmp_path / "model.toml").write_text(MODEL)
    servos = [FeetechServo(number) for number in range(1, 6)]
    robot = calibrated_robot_class()(robot_config(model), SimulatedFollower(NAMES, servos))
    robot.connect()
    low, high = np.array([(joint.lower, joint.upper) for joint in ARM.joints]).T
    middle = np.degrees(near_the_axis(0.8 * np.random.default_rng(seed).uniform(low, high)))
    goals = []
    for k in range(-40, 41):
        wish = middle + k * STEP_DEG * np.array([0.0, 1.0, 0.0, 0.0, 0.0])
        robot.send_action({f"{name}.pos": float(q) for name, q in zip(NAMES, wish, strict=True)})
        goals.append([np.degrees(servo.target) for servo in servos])
    assert np.abs(np.diff(goals, axis=0)).max() <= LARGEST_DEG
