"""The independent world of motion: joints push each other by their acceleration and centrifugal force alone."""

from __future__ import annotations

import numpy as np
import pytest

from validation.lerobot_dataset import FPS
from validation.motion.world import JOINTS, SO101, STEP_S, TrueJoints, followed

pytestmark = pytest.mark.long


def test_a_joint_that_turns_evenly_does_not_push_a_soft_one_by_its_own_damping() -> None:
    """K (u − q) + gravity and centrifugal torque = 0 at the soft joint, once it has settled beside an even turn."""
    speed, soft, share = 0.8, 2, 0.5
    arm = TrueJoints()
    arm.link_share[soft] = share
    t = np.arange(int(2.5 * FPS)) / FPS
    told = np.zeros((1, len(t), JOINTS))
    told[0, :, 1] = speed * (t - 1.0)
    ticks = round(1.0 / FPS / STEP_S)
    put_out = np.repeat(told, ticks, axis=1)
    q = followed(SO101, [arm], put_out, np.zeros((1, 1)), ticks, 1.0 / FPS / ticks)[:, -1]
    v = np.zeros((1, JOINTS))
    v[0, 1] = speed
    torque = SO101.loads(q, v)[0][0, soft]
    inertia = SO101.loads(np.zeros((1, JOINTS)), np.zeros((1, JOINTS)))[1][0, soft, soft] / share
    stiffness = inertia * (2.0 * np.pi * arm.frequency_hz[soft]) ** 2
    assert abs(torque) / stiffness > 0.01
    assert q[0, soft] == pytest.approx(torque / stiffness, abs=4e-3), "it lags the torque, which changes on the way"


def test_a_turning_arm_keeps_its_energy_where_no_torque_acts() -> None:
    """d/dt (½ q̇ᵀ M q̇) = q̇ᵀ (M q̈ + ½ Ṁ q̇) vanishes for the accelerations that centrifugal forces alone give."""
    rng, still, short = np.random.default_rng(0), np.zeros((1, JOINTS)), 1e-5
    q, v = rng.uniform(-0.8, 0.8, (1, JOINTS)), rng.uniform(-2.0, 2.0, (1, JOINTS))
    turning = (SO101.loads(q, v)[0] - SO101.loads(q, still)[0])[0]
    change = (SO101.loads(q + short * v, still)[1] - SO101.loads(q - short * v, still)[1])[0] / (2.0 * short)
    power = 0.5 * v[0] @ change @ v[0]
    assert abs(power) > 1e-3
    assert v[0] @ turning == pytest.approx(-power, rel=1e-5)
