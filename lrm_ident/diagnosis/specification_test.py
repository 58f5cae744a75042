"""Specification test (Ramsey 1969) of an effect's place and amount: does what it follows move the arm otherwise, too?

Then its place, or its cause, is not identified.

A cause that the catalogue lacks is imitated by an effect that follows the same quantity at another place: a bearing
that nods by a coupling of the next joint, a cable that drags a joint by friction in the joint before it. What is not
imitated still follows that quantity. So functions of it at every other slot of the chain are tried beside the effect,
as a regression is tried with functions of its own terms, and judged as effects are.

A zero of a joint that moves in time does so alike at all its angles. Where its amount follows the angle (a varying
coefficient: Hastie & Tibshirani 1993), something else changes there: play that grows, a gear that wears. A few poses
may show that, so its F test decides, with a share of the error at unseen poses.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterator, Mapping

import numpy as np

from lrm_ident.data.measurements import Measurements
from lrm_ident.data.weights.whitening import RowWeights
from lrm_ident.diagnosis.contradiction import followed_joint
from lrm_ident.diagnosis.screening.linearised_fit import LinearEstimate, LinearisedFit
from lrm_ident.diagnosis.screening.screen import linearised, rows_to_screen
from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_ident.residual.better_prediction import falls_by_share, predicts_better
from lrm_ident.residual.significance import f_test_p_value
from lrm_ident.residual.thresholds import MIN_GAIN, SIGNIFICANCE
from lrm_math.arm.place_names import joint_number, joint_numbers
from lrm_math.arrays import Array
from lrm_math.effects import Effect
from lrm_math.effects.targets import Kind
from lrm_math.model.deployed_model import of_a_session
from lrm_math.model.derivatives import respond
from lrm_math.model.effect_binding import BoundEffect

HARMONICS = (1, 2)
"""Waves a turn of functions of an angle: bearings and gears err once and twice a turn (ISO 230-7)."""
TYPICAL_ANGLE, TYPICAL_SHIFT = 0.02, 1e-3  # rad, m


def misspecified_effects(fitted: Fit, data: Measurements, names: Collection[str]) -> tuple[str, ...]:
    """Those of a model's effects (`effect@place`) whose quantity moves the arm at another slot, too.

    So are passing zeros of a joint whose amount follows its angle. Of effects that move one slot alone; others act at
    several places anyway, and are not tested.
    """
    effects = [bound_effect for bound_effect in fitted.model.binding.bound if bound_effect.effect.name in names]
    bound = [
        bound_effect for bound_effect in effects if bound_effect.kind is Kind.MOTION and len(bound_effect.slots) == 1
    ]
    if not bound:
        return ()
    screened = rows_to_screen(fitted)
    part, rows = fitted.take(screened), data.take(screened)
    weigh = RowWeights(rows.whitening, part.weight)
    linear = linearised(part, rows, weigh)
    motions = respond(part.equilibrium, rows.whitening.sensed).slots
    sizes = np.where(part.model.chain.rotates, TYPICAL_ANGLE, TYPICAL_SHIFT)

    def columns(slot: int, followed: Array) -> Array:
        moved = motions[slot].T[:, :, None] * followed[:, None, :] * sizes[slot]
        return weigh(moved.reshape(-1, followed.shape[1]))

    def tried(beside: LinearisedFit, sets: Mapping[int, Array]) -> Iterator[tuple[float, LinearEstimate]]:
        """Functions (N, m) of each slot beside a fit: p value of their F test, of so many, and their estimate."""
        sizes_of = [functions.shape[1] for functions in sets.values()]
        estimates = beside.explain_each(beside.project_each(itertools.starmap(columns, sets.items()), sizes_of))
        before, freedom = beside.baseline.in_sample, beside.degrees_of_freedom
        for size, after in zip(sizes_of, estimates, strict=True):
            yield f_test_p_value(before, after.in_sample, size, freedom) * len(sizes_of), after

    def acts_elsewhere(effect: BoundEffect) -> bool:
        """Whether functions of what it follows explain more at another slot, significantly and at unseen poses."""
        followed, own_slot = _followed(effect, part), effect.slots[0]
        beside = linear.beside(linear.project(columns(own_slot, followed)))
        others = {slot: followed for slot in range(len(motions)) if slot != own_slot and motions[slot].any()}
        return any(
            p_value < SIGNIFICANCE and predicts_better(after.held_out, beside.baseline.held_out, MIN_GAIN)
            for p_value, after in tried(beside, others)
        )

    def follows_the_angle(effect: BoundEffect) -> bool:
        """Whether the amount of a joint's passing zero follows the joint's angle."""
        if not _is_passing_zero(effect.effect):
            return False
        followed, slot = _followed(effect, part), effect.slots[0]
        waves = _waves(part.equilibrium.poses.q[:, joint_number(effect.effect.place)])
        beside = linear.beside(linear.project(columns(slot, np.hstack([followed, waves]))))
        [(p_value, after)] = tried(beside, {slot: followed * waves})
        return p_value < SIGNIFICANCE and falls_by_share(after.held_out, beside.baseline.held_out, MIN_GAIN)

    return tuple(effect.effect.name for effect in bound if acts_elsewhere(effect) or follows_the_angle(effect))


def _is_passing_zero(effect: Effect) -> bool:
    """Whether it is a zero of one joint that moves with the time or between sessions."""
    return of_a_session(effect) and not effect.remembers and len(joint_numbers(effect.place)) == 1


def _followed(effect: BoundEffect, fitted: Fit) -> Array:
    """(N, m), functions of what an effect follows: harmonics of a joint's angle, else its own amount, at most 1."""
    poses, joint = fitted.equilibrium.poses, followed_joint(effect.effect)
    if joint is not None:
        angle = poses.q[:, joint]
        return _waves(angle)
    [(_, amount)] = effect.amounts(poses, fitted.equilibrium.tau)
    amounts = np.broadcast_to(amount, len(poses)).astype(float)
    return (amounts / max(float(np.abs(amounts).max()), np.finfo(float).tiny))[:, None]


def _waves(angle: Array) -> Array:
    """(N, m), harmonics of angles (N,), rad."""
    return np.stack([wave(count * angle) for count in HARMONICS for wave in (np.cos, np.sin)], axis=1)
