"""The form of an effect beside the data: the turn of its joint against the one quantity that drives it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_math.arrays import Array
from lrm_math.effects import Effect, LoadedJointEffect
from lrm_math.effects.base import Amounts
from lrm_math.effects.derivatives import by_angles, by_parameters
from lrm_math.effects.targets import SERVO, slot_of
from lrm_math.kinematics.chain import is_zero
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.model.derivatives import respond

GRID = 200
LEAST_LEVER = 0.3  # of the longest: shorter ones turn little motion of the TCP into large angles
DEGREES = 180.0 / np.pi


@dataclass(frozen=True, eq=False)
class DriverCurve:
    """Turn of a joint by the effects of a fitted model that follow one driver.

    Attributes:
        driver, unit: the driver's name (`q2`, `tau2`, `t`) and unit. joint: the name of the joint that is turned.
        effects: names of the effects that are summed.
        at: (G,), values of the driver. turn, error: (G,), turn of the joint there and its standard error (°).
        measured_at, measured: (M,), drivers and turns of the poses whose TCP is far enough from the joint's axis: the
            effects' own and what the residual acts like (°).
    """

    driver: str
    unit: str
    joint: str
    effects: tuple[str, ...]
    at: Array
    turn: Array
    error: Array
    measured_at: Array
    measured: Array


def driver_curve(fitted: Fit, effect: Effect) -> DriverCurve | None:
    """The curve of all effects of the model that turn the same joint by the same driver; None if there is no such."""
    driver, model, rest = driver_of(effect), fitted.model, fitted.rest
    if not driver or len(effect.targets) != 1 or not effect.targets[0].endswith((".theta", SERVO)):
        return None
    turned = slot_of(effect.targets[0])
    slot, load_row = model.chain.index[turned], {k: row for row, k in enumerate(model.load_slots)}
    torque = rest.tau[load_row[slot]] if slot in load_row else np.zeros(len(rest.poses))
    values = _driver_values(driver, rest.poses, np.broadcast_to(np.asarray(torque), len(rest.poses)))
    grid = np.linspace(values.min(), values.max(), GRID)
    alike = [(one, p) for one, p in model.parts() if driver_of(one) == driver and slot_of(one.targets[0]) == turned]
    lever = respond(rest).slots[slot]
    square = (lever**2).sum(axis=0)
    far = square > LEAST_LEVER**2 * square.max()
    there = _poses_along(driver, rest.poses, grid)
    own, turn, columns = np.zeros(len(values)), np.zeros(GRID), []
    keys: list[str] = []
    for one, p in alike:
        here, along = _felt(one, values), _felt(one, grid)
        own = own + np.asarray(one.amounts(rest.poses, here, p)[0])
        turn = turn + np.asarray(one.amounts(there, along, p)[0])
        keys += one.keys
        for amounts in by_parameters(one, there, along, p):
            columns.append(np.broadcast_to(np.asarray(amounts[0]), GRID))
    measured = own + (fitted.residual.T * lever).sum(axis=0) / np.maximum(square, 1e-12)
    scale, unit = (DEGREES, "°") if driver.startswith("q") else (1.0, "N·m" if driver.startswith("tau") else "s")
    return DriverCurve(
        driver=driver,
        unit=unit,
        joint=effect.targets[0].partition(".")[0],
        effects=tuple(one.name for one, _ in alike),
        at=grid * scale,
        turn=turn * DEGREES,
        error=_standard_error(fitted, keys, columns) * DEGREES,
        measured_at=values[far] * scale,
        measured=measured[far] * DEGREES,
    )


def driver_of(effect: Effect) -> str:
    """The one quantity that an effect is a function of: `qN`, `tauN` or `t`; empty if there are several, or none."""
    if effect.depends_on == ("time",) and not effect.load_slots:
        return "t"
    if not effect.depends_on and isinstance(effect, LoadedJointEffect):
        return f"tau{effect.joint + 1}"
    if effect.depends_on != ("angle",) or effect.load_slots:
        return ""
    p = [parameter.default or parameter.typical for parameter in effect.parameters]
    rows = by_angles(effect, poses_of(np.full((2, effect.arm.dof), 0.3)), (), p)
    joints = [joint for joint, amounts in enumerate(rows, 1) if not all(map(is_zero, amounts))]
    return f"q{joints[0]}" if len(joints) == 1 else ""


def _driver_values(driver: str, poses: Poses, torque: Array) -> Array:
    if driver == "t":
        return np.zeros(len(poses)) if poses.t is None else poses.t
    return torque if driver.startswith("tau") else poses.q[:, int(driver[1:]) - 1]


def _poses_along(driver: str, poses: Poses, grid: Array) -> Poses:
    """The first pose again and again, with the driver at the values of the grid."""
    q = np.repeat(poses.q[:1], len(grid), axis=0)
    if driver.startswith("q"):
        q[:, int(driver[1:]) - 1] = grid
    return Poses(q, np.zeros(len(grid)), t=grid if driver == "t" else None)


def _felt(effect: Effect, torque: Array) -> Amounts:
    return (torque,) * len(effect.load_slots)


def _standard_error(fitted: Fit, keys: Sequence[str], columns: Sequence[Array]) -> Array:
    """(G,), of the sum of the columns (G,) times the parameters of these keys, as far as they are fitted."""
    row = {key: number for number, key in enumerate(fitted.model.free)}
    known = [(row[key], column) for key, column in zip(keys, columns, strict=True) if key in row]
    if not known:
        return np.zeros(GRID)
    rows, B = [number for number, _ in known], np.stack([column for _, column in known], axis=1)
    variance = np.einsum("gi,ij,gj->g", B, fitted.covariance[np.ix_(rows, rows)], B)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))
