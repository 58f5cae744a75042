"""Specification test (Ramsey 1969) of an effect's place: does what it follows move the arm elsewhere, too?

Then its place is not identified.

A cause that the catalogue lacks is imitated by an effect that follows the same quantity at another place: a bearing
that nods by a coupling of the next joint, a cable that drags a joint by friction in the joint before it. What is not
imitated still follows that quantity. So functions of it at every other slot of the chain are tried beside the effect,
as a regression is tried with functions of its own terms, and judged as effects are.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from lrm_ident.data.measurements import Measurements
from lrm_ident.data.weights.whitening import RowWeights
from lrm_ident.diagnosis.contradiction import followed_joint
from lrm_ident.diagnosis.screening.screen import linearised, rows_to_screen
from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_ident.residual.better_prediction import predicts_better
from lrm_ident.residual.significance import f_test_p_value
from lrm_ident.residual.thresholds import MIN_GAIN, SIGNIFICANCE
from lrm_math.arrays import Array
from lrm_math.effects.targets import Kind
from lrm_math.model.derivatives import respond
from lrm_math.model.effect_binding import BoundEffect

HARMONICS = (1, 2)
"""Waves a turn of functions of an angle: bearings and gears err once and twice a turn (ISO 230-7)."""
TYPICAL_ANGLE, TYPICAL_SHIFT = 0.02, 1e-3  # rad, m


def misspecified_effects(fitted: Fit, data: Measurements, names: Collection[str]) -> tuple[str, ...]:
    """Those of a model's effects (`effect@place`) whose quantity moves the arm at another slot, too.

    Of effects that move one slot alone; others act at several places anyway, and are not tested.
    """
    effects = [one for one in fitted.model.binding.bound if one.effect.name in names]
    bound = [one for one in effects if one.kind is Kind.MOTION and len(one.slots) == 1]
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

    def misspecified(one: BoundEffect) -> bool:
        """Whether functions of what it follows explain more at another slot, significantly and at unseen poses."""
        followed, own = _followed(one, part), one.slots[0]
        beside = linear.beside(linear.project(columns(own, followed)))
        others = [slot for slot in range(len(motions)) if slot != own and motions[slot].any()]
        tried = beside.project_each((columns(slot, followed) for slot in others), [followed.shape[1]] * len(others))
        before, freedom = beside.baseline, beside.degrees_of_freedom
        return any(
            f_test_p_value(before.in_sample, after.in_sample, followed.shape[1], freedom) * len(others) < SIGNIFICANCE
            and predicts_better(after.held_out, before.held_out, MIN_GAIN)
            for after in beside.explain_each(tried)
        )

    return tuple(one.effect.name for one in bound if misspecified(one))


def _followed(one: BoundEffect, fitted: Fit) -> Array:
    """(N, m), functions of what an effect follows: harmonics of a joint's angle, else its own amount, at most 1."""
    poses, joint = fitted.equilibrium.poses, followed_joint(one.effect)
    if joint is not None:
        angle = poses.q[:, joint]
        return np.stack([wave(count * angle) for count in HARMONICS for wave in (np.cos, np.sin)], axis=1)
    [(_, amount)] = one.amounts(poses, fitted.equilibrium.tau)
    amounts = np.broadcast_to(amount, len(poses)).astype(float)
    return (amounts / max(float(np.abs(amounts).max()), np.finfo(float).tiny))[:, None]
