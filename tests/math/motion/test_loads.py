"""Loads of a moving arm: its acceleration by differences, and the push of a joint on another by energy."""

from __future__ import annotations

import numpy as np
import pytest

from lrm_math.arm.arm_file import load_arm
from lrm_math.motion.loads import acceleration, joint_loads

FPS = 30.0


@pytest.mark.parametrize(("hz", "short"), [(1.0, 1e-3), (2.0, 2e-3), (4.0, 0.01)])
def test_the_acceleration_of_a_swing_is_that_of_its_sine_at_thirty_frames_a_second(hz: float, short: float) -> None:
    t, omega = np.arange(60) / FPS, 2.0 * np.pi * hz
    swing = np.sin(omega * t + 0.3)[None, :, None]
    found = acceleration(swing, 1.0 / FPS)
    np.testing.assert_allclose(found[:, 2:-2], -(omega**2) * swing[:, 2:-2], atol=short * omega**2)


def test_a_body_that_moves_evenly_has_no_acceleration_to_its_ends() -> None:
    evenly = 0.3 * np.arange(9.0)[None, :, None] + 2.0
    np.testing.assert_allclose(acceleration(evenly, 0.1), 0.0, atol=1e-10)


def test_two_joints_push_each_other_by_one_inertia() -> None:
    """M is symmetric: what joint 3 pushes joint 2 with, joint 2 pushes joint 3 with, turned as much."""
    arm, omega = load_arm("so101"), 2.0 * np.pi
    t = np.arange(-15, 16) / FPS
    pushes = []
    for mover, pushed in ((1, 2), (2, 1)):
        q = np.zeros((1, len(t), arm.dof))
        q[0, :, mover] = 1e-3 * np.sin(omega * t + 0.5 * np.pi)  # its speed is zero in the middle
        pushes.append(joint_loads(arm, q, 1.0 / FPS).reaction[0, 15, pushed] / (1e-3 * omega**2))
    assert abs(pushes[0]) > 1e-4
    assert pushes[0] == pytest.approx(pushes[1], rel=0.01)
