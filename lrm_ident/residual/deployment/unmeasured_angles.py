"""Error of each joint that the measured angles leave open: how large it may be where the joint was not measured."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_math.arrays import Array
from lrm_math.effects.curves import TYPICAL
from lrm_math.effects.measured_range import UnmeasuredAngles
from lrm_math.model.derivatives import joint_jacobian

APART = np.radians(2.5)
"""rad: measured angles that are nearer are kept as one."""
LEVEL = np.radians(10.0)
"""rad: angles of one level, as far apart as the knots of a curve over an angle."""


def with_unmeasured_angles(fitted: Fit) -> Fit:
    """The fit, whose model's range states what its poses leave open of each joint's error.

    The size of that error has the prior of the catalogue's curves, of one degree of freedom. Levels of the joint beyond
    those that its own parameters need update it, by the variance of the residual between them (inverse chi-squared;
    Gelman et al. 2013, section 2.6). What a free form found counts as such an error: no formula foresaw it.
    """
    model, poses = fitted.model, fitted.equilibrium.poses
    if model.within is None or not len(poses):
        return fitted
    J = joint_jacobian(fitted.equilibrium)
    size = tuple(_size(fitted, J[:, :, joint], joint) for joint in range(model.arm.dof))
    unmeasured = UnmeasuredAngles(tuple(map(_distinct, poses.q.T)), size)
    ranged = replace(model, within=replace(model.within, unmeasured=unmeasured))
    return replace(fitted, model=ranged, equilibrium=replace(fitted.equilibrium, model=ranged))


def _distinct(angle: Array) -> tuple[float, ...]:
    """Some of the angles, ascending, so that each is within `APART` of one."""
    kept = list[float]()
    for level in np.unique(angle).tolist():
        if not kept or level - kept[-1] > APART:
            kept.append(level)
    return tuple(kept)


def _size(fitted: Fit, J: Array, joint: int) -> float:
    """Standard deviation of a joint's unknown error (rad); J (N, 3): ∂TCP/∂q of it."""
    by_forms, by_model = _found_by_free_forms(fitted, joint)
    seen = np.isfinite(fitted.residual).all(axis=1)
    J, residual = J[seen], fitted.residual[seen] + J[seen] * by_forms[seen, None]
    at = _levels(fitted.equilibrium.poses.q[seen, joint])
    weights = np.bincount(at, (J * J).sum(axis=1))
    error = np.divide(
        np.bincount(at, (J * residual).sum(axis=1)), weights, out=np.zeros_like(weights), where=weights > 0.0
    )
    variance = np.divide(fitted.sigma**2, weights, out=np.full_like(weights, np.inf), where=weights > 0.0)
    told = TYPICAL**2 / (TYPICAL**2 + variance)
    excess = (told * (error**2 - np.where(told > 0.0, variance, 0.0))).sum()
    freedom = max(float(told.sum()) - by_model, 0.0)
    return float(np.sqrt((TYPICAL**2 + max(float(excess), 0.0)) / (1.0 + freedom)))


def _levels(angle: Array) -> NDArray[np.int64]:
    """(N,), number of the level of each angle."""
    return np.unique(np.round(angle / LEVEL), return_inverse=True)[1].reshape(-1)


def _found_by_free_forms(fitted: Fit, joint: int) -> tuple[Array, int]:
    """(N,), error of a joint that free forms found (rad); number of its parameters that have a formula, and a zero."""
    model, equilibrium = fitted.model, fitted.equilibrium
    slot, forms_error, own_size = model.chain.joint_slots[joint], np.zeros(len(equilibrium.poses)), 1
    for bound in model.binding.bound:
        if "angle" in bound.effect.depends_on and slot in bound.slots:
            if bound.effect.is_free_form:
                amounts = bound.at(equilibrium.poses, bound.own_loads(equilibrium.tau))
                forms_error = forms_error + amounts[bound.slots.index(slot)]
            else:
                own_size += sum(key in model.free for key in bound.effect.keys)
    return forms_error - forms_error.mean(), own_size
