"""Empirical terms whose size changes with a joint's angle: beyond its range the model goes back to one without them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lrm_ident.data.measurements import Measurements
from lrm_ident.fitting.levenberg_marquardt import Fit, fit
from lrm_ident.fitting.typical_prior import typical_prior
from lrm_ident.residual.thresholds import Z_THRESHOLD
from lrm_math.arm.place_names import joint_number
from lrm_math.arrays import Array
from lrm_math.effects import Effect, variants
from lrm_math.effects.base import Extrapolation
from lrm_math.effects.measured_range import SLACK
from lrm_math.effects.offsets import Offsets
from lrm_math.effects.reversion import Reversion
from lrm_math.effects.targets import Kind, kind_of
from lrm_math.errors import LrmError
from lrm_math.model.deployed_model import of_a_session
from lrm_math.model.derivatives import parameter_jacobian
from lrm_math.model.model import Model

MAX_VARIANCE_INFLATION = 100.0
"""Square of a column over that of its part that is independent of the others (Marquardt 1970)."""
HALF = 0.5
"""Size of a term, over that within the range, below which the model errs less without it."""


def with_reverting_terms(fitted: Fit, data: Measurements) -> Fit:
    """The fit, whose model's range states which empirical terms end with it, and the model without them.

    A term's size is followed over the angle of each joint, as a line (varying coefficients: Hastie & Tibshirani 1993).
    Where that line, within two standard errors, falls below half at a limit of the joint beyond the measured range,
    leaving the term out errs less there. What else acts on the joints is then fitted without it. A form of an effect
    that the model has refines that, and holds as far; but of a periodic law it shows that the formula is wrong, whose
    period was then measured wrongly, too, and both end with the range of their joint. Where the fit without the term
    fails, there is no model to go back to, and the term holds as far as `Extrapolation.HELD` says.
    """
    model, present = fitted.model, {effect.name for effect in fitted.model.effects}
    if model.within is None:
        return fitted
    terms = [term for term in model.effects if _is_empirical(term)]
    ends_of_terms = {term.name: _ends(fitted, term) for term in terms if present.isdisjoint(variants(term))}
    for form in terms:
        for law in model.effects:
            if law.name in variants(form) and law.extrapolation is Extrapolation.PERIODIC:
                ends_of_terms |= dict.fromkeys((law.name, form.name), _measured(fitted, joint_number(law.place)))
    reverting = {name: ends for name, ends in ends_of_terms.items() if np.isfinite(ends).any()}
    if not reverting:
        return fitted
    try:
        changes = _changes_without(fitted, data, [*reverting])
    except LrmError:
        return fitted
    ends = np.stack([*reverting.values()])
    lower, upper = ends[:, :, 0].max(axis=0), ends[:, :, 1].min(axis=0)
    reversion = Reversion(tuple(reverting), tuple(zip(lower.tolist(), upper.tolist(), strict=True)), changes)
    model = replace(model, within=replace(model.within, reversion=reversion))
    return replace(fitted, model=model, equilibrium=replace(fitted.equilibrium, model=model))


def _is_empirical(effect: Effect) -> bool:
    """Whether it is a free form that acts on the arm."""
    free = effect.is_free_form and effect.extrapolation is Extrapolation.HELD
    return free and not of_a_session(effect) and kind_of(effect) in (Kind.MOTION, Kind.LOAD)


def _measured(fitted: Fit, joint: int) -> Array:
    """(n, 2), the ends of the measured range of one joint (rad) that its limits are beyond, else infinite."""
    model = fitted.model
    ends = np.tile((-np.inf, np.inf), (model.arm.dof, 1))
    assert model.within is not None
    limits, measured = model.arm.joints[joint], model.within.angle[joint]
    slack = SLACK * (measured[1] - measured[0])
    if limits.lower < measured[0] - slack:
        ends[joint, 0] = measured[0]
    if limits.upper > measured[1] + slack:
        ends[joint, 1] = measured[1]
    return ends


def _ends(fitted: Fit, term: Effect) -> Array:
    """(n, 2), angles of each joint (rad) between which a term holds, infinite where it holds beyond, too."""
    model, poses = fitted.model, fitted.equilibrium.poses
    ends = np.tile((-np.inf, np.inf), (model.arm.dof, 1))
    seen, keys = np.isfinite(fitted.residual).all(axis=1), [key for key in term.keys if key in model.free]
    if not keys or not seen.any() or model.within is None:
        return ends
    J = parameter_jacobian(fitted.equilibrium, model.free)[seen]
    columns, moved = J.reshape(-1, len(model.free)), J @ _only(model, keys)
    independent, _ = np.linalg.qr(columns / np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny))
    residual = _beside(independent, fitted.residual[seen].ravel())
    for joint, (limits, measured) in enumerate(zip(model.arm.joints, model.within.angle, strict=True)):
        angle = poses.q[seen, joint]
        over = moved * (angle - angle.mean())[:, None]
        column = _beside(independent, over.ravel())
        whole, size = (float(np.linalg.norm(each)) for each in (over, column))
        if whole**2 >= MAX_VARIANCE_INFLATION * size**2:  # it follows this angle itself
            continue
        slope, error = float(column @ residual) / size**2, fitted.sigma / size
        for side, (limit, end) in enumerate(zip((limits.lower, limits.upper), measured, strict=True)):
            beyond, far = abs(limit - end) > SLACK * (measured[1] - measured[0]), limit - angle.mean()
            outside = beyond and (limit < end if side == 0 else limit > end)
            if outside and 1.0 + slope * far + Z_THRESHOLD * error * abs(far) < HALF:
                ends[joint, side] = end
    return ends


def _only(model: Model, keys: Sequence[str]) -> Array:
    """(P,), values of the free parameters, zero of all but some."""
    return np.array([model.value(key) if key in keys else 0.0 for key in model.free])


def _beside(independent: Array, column: Array) -> Array:
    return np.asarray(column - independent @ (independent.T @ column))


def _changes_without(fitted: Fit, data: Measurements, terms: Sequence[str]) -> dict[str, float]:
    """Changes of parameters (SI) when terms are left out: theirs, and those of what else acts on the joints alone."""
    model, gone = fitted.model, {key for effect in fitted.model.effects if effect.name in terms for key in effect.keys}
    slots = {*model.chain.joint_slots}
    refitted = {
        key
        for bound in model.binding.bound
        if bound.kind in (Kind.MOTION, Kind.LOAD) and not of_a_session(bound.effect)
        for key, k in zip(bound.effect.keys, _slots(bound.effect, bound.slots), strict=True)
        if k <= slots and key in model.free and key not in gone
    }
    without = model.with_values_of([*gone], [0.0] * len(gone)).with_free(key for key in model.free if key in refitted)
    if refitted:
        without = fit(without, data, loss=fitted.loss, prior=typical_prior(without)).model
    changes = {key: without.value(key) - model.value(key) for key in model.keys if key in gone | refitted}
    return {key: change for key, change in changes.items() if change}


def _slots(effect: Effect, slots: tuple[int, ...]) -> list[set[int]]:
    """The slots that each parameter of an effect acts on."""
    if isinstance(effect, Offsets):
        return [{slot} for slot in slots]
    return [{*slots}] * len(effect.keys)
