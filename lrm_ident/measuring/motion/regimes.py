"""Where a model of motion fails: at rest, in slow or quick motion, after a reversal, under load, early or late."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from lrm_ident.measuring.motion.joint_fit import JointFit
from lrm_ident.measuring.motion.moves import Moves
from lrm_ident.residual.thresholds import FLOOR_RATIO, MIN_REGIME_RATIO

SLOW, QUICK = np.radians(5.0), np.radians(40.0)
"""Speeds (rad/s) below which a joint rests, and above which it is quick."""
AFTER_S = 0.3
LEAST_SHARE = 0.03
"""Share of the frames that a regime must have to be told."""


def worst_regimes(fit: JointFit, moves: Moves) -> Iterator[str]:
    """Regimes in which a joint is farther off than elsewhere, in words; none where its error is its noise."""
    joint = fit.effects[0].joint
    if fit.held_out_rms <= FLOOR_RATIO * moves.noise[joint]:
        return
    square = np.mean(fit.residual**2, axis=2)
    for words, where in _regimes(moves, joint):
        inside = where & moves.counted
        outside = ~where & moves.counted
        if min(inside.sum(), outside.sum()) < LEAST_SHARE * moves.counted.sum():
            continue
        here, elsewhere = (float(np.sqrt(square[rows].mean())) for rows in (inside, outside))
        if here > MIN_REGIME_RATIO * elsewhere:
            yield f"joint {joint + 1} {words}: {np.degrees(here):.2f} deg RMS, elsewhere {np.degrees(elsewhere):.2f}"


def _regimes(moves: Moves, joint: int) -> Iterator[tuple[str, NDArray[np.bool_]]]:
    speed = np.gradient(moves.command[:, :, joint], moves.dt, axis=1)
    rests, quick = np.abs(speed) < SLOW, np.abs(speed) > QUICK
    yield "at rest", rests
    yield f"faster than {np.degrees(QUICK):.0f} deg/s", quick
    yield "in slow motion", ~rests & ~quick
    yield (
        f"within {AFTER_S:g} s of a start, stop or reversal",
        _recent(np.diff(np.sign(speed * ~rests), axis=1) != 0, moves),
    )
    others = np.abs(np.gradient(moves.command, moves.dt, axis=1)).max(axis=2) > QUICK
    yield "while it rests and another joint is quick", rests & others
    load = np.abs(moves.loads.gravity[:, :, joint])
    yield "under its largest loads", load > np.quantile(load, 0.75)
    number = np.broadcast_to(np.arange(len(moves))[:, None], moves.counted.shape)
    yield "in the last third of the recording", number >= 2 * len(moves) // 3
    yield "in the first third of the recording", number < len(moves) // 3


def _recent(event: NDArray[np.bool_], moves: Moves) -> NDArray[np.bool_]:
    out = np.zeros(moves.counted.shape, dtype=np.bool_)
    for late in range(max(1, round(AFTER_S / moves.dt))):
        out[:, 1 + late :] |= event[:, : event.shape[1] - late]
    return out
