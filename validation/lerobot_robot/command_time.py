"""Processor time of one correction on an SO-101 with five effects, along a minute of teleoperation at 60 Hz."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from lerobot_robot_lrm.correction import Correction
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.kinematics.motion import Motion
from lrm_math.model.model import model_of

FIVE = {
    "offsets.joint2.theta_rad": 0.03,
    "compliance.joint2.k_rad_per_Nm": 0.05,
    "servo_gain.joint3.g_plus_rad_per_rad": 0.03,
    "backlash.joint4.b_rad": 0.02,
    "hysteresis.joint2.h_rad": -0.03,
}
FRICTION = {**FIVE, "friction_curve.joint3.c_8deg_rad": -0.02}
"""With one effect that the kernel has no formula for."""
RATE_HZ, SECONDS = 60, 60
SWINGS_HZ = (0.31, 0.23, 0.41, 0.53, 0.17)
SWING = 0.7
"""rad, of every joint."""


@dataclass(frozen=True)
class CommandTimes:
    """Median and worst processor time of one call (ms)."""

    median: float
    worst: float


def correction_times(values: dict[str, float]) -> tuple[CommandTimes, CommandTimes]:
    """Times of a command, and of the true angles of an observation, of a model with some parameters."""
    arm = load_arm("so101")
    names = dict.fromkeys(f"{key.split('.')[0]}@{key.split('.')[1]}" for key in values)
    made = Correction.of(model_of(arm, [effect for name in names for effect in effects_at(arm, name)], values))
    t = np.arange(RATE_HZ * SECONDS) / RATE_HZ
    wishes = SWING * np.sin(2.0 * np.pi * np.outer(t, SWINGS_HZ))
    _ = made.arm, made.drawn
    motion, commands, observations = Motion.at(wishes[0]), list[int](), list[int]()
    for wish in wishes:
        begun = time.thread_time_ns()
        motion = motion.to(made.command(wish, motion))
        commanded = time.thread_time_ns()
        made.true_angles(motion.q, motion)
        commands.append(commanded - begun)
        observations.append(time.thread_time_ns() - commanded)
    return _of(np.array(commands)), _of(np.array(observations))


def _of(nanoseconds: Array) -> CommandTimes:
    return CommandTimes(1e-6 * float(np.median(nanoseconds)), 1e-6 * float(nanoseconds.max()))
