"""Moves at many phases of the frames at once swing as the daemon's simulated arm does at one of them."""

from __future__ import annotations

import numpy as np
import pytest

from validation.swinging_arm.__main__ import EVERY, STEP, best_hit_rate, distances_from_rest, settling_times
from validation.swinging_arm.rig import SwingingRover


@pytest.mark.long
def test_one_of_the_phases_is_that_of_the_simulated_arm() -> None:
    rover = SwingingRover(50.0, "off", in_frames=True)
    _, leg = rover.move(np.array([0.1, -0.15, 0.1, 0.1, 0.0, 0.0]))
    tips = rover.tips(700)
    away = np.linalg.norm(tips - tips[-1], axis=1)[:300]
    ((*phases,),) = distances_from_rest(rover, [rover.known._path(leg.move)], rover.known._frame)
    at = rover.tick_s * np.arange(1, 301)
    grid = STEP * EVERY * np.arange(len(phases[0]))
    off = [np.sqrt(np.mean((np.interp(at + late, grid, one) - away) ** 2)) for one in phases for late in (-0.0065, 0.0)]
    assert min(off) < 0.1 * np.sqrt(np.mean(away**2)) < 0.5 * max(off)


def test_the_oracle_is_right_for_the_largest_share_that_one_number_can_be_right_for() -> None:
    assert best_hit_rate(np.array([1.0, 1.1, 3.0, 9.0])) == 0.5
    assert best_hit_rate(np.array([0.0, 0.19, 0.1])) == 1.0


def test_a_tip_has_settled_after_it_was_last_far() -> None:
    away = np.array([[[3.0, 0.5, 2.0, 0.1], [0.1, 0.1, 0.1, 0.1]]])
    np.testing.assert_allclose(settling_times(away, 1.0), [[3 * STEP * EVERY, 0.0]])


@pytest.mark.long
def test_where_moves_are_timed_a_frame_is_whole_ticks() -> None:
    """The rig's configuration is the shipped one with the shaping that is asked for."""
    rover = SwingingRover(50.0, "timed")
    assert rover.config.motion.shaping == "timed"
    assert rover.known._frame / rover.tick_s == pytest.approx(3.0, abs=1e-6)
