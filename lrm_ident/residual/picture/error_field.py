"""Error field: an arrow at every measured TCP for each step of a model's history, all on one scale."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.error_stats import ErrorStats, error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.registration.set_up import nominal_arm
from lrm_ident.fitting.identifiability import subsample_rows
from lrm_ident.residual.picture.arm_solids import ArmSolids, arm_solids, placed
from lrm_math.arrays import Array
from lrm_math.kinematics.forward import frames
from lrm_math.model.derivatives import joint_levers
from lrm_math.model.equilibrium import Equilibrium, solve_equilibrium
from lrm_math.model.model import Model

MOST_DRAWN, WORST_DRAWN, SEED = 500, 100, 0
ARROW_SHARE, COLOUR_SHARE = 0.25, 0.98
"""Length of a long arrow (95 % quantile) in parts of the cloud's spread; quantile of the errors at the last colour."""
COLOURS = 8


@dataclass(frozen=True)
class ArrowScale:
    """Magnification of the arrows, and the error at which the colours end (m); the same for all steps."""

    magnification: float
    largest: float

    @property
    def words(self) -> str:
        """Caption of the picture."""
        enlarged = f"{self.magnification:g} times enlarged, colours to {self.largest * 1e3:g} mm"
        return f"Dots: measured positions of the tip. Arrows: measured minus predicted, {enlarged}, alike in all steps."


@dataclass(frozen=True, eq=False)
class FieldStep:
    """One step of a model's history on the drawn poses.

    Attributes:
        name: of the step. error: over all poses.
        residual: (M, 3), measured − predicted TCP (m).
        turns: (n, M), rotation of each joint alone that fits the residual best (rad).
    """

    name: str
    error: ErrorStats
    residual: Array
    turns: Array


@dataclass(frozen=True, eq=False)
class ErrorField:
    """Error field of all steps.

    Attributes:
        rows: (M,), rows of the data that are drawn; `poses`: number of all.
        nominal, bent: (M, n + 2, 3), origins of the frames of the nominal arm and of the last model, base to TCP (m).
        solids: links between these origins and further points, `nominal_points` and `bent_points` (M, K, 3) in m.
        nominal_residual: (N, 3), measured − TCP of the nominal arm, at all poses (m).
        lever: (n, M), squared motion of the TCP for a unit rotation of each joint of the last model (m²/rad²).
    """

    rows: NDArray[np.int64]
    poses: int
    steps: tuple[FieldStep, ...]
    nominal: Array
    bent: Array
    solids: ArmSolids
    nominal_points: Array
    bent_points: Array
    scale: ArrowScale
    nominal_residual: Array
    lever: Array


def error_field(data: Measurements, models: Sequence[tuple[str, Model]]) -> ErrorField:
    """The error field of named models, the oldest first. Raises `NoEquilibrium`."""
    rests = [(name, solve_equilibrium(model, data.poses)) for name, model in models]
    rows = rows_to_draw(data.position_error(rests[-1][1]))
    arm = models[-1][1].arm
    nominal, last = solve_equilibrium(nominal_arm(arm, data), data.poses), rests[-1][1]
    drawn, bent = _frames(nominal.take(rows)), _frames(last.take(rows))
    solids = arm_solids(arm, drawn[0])
    return ErrorField(
        rows=rows,
        poses=len(data),
        steps=tuple(_step(name, equilibrium, data, rows) for name, equilibrium in rests),
        nominal=drawn[:, :, :3, 3],
        bent=bent[:, :, :3, 3],
        solids=solids,
        nominal_points=placed(solids, drawn),
        bent_points=placed(solids, bent),
        scale=arrow_scale(data.places(last), data.position_error(rests[0][1])),
        nominal_residual=data.position_error(nominal),
        lever=(joint_levers(last.take(rows)) ** 2).sum(axis=1),
    )


def rows_to_draw(residual: Array) -> NDArray[np.int64]:
    """Rows to draw: all, or the worst and random ones of those that a diagnosis screens, always the same."""
    if len(residual) <= MOST_DRAWN:
        return np.arange(len(residual))
    worst = np.argsort(-np.linalg.norm(residual, axis=1))[:WORST_DRAWN]
    others = np.random.default_rng(SEED).permutation(np.setdiff1d(subsample_rows(len(residual)), worst))
    return np.sort(np.concatenate([worst, others[: MOST_DRAWN - WORST_DRAWN]]))


def arrow_scale(tcp: Array, residual: Array) -> ArrowScale:
    """The scale for positions and residuals (N, 3) in m; round numbers."""
    distance = np.linalg.norm(residual, axis=1)
    spread = float(np.sqrt(((tcp - tcp.mean(axis=0)) ** 2).sum(axis=1).mean()))
    long = float(np.quantile(distance, 0.95))
    magnification = _round_down(ARROW_SHARE * spread / long) if long > 0 and spread > 0 else 1.0
    return ArrowScale(magnification, _round_up(float(np.quantile(distance, COLOUR_SHARE)) * 1e3) * 1e-3)


def joint_turns(residual: Array, motion: Array) -> Array:
    """(n, M), rotation of each joint alone (rad) that fits residuals (M, 3) best.

    Args:
        motion: (n, 3, M), motion of the TCP for a unit rotation of each joint (m/rad).
    """
    length = np.maximum((motion**2).sum(axis=1), 1e-12)
    return np.asarray(np.einsum("mc,ncm->nm", residual, motion) / length)


def arm_lines(equilibrium: Equilibrium) -> Array:
    """(N, n + 2, 3), origins of the frames from base to TCP (m)."""
    return _frames(equilibrium)[:, :, :3, 3]


def _frames(equilibrium: Equilibrium) -> Array:
    """(N, n + 2, 4, 4), frames from base to TCP (m)."""
    return frames(equilibrium.model.chain, equilibrium.slots, len(equilibrium.poses))


def _step(name: str, equilibrium: Equilibrium, data: Measurements, rows: NDArray[np.int64]) -> FieldStep:
    """One step on the drawn rows."""
    drawn, residual = equilibrium.take(rows), data.position_error(equilibrium)
    return FieldStep(name, error_stats(residual), residual[rows], joint_turns(residual[rows], joint_levers(drawn)))


def _round_down(value: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is not above a value."""
    power = 10.0 ** math.floor(math.log10(value))
    return max(step * power for step in (1.0, 2.0, 5.0) if step * power <= value * (1 + 1e-9))


def _round_up(value: float) -> float:
    """The smallest of 1, 2, 4, 8 times a power of ten that is not below a value; a micrometre at least."""
    value = max(value, 1e-3)
    power = 10.0 ** math.floor(math.log10(value))
    return min(step * power for step in (1.0, 2.0, 4.0, 8.0, 10.0) if step * power >= value * (1 - 1e-9))
