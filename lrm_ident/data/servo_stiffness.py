"""Stiffness test of one servo (Conenna 2024, section 5.3): deflection under increasing and decreasing torque.

Model: φ = φ0 + k τ ± h/2, + while the torque falls, with compliance k and a hysteresis loop of width h (backlash and
friction). An F test of a quadratic and a cubic term shows whether the spring is linear.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc

from lrm_ident.data.measurement_file.number_table import numbers_of, read_csv
from lrm_ident.data.table_text.csv_file import CsvTable
from lrm_math.arm.arm_file import GRAM, MM
from lrm_math.arrays import Array
from lrm_math.errors import FileError, LrmError

GRAVITY = 9.81  # m/s²
SAME_TORQUE = 1e-6  # N·m
MIN_TORQUES = 3


@dataclass(frozen=True, eq=False)
class ServoTest:
    """N readings of one servo in measured order: `torque` (N,) in N·m and deflection `angle` (N,) in rad."""

    torque: Array
    angle: Array

    @property
    def falling(self) -> NDArray[np.bool_]:
        """(N,), whether the reading is on a branch of falling torque; the first one starts a branch."""
        change = np.diff(self.torque)
        moved = np.abs(change) >= SAME_TORQUE
        falls = change[moved] < 0.0
        return np.concatenate([falls[:1] if len(falls) else [False], falls])[[0, *np.cumsum(moved)]]

    @property
    def loading(self) -> NDArray[np.bool_]:
        """(N,), whether the reading is on a branch of the initial direction."""
        return np.asarray(self.falling == self.falling[0], dtype=np.bool_)


@dataclass(frozen=True, eq=False)
class StiffnessEstimate:
    """Estimates from a stiffness test.

    Attributes:
        slope, slope_error: compliance k and its standard error (rad/N·m).
        offset: φ0 (rad).
        loop, loop_error: h and its standard error (rad); None without both branches.
        secants: slopes between neighbouring torques while loading (rad/N·m), as in the thesis.
        departure: largest deviation of a torque's mean angle from the line, relative to the deflection.
        curvature_p: p value of the F test of τ² and τ³; None if there are too few readings.
        scatter: standard deviation of the readings about the model (rad).
        fitted: (N,), the model (rad).
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
    """Reads `angle_deg` and `torque_Nm`, or `load_g` and `lever_mm` (horizontal). Raises `FileError`."""
    table = read_csv(path, ["angle_deg"])
    return ServoTest(_torque(table), np.radians(numbers_of(table, "angle_deg")))


def _torque(table: CsvTable) -> Array:
    if "torque_Nm" in table.header:
        return numbers_of(table, "torque_Nm")
    missing = [name for name in ("load_g", "lever_mm") if name not in table.header]
    if missing:
        what = f"no column torque_Nm, and no {missing[0]} to compute it from"
        raise FileError(table.path, "header", what, "give torque_Nm, or load_g and lever_mm")
    return numbers_of(table, "load_g") * GRAM * GRAVITY * numbers_of(table, "lever_mm") * MM


def stiffness(test: ServoTest) -> StiffnessEstimate:
    """Least-squares fit of the model. Raises `LrmError` for too few readings or torques."""
    levels = np.unique(np.round(test.torque / SAME_TORQUE))
    sides = np.where(test.falling, 0.5, -0.5)
    both = bool(np.any(sides > 0) and np.any(sides < 0))
    columns = [np.ones_like(sides), test.torque, *([sides] if both else [])]
    if len(levels) < MIN_TORQUES or len(sides) <= len(columns):
        raise LrmError(
            f"{len(sides)} readings at {len(levels)} different torques; a slope with its error needs at least "
            f"{MIN_TORQUES} torques and {len(columns) + 1} readings"
        )
    A = np.stack(columns, axis=1)
    estimate, *_ = np.linalg.lstsq(A, test.angle, rcond=None)
    residual = test.angle - A @ estimate
    scatter = float(np.sqrt(residual @ residual / (len(residual) - len(columns))))
    error = scatter * np.sqrt(np.diag(np.linalg.inv(A.T @ A)))
    return StiffnessEstimate(
        test=test,
        slope=float(estimate[1]),
        slope_error=float(error[1]),
        offset=float(estimate[0]),
        loop=float(estimate[2]) if both else None,
        loop_error=float(error[2]) if both else None,
        secants=_secants(test),
        departure=_departure(test, residual),
        curvature_p=_curvature(test, A, residual),
        scatter=scatter,
        fitted=A @ estimate,
    )


def _secants(test: ServoTest) -> tuple[float, ...]:
    torque, angle = _level_means(test.torque[test.loading], test.angle[test.loading])
    return tuple((np.diff(angle) / np.diff(torque)).tolist())


def _departure(test: ServoTest, residual: Array) -> float:
    _, mean = _level_means(test.torque, residual)
    deflection = np.ptp(_level_means(test.torque, test.angle)[1])
    return float(np.abs(mean).max() / deflection) if deflection > 0 else 0.0


def _level_means(torque: Array, values: Array) -> tuple[Array, Array]:
    """Distinct torques in increasing order, and the mean of the values at each."""
    levels, row = np.unique(np.round(torque / SAME_TORQUE), return_inverse=True)
    return levels * SAME_TORQUE, np.bincount(row.reshape(-1), values) / np.bincount(row.reshape(-1))


def _curvature(test: ServoTest, A: Array, residual: Array) -> float | None:
    """p value of the F test of the terms in τ² and τ³."""
    size = test.torque / max(float(np.abs(test.torque).max()), SAME_TORQUE)
    wide = np.column_stack([A, size**2, size**3])
    rank = int(np.linalg.matrix_rank(wide))  # at three torques τ³ is a line and τ²
    freedom, added = len(residual) - rank, rank - A.shape[1]
    if freedom < 1 or added < 1:
        return None
    estimate, *_ = np.linalg.lstsq(wide, test.angle, rcond=None)
    after = float(((test.angle - wide @ estimate) ** 2).sum())
    before = float(residual @ residual)
    if after <= 0.0:
        return 0.0 if before > 0.0 else 1.0
    return float(fdtrc(added, freedom, (before - after) / added / (after / freedom)))
