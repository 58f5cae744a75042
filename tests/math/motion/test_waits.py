"""Waits let the jolts of the last counts cancel, by an oracle of its own; they are few, or none."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from lrm_math.motion.motion_model import MotionModel
from lrm_math.motion.settling import tip_jacobian
from lrm_math.motion.swing_along import swing_along
from lrm_math.motion.waits import LEAST, MOST, waits_of
from tests.support.motion_models import swinging

TICK, FRAME = 0.0065, 0.0195
COUNT = np.radians(0.4)
MODEL = swinging(joint1=(4.0, 0.05), joint2=(5.0, 0.05))
ARM = MODEL.arm


def stairs(goal: np.ndarray, ticks: int) -> np.ndarray:
    """(ticks + 1, n), rad: a straight move in counts."""
    return np.round(np.linspace(0.0, 1.0, ticks + 1)[:, None] * goal / COUNT) * COUNT


def waited(path: np.ndarray, waits) -> np.ndarray:
    """The path with its waits, row by row."""
    stays = dict(waits)
    return np.concatenate([np.tile(row, (1 + stays.get(len(path) - 1 - k, 0), 1)) for k, row in enumerate(path)])


def swing(path: np.ndarray, model: MotionModel, phase: float) -> float:
    """RMS (m) of the tip for 2 s after the path, put out in frames: links integrated by `swing_along`, with
    the inertia of the last posture, as the waits take it."""
    h = TICK / 13.0
    seconds = np.arange(0.0, len(path) * TICK + 2.2, h)
    shown = np.floor((seconds - phase) / FRAME) * FRAME + phase
    servos = path[np.clip(np.floor(shown / TICK + 1e-6).astype(int), 0, len(path) - 1)]
    away = swing_along(model, servos[:, None], h, (1.0,), 0.0, length=0)[:, 0, 0]
    tip = away[-round(2.0 / h) :] @ tip_jacobian(model, path[-1])
    return float(np.sqrt(np.mean(np.sum(tip**2, axis=1))))


@pytest.mark.long
def test_less_swing_is_left_at_any_phase_of_the_frames_and_with_frequencies_that_are_off() -> None:
    """Over three moves, RMS."""
    rng = np.random.default_rng(0)
    left = []
    for path in (stairs(rng.uniform(-1.0, 1.0, ARM.dof), 300) for _ in range(3)):
        there = waited(path, waits_of(MODEL, path, TICK, FRAME))
        assert len(path) < len(there) <= len(path) + MOST
        off = swinging(joint1=(4.0 * 1.05, 0.05), joint2=(5.0 * 1.05, 0.05))
        for known, phase in product((MODEL, off), (0.1, 0.7)):
            left.append([swing(p, known, phase * FRAME) for p in (path, there)])
    square = np.mean(np.square(left).reshape(3, 2, 2, 2), axis=(0, 2))
    as_known, as_off = np.sqrt(square[:, 0] / square[:, 1])
    assert as_known > 4.0
    assert as_off > 2.0


@pytest.mark.parametrize("ticks", [1, 5, 40, 2000])
def test_waits_are_short_and_ever_nearer_to_the_end(ticks) -> None:
    found = waits_of(MODEL, stairs(np.full(ARM.dof, 0.02 * ticks**0.5), ticks), TICK, 0.02)
    left = [remaining for remaining, _ in found]
    assert left == sorted({*left}, reverse=True)
    assert all(0 < remaining <= ticks for remaining in left)
    assert all(wait > 0 for _, wait in found)
    assert sum(wait for _, wait in found) <= (MOST if ticks > 6 * LEAST else LEAST)


def test_nothing_waits_where_nothing_swings_or_moves() -> None:
    path = stairs(np.full(ARM.dof, 0.3), 50)
    assert waits_of(replace(MotionModel.nominal(ARM)), path, TICK, FRAME) == ()
    assert waits_of(MODEL, np.zeros((3, ARM.dof)), TICK, FRAME) == ()
