"""Point-set registration: an arm's positions and measured ones, brought together and scored by the coarse fit."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lrm_ident.data.registration.coarse_fit import coarse_fit
from lrm_ident.data.registration.hypotheses import Hypothesis
from lrm_ident.data.registration.similarity import Similarity, robust_similarity
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.effects.reference import BASE_OFFSETS, ParameterRef
from lrm_math.errors import NoEquilibrium
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import Equilibrium, solve_equilibrium
from lrm_math.model.model import model_of
from lrm_math.model.reading import Reading

REGISTRATIONS = 2
LIKE_BASE = ("offsets.joint1.theta_rad", "offsets.joint1.d_mm")
"""They move all tips as a base does that turns about the first axis, or slides along it."""


@dataclass(frozen=True)
class ScoredReading:
    """A hypothesis and how far its coarse fit misses.

    Attributes:
        score: `trimmed_rms` of the distances (m).
        spread: RMS distance of the nominal arm's positions from their centre (m).
        overdetermined: whether there are enough poses for a coarse fit to miss at all.
    """

    hypothesis: Hypothesis
    score: float
    spread: float
    overdetermined: bool

    @property
    def share(self) -> float:
        """Score over spread."""
        return self.score / self.spread


@dataclass(frozen=True, eq=False)
class PointSet:
    """Joint angles and positions of some measurements as read, and how: units stated, never a known frame."""

    arm: Arm
    poses: Poses
    tcp: Array
    reading: Reading

    @property
    def as_read(self) -> Hypothesis:
        """The hypothesis that nothing was mistaken."""
        return Hypothesis(self.reading, self.poses.q, self.tcp)

    def scored(self, hypothesis: Hypothesis) -> ScoredReading:
        """A hypothesis, scored by the coarse fit with the angles and positions that it makes of these."""
        poses, free = replace(self.poses, q=hypothesis.q), hypothesis.reading.frame == "unknown"
        seen = registered(self.arm, poses, hypothesis.tcp)[0] if free else hypothesis.tcp
        nominal = nominal_tcp(self.arm, poses)
        fit = coarse_fit(self.arm, poses, seen, fixed_base=free)
        return ScoredReading(hypothesis, fit.score, spread_of(nominal), fit.overdetermined)


def registered(arm: Arm, poses: Poses, tcp: Array) -> tuple[Array, Similarity]:
    """Positions (N, 3) in the arm's frame (m), and the rigid motion that takes them there.

    Registration (Kabsch 1976) and coarse fit of the arm's dimensions alternate. The fit moves the base, too, which is
    then put back: the arm's sag, or a turn of joint 1, would else be taken for a place of the base.
    """
    goal = nominal_tcp(arm, poses)
    for _ in range(REGISTRATIONS):
        motion = robust_similarity(tcp, goal, mirrored=False, scale=1.0)
        goal = _on_drawn_base(coarse_fit(arm, poses, motion.apply(tcp), any_target=True).equilibrium)
    motion = robust_similarity(tcp, goal, mirrored=False, scale=1.0)
    return motion.apply(tcp), motion


def _on_drawn_base(fitted: Equilibrium) -> Array:
    """(N, 3), TCP (m) of a fitted arm whose base stands as drawn; as fitted if it would not settle there."""
    model, poses = fitted.model, fitted.poses
    keys = [key for key in model.keys if ParameterRef.parse(key).effect == BASE_OFFSETS or key in LIKE_BASE]
    try:
        return solve_equilibrium(model.with_values_of(keys, np.zeros(len(keys))), poses).tcp
    except NoEquilibrium:  # of a misread file the fit is at its bounds
        return fitted.tcp


def nominal_tcp(arm: Arm, poses: Poses) -> Array:
    """(N, 3), TCP of the arm as drawn (m)."""
    return solve_equilibrium(model_of(arm, ()), poses).tcp


def spread_of(points: Array) -> float:
    """RMS distance of points (N, 3) from their centre (m)."""
    return float(np.sqrt(((points - points.mean(axis=0)) ** 2).sum(axis=1).mean()))
