"""Relaxation of a fixed-point iteration: it settles where steps overshoot, creep, or pass a point that hardly rests."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_math.model.fixed_point import MOST_ITERATIONS, Relaxation


def iterations(step_at: Callable[[float], float], x: float) -> tuple[float, int]:
    """The fixed point from x, and how many relaxed steps lead there."""
    relaxed: Relaxation | None = None
    for number in range(1, MOST_ITERATIONS + 1):
        step = np.array([[step_at(x)]])
        if abs(step[0, 0]) < 1e-9:
            return x, number
        relaxed = Relaxation.after(relaxed, step)
        x += float(relaxed.factor[0] * step[0, 0])
    return x, MOST_ITERATIONS + 1


@given(st.floats(-8.0, 0.99), st.floats(-3.0, 3.0))
def test_a_line_is_settled_in_a_few_steps(slope: float, x: float) -> None:
    """Slope of the fixed-point map: it overshoots below -1, and creeps near 1."""
    found, number = iterations(lambda at: (slope - 1.0) * at, x)
    assert abs(found) < 1e-6
    assert number < 200


@pytest.mark.parametrize("gap", [1e-4, 1e-5, 1e-6])
def test_where_two_ends_of_a_play_have_just_become_one_is_passed(gap: float) -> None:
    """A plain iteration takes some pi / sqrt(gap) steps past the point that hardly moves, to where it rests."""
    found, number = iterations(lambda at: (at * at + gap) * (1.0 - at), -0.5)
    assert found == pytest.approx(1.0, abs=1e-6)
    assert number <= MOST_ITERATIONS
