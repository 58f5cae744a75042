"""Choice of moves that discriminate between effects of motion: T-optimality (Atkinson & Fedorov 1975).

If effect A is there with its usual size and rival B is fitted in its place, together with what the model has, the
readings keep λ of squared error over the noise. B is as good as right while its error is within `MIN_GAIN` of the
noise, that is λ* = ((1 + MIN_GAIN)² − 1) N of N readings. The moves chosen make the sum of λ/(λ + λ*) over all ordered
pairs largest (greedy, then by exchange): a pair that is told already counts little. B's family is taken as the span of
its changes at all sizes that a fit starts from, so that λ is rather too small.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from lrm_ident.measuring.motion.joint_moves import JointMoves, predicted
from lrm_ident.residual.thresholds import MIN_GAIN
from lrm_math.arrays import Array
from lrm_math.motion.base import MotionEffect
from lrm_math.motion.motion_model import MotionModel

DIFFERENCE = 1e-2
"""Step of differences, in typical sizes."""
RIDGE = 1e-9
TURNS = 3
"""Rounds of exchanges at most."""
MOST_SIZES = 8


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """How effects change the readings of S moves, as inner products over the noise.

    Attributes:
        gram: (S, C, C), of all columns, move by move. basis: columns of what the model has. of: for each effect its
            columns, that of its typical size first. count: (S,), readings.
    """

    gram: Array
    basis: tuple[int, ...]
    of: tuple[tuple[int, ...], ...]
    count: Array

    def noncentrality(self, grams: Array) -> Array:
        """(…, P), λ of every ordered pair for sums of Gram matrices (…, C, C)."""
        rows = []
        for a, b in permutations(range(len(self.of)), 2):
            columns, span = self.of[a][0], [*self.basis, *self.of[b]]
            G, c = grams[..., span, :][..., span], grams[..., span, columns]
            scale = np.sqrt(np.maximum(np.diagonal(G, axis1=-2, axis2=-1), 1e-300))
            G, c = G / (scale[..., :, None] * scale[..., None, :]) + RIDGE * np.eye(len(span)), c / scale
            share = np.linalg.solve(G, c[..., None])[..., 0]
            rows.append(np.maximum(grams[..., columns, columns] - np.sum(share * c, axis=-1), 0.0))
        return np.stack(rows, axis=-1)

    def gain(self, grams: Array, count: Array) -> Array:
        """(…,), what the moves are worth."""
        least = ((1.0 + MIN_GAIN) ** 2 - 1.0) * count[..., None]
        told = self.noncentrality(grams)
        return np.asarray(np.sum(told / (told + least), axis=-1))


def sensitivities(
    model: MotionModel, joint: int, rivals: Sequence[MotionEffect], data: JointMoves, noise: float
) -> Sensitivities:
    """Of the effects that a joint's model has, and of rivals, on moves. `noise`: of a reading, rad or m."""
    effects_of_joint = model.of_joint(joint)
    values = np.array([model.values[key] for effect in effects_of_joint for key in effect.keys])
    typical = np.array([p.typical for effect in effects_of_joint for p in effect.parameters])
    rows = values + np.concatenate([np.zeros((1, len(values))), DIFFERENCE * np.diag(typical)])
    plain = predicted(effects_of_joint, rows, data.drive, data.substeps)
    columns, basis, of = [*(plain[1:] - plain[0])], tuple(range(len(values))), []
    for rival in rivals:
        sizes = _sizes(rival)
        seen = predicted(
            (*effects_of_joint, rival),
            np.column_stack([np.tile(values, (len(sizes), 1)), sizes]),
            data.drive,
            data.substeps,
        )
        of.append(tuple(range(len(columns), len(columns) + len(sizes))))
        columns += [*(seen - plain[0])]
    X = np.stack(columns)[..., None] * data.lever / noise * data.counted[..., None]
    return Sensitivities(
        np.einsum("astm,bstm->sab", X, X, optimize=True), basis, tuple(of), data.count.astype(np.float64)
    )


def _sizes(effect: MotionEffect) -> Array:
    """(K, p), typical values first, then those beside it, then those that a fit starts from."""
    typical = np.array([p.typical for p in effect.parameters])
    scans = np.array([*product(*(p.scan for p in effect.parameters))][:MOST_SIZES])
    return np.concatenate([typical[None], typical + DIFFERENCE * np.diag(typical), scans])


def chosen(sensitivities_of: Sensitivities, count: int) -> NDArray[np.int64]:
    """(count,), numbers of the moves that discriminate best, none twice."""
    S = len(sensitivities_of.gram)
    picked: list[int] = []
    total, N = np.zeros(sensitivities_of.gram.shape[1:]), 0.0
    for _ in range(min(count, S)):
        unpicked = np.setdiff1d(np.arange(S), picked)
        worth = sensitivities_of.gain(total + sensitivities_of.gram[unpicked], N + sensitivities_of.count[unpicked])
        best = int(unpicked[int(np.argmax(worth))])
        picked.append(best)
        total, N = total + sensitivities_of.gram[best], N + sensitivities_of.count[best]
    for _ in range(TURNS):
        before = list(picked)
        for place in range(len(picked)):
            others = [*picked[:place], *picked[place + 1 :]]
            unpicked = np.setdiff1d(np.arange(S), others)
            total, N = sensitivities_of.gram[others].sum(axis=0), sensitivities_of.count[others].sum()
            picked[place] = int(
                unpicked[
                    int(
                        np.argmax(
                            sensitivities_of.gain(
                                total + sensitivities_of.gram[unpicked], N + sensitivities_of.count[unpicked]
                            )
                        )
                    )
                ]
            )
        if picked == before:
            break
    return np.array(picked)
