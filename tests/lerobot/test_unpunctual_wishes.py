"""The lead in a loop that is not punctual: wishes made for an even pace, and those read at the moment of the loop."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lerobot_robot_lrm.lead import MEMORY_S, Lead
from lerobot_robot_lrm.wish_times import times_of_even_motion
from lrm_math.arrays import Array

FRAMES, DEAD_TIME = 300, 0.05
SEEDS, JITTERS, FPS = st.integers(0, 10_000), st.floats(0.0, 0.005), st.sampled_from([30.0, 60.0])
PLANNED, READ = "planned", "read"


def sines(t: Array) -> Array:
    return np.stack([0.6 * np.sin(3.0 * t) + 0.2 * np.sin(5.7 * t + 1.0), 0.4 * np.cos(4.0 * t), 0.9 * t], axis=1)


def unpunctual(jitter: float, fps: float, seed: int) -> tuple[Array, Array]:
    """(N,), s, times of an even pace, and those at which a loop comes that is early or late by up to a jitter (s)."""
    even = np.arange(FRAMES) / fps
    return even, np.maximum.accumulate(even + np.random.default_rng(seed).uniform(-jitter, jitter, FRAMES))


def leads(wishes: Array, came: Array) -> Array:
    """(N, n), rad, ahead of wishes (N, n) that came at times (N,)."""
    lead, out = Lead.of(np.full(wishes.shape[1], DEAD_TIME)), []
    for wish, now in zip(wishes, came, strict=True):
        lead = lead.after(wish, now)
        out.append(lead.ahead)
    return np.array(out)


@pytest.mark.parametrize("made", [PLANNED, READ])
@given(rate=st.floats(0.3, 1.5), jitter=JITTERS, fps=FPS, seed=SEEDS)
def test_a_steady_motion_is_led_evenly(made: str, rate: float, jitter: float, fps: float, seed: int) -> None:
    even, came = unpunctual(jitter, fps, seed)
    wishes = rate * (even if made == PLANNED else came)[:, None]
    found = leads(wishes, came)[int(MEMORY_S * fps) + 1 :]
    most = 2.0 * jitter / (MEMORY_S - 2.0 / fps) if made == PLANNED else 1e-6
    assert np.abs(found / (rate * DEAD_TIME) - 1.0).max() <= 2.0 * most + 1e-6


@pytest.mark.parametrize("made", [PLANNED, READ])
@given(jitter=JITTERS, fps=FPS, seed=SEEDS)
def test_no_command_steps_back_while_its_wish_goes_on(made: str, jitter: float, fps: float, seed: int) -> None:
    even, came = unpunctual(jitter, fps, seed)
    wishes = sines(even if made == PLANNED else came)
    steps, stepped = np.diff(wishes, axis=0), np.diff(wishes + leads(wishes, came), axis=0)
    assert (np.sign(steps) * stepped >= -1e-9).all()


@given(slow=st.floats(0.1, 0.4), fast=st.floats(1.0, 1.5))
def test_a_command_waits_for_its_wish_no_longer_than_two_spans(slow: float, fast: float) -> None:
    fps, dead_time = 30.0, DEAD_TIME
    even = np.arange(20) / fps
    wishes = np.where(even < 0.3, fast * even, fast * 0.3 + slow * (even - 0.3))[:, None]
    ahead = leads(wishes, even)[:, 0]
    slowed = int(np.flatnonzero(even > 0.3)[0])
    assert ahead[slowed + 2] <= slow * dead_time + 1e-9


def test_a_loop_that_changes_its_pace_has_no_even_one() -> None:
    came: Array = np.append(np.arange(6) / 60.0, 5 / 60.0 + np.arange(1, 6) / 20.0)
    planned: Array = np.arange(11.0)[:, None]
    np.testing.assert_array_equal(times_of_even_motion(came, planned), came)


@given(count=st.integers(1, 2))
def test_one_or_two_wishes_have_the_times_at_which_they_came(count: int) -> None:
    came = 0.1 * np.arange(count)
    np.testing.assert_array_equal(times_of_even_motion(came, np.zeros((count, 2))), came)
