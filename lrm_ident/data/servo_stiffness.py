"""The preliminary test of one servo (Conenna 2024, section 5.3): how far it turns under a torque, there and back.

The angle is described by φ = φ0 + k τ ± h/2, + while the torque falls: slope k, and a loop of width h between loading
and unloading (play and friction). What a quadratic and a cubic term would add tells whether the spring is linear.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from lrm_ident.data.csv_table import Table, read_table
from lrm_math.arm.arm_file import GRAM, MM
from lrm_math.arrays import Array
from lrm_math.errors import FileError, LrmError

GRAVITY = 9.81  # m/s²
SAME_TORQUE = 1e-6  # N·m
LEAST_TORQUES = 3


@dataclass(frozen=True, eq=False)
class ServoTest:
    """One servo, N readings in the order taken: `torque` (N,) in N·m and `angle` (N,) in rad that it gave way by."""

    torque: Array
    angle: Array

    @property
    def falling(self) -> NDArray[np.bool_]:
        """(N,), whether the torque fell since the reading before; equal torques stay on their branch.

        The first reading belongs to the branch that begins there.
        """
        change = np.diff(self.torque)
        moves = change[np.abs(change) >= SAME_TORQUE]
        branch = bool(len(moves) and moves[0] < 0)
        out = [branch]
        for step in change:
            branch = branch if abs(step) < SAME_TORQUE else bool(step < 0)
            out.append(branch)
        return np.array(out)

    @property
    def loading(self) -> NDArray[np.bool_]:
        """(N,), the branch that the test begins with."""
        return np.asarray(self.falling == self.falling[0], dtype=np.bool_)


@dataclass(frozen=True, eq=False)
class Stiffness:
    """What the test tells.

    Attributes:
        slope, slope_error: compliance k and its standard error (rad/N·m).
        offset: φ0 (rad).
        loop, loop_error: h and its standard error (rad); None if it was only loaded, or only unloaded.
        secants: slopes between neighbouring torques while loading (rad/N·m), as the thesis states them.
        departure: largest distance of a torque's mean angle from the line, as part of the whole deflection.
        curvature_p: probability of terms in τ² and τ³ as large as these if the spring were linear; None if there are
            too few readings to tell.
        scatter: standard deviation of the readings about the description (rad).
        fitted: (N,), the description (rad).
    """

    test: ServoTest
    slope: float
    slope_error: float
    offset: float
    loop: float | None
    loop_error: float | None
    secants: tuple[float, ...]
    departure: float
    curvature_p: float | None
    scatter: float
    fitted: Array


def load_servo_test(path: Path) -> ServoTest:
    """Reads `angle_deg` and `torque_Nm`, or `load_g` and `lever_mm` (horizontal distance of the load from the axis).

    Raises:
        FileError: naming file, line and column of the first fault.
    """
    table = read_table(path, ["angle_deg"])
    return ServoTest(_torque(table), np.radians(table.numbers("angle_deg")))


def _torque(table: Table) -> Array:
    if "torque_Nm" in table.header:
        return table.numbers("torque_Nm")
    missing = [name for name in ("load_g", "lever_mm") if name not in table.header]
    if missing:
        what = f"no column torque_Nm, and no {missing[0]} to compute it from"
        raise FileError(table.path, "header", what, "give torque_Nm, or load_g and lever_mm")
    return table.numbers("load_g") * GRAM * GRAVITY * table.numbers("lever_mm") * MM


def stiffness(test: ServoTest) -> Stiffness:
    """Least squares of the description. Raises `LrmError` if there are too few readings or torques."""
    levels = np.unique(np.round(test.torque / SAME_TORQUE))
    sides = np.where(test.falling, 0.5, -0.5)
    both = bool(np.any(sides > 0) and np.any(sides < 0))
    columns = [np.ones_like(sides), test.torque, *([sides] if both else [])]
    if len(levels) < LEAST_TORQUES or len(sides) <= len(columns):
        raise LrmError(
            f"{len(sides)} readings at {len(levels)} different torques; a slope with its error needs at least "
            f"{LEAST_TORQUES} torques and {len(columns) + 1} readings"
        )
    A = np.stack(columns, axis=1)
    answer, *_ = np.linalg.lstsq(A, test.angle, rcond=None)
    left = test.angle - A @ answer
    scatter = float(np.sqrt(left @ left / (len(left) - len(columns))))
    error = scatter * np.sqrt(np.diag(np.linalg.inv(A.T @ A)))
    return Stiffness(
        test=test,
        slope=float(answer[1]),
        slope_error=float(error[1]),
        offset=float(answer[0]),
        loop=float(answer[2]) if both else None,
        loop_error=float(error[2]) if both else None,
        secants=_secants(test),
        departure=_departure(test, left),
        curvature_p=_curvature(test, A, left),
        scatter=scatter,
        fitted=A @ answer,
    )


def _secants(test: ServoTest) -> tuple[float, ...]:
    torque, angle = _level_means(test.torque[test.loading], test.angle[test.loading])
    points = list(zip(torque.tolist(), angle.tolist(), strict=True))
    return tuple((b[1] - a[1]) / (b[0] - a[0]) for a, b in pairwise(points))


def _departure(test: ServoTest, left: Array) -> float:
    _, mean = _level_means(test.torque, left)
    deflection = np.ptp(_level_means(test.torque, test.angle)[1])
    return float(np.abs(mean).max() / deflection) if deflection > 0 else 0.0


def _level_means(torque: Array, values: Array) -> tuple[Array, Array]:
    """Torques from low to high, and the mean of the values at each."""
    levels, row = np.unique(np.round(torque / SAME_TORQUE), return_inverse=True)
    return levels * SAME_TORQUE, np.bincount(row.reshape(-1), values) / np.bincount(row.reshape(-1))


def _curvature(test: ServoTest, A: Array, left: Array) -> float | None:
    """F test of the two further terms."""
    scale = max(float(np.abs(test.torque).max()), SAME_TORQUE)
    size = test.torque / scale
    wide = np.column_stack([A, size**2, size**3])
    freedom = len(left) - wide.shape[1]
    added = np.linalg.matrix_rank(wide) - A.shape[1]
    if freedom < 1 or added < 1:
        return None
    answer, *_ = np.linalg.lstsq(wide, test.angle, rcond=None)
    after = float(((test.angle - wide @ answer) ** 2).sum())
    before = float(left @ left)
    if after <= 0.0:
        return 0.0 if before > 0.0 else 1.0
    return float(stats.f.sf((before - after) / added / (after / freedom), added, freedom))
