"""A predicted settling time is the last moment at which the tip is farther from its rest than asked."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lrm_math.arm.arm_file import load_arm
from lrm_math.motion.motion_model import MotionModel, effect_of
from lrm_math.motion.settling import settling, settling_after

ARM = load_arm("so101")
START, GOAL, SPEED = np.zeros(5), np.array([0.6, -0.3, 0.2, 0.1, 0.0]), np.radians(30.0)


def arm(frequency: float, damping: float) -> MotionModel:
    """An SO-101 with this response of every servo."""
    model = MotionModel.nominal(ARM)
    stated = {"frequency_Hz": frequency, "damping_ratio": damping, "b_rad": 0.0}
    return replace(model, values={key: stated[key.split(".")[-1]] for key in model.values})


def swinging() -> MotionModel:
    """Damped servos, and a base joint whose link swings for long."""
    soft, swing = arm(4.0, 0.7), effect_of(ARM, "swing@joint1")
    values = dict(zip(swing.keys, (3.0, 0.02, 0.0), strict=True))
    return soft.with_joint((*soft.of_joint(0), swing), {**values, **soft.values}, {})


def test_what_swings_less_settles_sooner_and_a_wider_distance_is_reached_sooner() -> None:
    times = [settling(arm(4.0, damping), START, GOAL, SPEED, 1e-4).seconds for damping in (0.03, 0.1, 0.7)]
    assert times == sorted(times, reverse=True)
    assert times[0] > 2.0 * times[1] > 2.0 * times[2] > 0.0
    assert settling(arm(4.0, 0.1), START, GOAL, SPEED, 1e-3).seconds < times[1]


def test_the_envelope_of_a_single_joint_is_that_of_the_textbook() -> None:
    """A ramp that ends at speed v leaves a swing of v/ω, which fades with ζω (Åström & Murray 2008, section 6.3)."""
    frequency, damping, within = 3.0, 0.05, 1e-4
    goal = np.array([0.0, 0.0, 0.0, 0.6, 0.0])
    omega, lever = 2.0 * np.pi * frequency, 0.16  # m from the wrist to the tip
    found = settling(arm(frequency, damping), START, goal, SPEED, within)
    expected = np.log(lever * SPEED / omega / within) / (damping * omega)
    assert found.joint == 3
    assert found.seconds == pytest.approx(expected, rel=0.15)


def test_an_arm_that_stays_has_settled_and_a_soft_joint_swings_longer() -> None:
    assert settling(arm(4.0, 0.7), START, START, SPEED, 1e-4).seconds == 0.0
    found = settling(swinging(), START, GOAL, SPEED, 1e-4)
    assert found.joint == 0
    assert found.seconds > 5.0 * settling(arm(4.0, 0.7), START, GOAL, SPEED, 1e-4).seconds


@pytest.mark.long
def test_several_paths_and_frequencies_give_the_time_of_a_share_of_their_cases() -> None:
    known, step = swinging(), 0.005
    paths = np.stack([np.linspace(START, GOAL, 200)] * 3)
    for k, ahead in ((1, 2), (2, 4)):  # those arrive sooner, and stand at the goal
        paths[k] = np.vstack([paths[0, ahead:], np.tile(GOAL, (ahead, 1))])
    single = sorted(
        settling_after(known, START, path[None], step, 1e-4, frequency_factors=(off,))[0].seconds
        for path in paths
        for off in (0.9, 1.1)
    )
    both = sorted(
        settling_after(known, START, paths[:1], step, 1e-4, frequency_factors=(off,))[0].seconds for off in (0.9, 1.1)
    )
    for share, expected in ((1.0, both[1]), (0.5, both[0])):
        twice = paths[[0, 0]]
        alike = settling_after(known, START, twice, step, 1e-4, frequency_factors=(0.9, 1.1), shares=(share,))[0]
        assert alike.seconds == pytest.approx(expected), "exact where the ways are the same"
    for share, expected in ((1.0, single[-1]), (0.5, single[2]), (0.75, single[4])):
        found = settling_after(known, START, paths, step, 1e-4, frequency_factors=(0.9, 1.1), shares=(share,))[0]
        assert found.seconds == pytest.approx(expected, abs=1.0 / 3.0), (
            "one swing at most: the inertia is that of the mean of the ways"
        )
    assert single[0] < single[-1]
