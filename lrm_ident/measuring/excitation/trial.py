"""Moves tried before they are proposed: simulated readings of an arm with one effect, and what the diagnosis says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lrm_ident.measuring.motion.joint_fit import fit_joint
from lrm_ident.measuring.motion.joint_moves import JointMoves, predicted
from lrm_ident.measuring.motion.screening import JointScreening, screen_joint
from lrm_math.motion.base import MotionEffect
from lrm_math.motion.motion_model import MotionModel


@dataclass(frozen=True)
class EffectTrial:
    """What the diagnosis says where one effect is there with its usual size.

    Attributes:
        named: the effect that it names; None: it finds nothing. equivalent: names that it gives beside that one.
        left: held-out error with each rival in its place, over the noise, by name; NaN where it was not even tried.
    """

    effect: str
    named: str | None
    equivalent: tuple[str, ...]
    left: dict[str, float]

    def told_from(self, rival: str) -> bool:
        """Whether it is named, and the rival is not."""
        return self.named == self.effect and rival not in self.equivalent


def trials(
    model: MotionModel,
    rivals: Sequence[MotionEffect],
    data: JointMoves,
    noise: float,
    rng: np.random.Generator,
) -> tuple[EffectTrial, ...]:
    """One trial for each of some effects of one joint. `noise`: of a reading, rad or m."""
    effects_of_joint = model.of_joint(rivals[0].joint)
    catalogue = tuple(type(effect) for effect in (*effects_of_joint, *rivals))
    out = []
    for effect in rivals:
        values = [model.values[key] for effect_of_joint in effects_of_joint for key in effect_of_joint.keys] + [
            p.typical for p in effect.parameters
        ]
        angle = predicted((*effects_of_joint, effect), np.array([values]), data.drive, data.substeps)[0]
        target = data.lever * angle[..., None]
        read = replace(data, target=target + rng.normal(scale=noise, size=target.shape))
        before = fit_joint(effects_of_joint, read, model.values)
        out.append(_trial(effect, screen_joint(before, noise, catalogue, len(rivals)), noise))
    return tuple(out)


def _trial(effect: MotionEffect, screening: JointScreening, noise: float) -> EffectTrial:
    errors = {
        candidate.effect.name: np.nan if candidate.held_out is None else candidate.held_out / noise
        for candidate in screening.candidates
    }
    first = screening.first
    return EffectTrial(effect.name, None if first is None else first.effect.name, screening.equivalent, errors)
