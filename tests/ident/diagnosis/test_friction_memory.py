"""Friction with memory: its states, its fallback where moves are unknown, and the loop of the independent generator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from lrm_math.arm.arm import Arm
from lrm_math.effects import effects_at
from lrm_math.kinematics.motion import TRAVELS_DEG, recorded
from lrm_math.kinematics.poses import Poses


def history(seed: int, count: int = 30) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1.2, 1.2, (count, 2))


@given(st.integers(0, 2**32 - 1))
def test_states_lie_between_the_directions(seed: int) -> None:
    q = history(seed)
    moves, states = recorded(q, None)
    assert np.abs(states).max() <= 1.0
    np.testing.assert_array_equal(np.sign(states - np.roll(states, 1, axis=0))[2:] * moves[2:, :, None] >= 0.0, True)


def test_states_solve_dahls_equation() -> None:
    """Oracle: the equation integrated over the path of each joint."""
    q, start = history(1, 12), np.zeros(2)
    _, states = recorded(q, start)
    for k, travel in enumerate(np.radians(TRAVELS_DEG)):
        s = float(np.sign(q[0, 0]))
        for row in range(1, len(q)):
            move = q[row, 0] - q[row - 1, 0]
            side = float(np.sign(move))
            way = solve_ivp(lambda _, y, to=side, by=travel: (to - y) / by, (0.0, abs(move)), [s], rtol=1e-9)
            s = float(way.y[0, -1])
            assert states[row, 0, k] == pytest.approx(s, abs=1e-6)


def test_after_long_moves_it_is_hysteresis(lab: Arm) -> None:
    [curve], [plain] = (effects_at(lab, f"{name}@joint2") for name in ("friction_curve", "hysteresis"))
    rng = np.random.default_rng(2)
    q, side = rng.uniform(-1, 1, (20, 6)), rng.choice([-1.0, 1.0], (20, 6))
    tau = (rng.normal(size=20),)
    [unknown] = curve.amounts(Poses(q, np.zeros(20), side), tau, (0.01, 0.02, 0.03, 0.0))
    [known] = plain.amounts(Poses(q, np.zeros(20), side), (), (0.12,))
    np.testing.assert_allclose(unknown, known, atol=1e-15)
    slid = replace(Poses(q, np.zeros(20), side), friction=np.repeat(side[:, :, None], 3, axis=2))
    np.testing.assert_allclose(curve.amounts(slid, tau, (0.01, 0.02, 0.03, 0.0))[0], known, atol=1e-15)
    grown = curve.amounts(slid, tau, (0.0, 0.0, 0.0, 0.05))[0]
    np.testing.assert_allclose(grown, 0.05 * side[:, 1] * np.abs(tau[0]), atol=1e-15)
