"""Offer of poses to choose from: all combinations of levels that keep clear, under every load."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from lrm_ident.design.candidate_poses import ClearanceRules, candidate_grid
from lrm_ident.design.pose_design import CandidateSet
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.kinematics.poses import Poses

MOST_CANDIDATES = 6000  # more are thinned out at random; the best index hardly changes
Narrowing = Callable[[Array], tuple[Array, str]]
"""From angles (N, n) in rad to those that may be used, and words on them that follow those on the others."""


def every_one(q: Array) -> tuple[Array, str]:
    """Narrowing that keeps all."""
    return q, ""


def clear_poses(
    arm: Arm,
    levels: Sequence[Sequence[float]],
    payloads: Sequence[float],
    rules: ClearanceRules,
    seed: int,
    narrowed: Narrowing = every_one,
) -> CandidateSet:
    """The combinations of levels (rad) that keep the rules, each under every payload (kg). Raises `LrmError`."""
    clear = candidate_grid(arm, levels, rules)
    q, more = narrowed(clear.q)
    words = f"{len(clear.q)} of {clear.tried} combinations of levels keep clear{more}"
    most = MOST_CANDIDATES // len(payloads)
    if len(q) > most:
        q = q[np.sort(np.random.default_rng(seed).choice(len(q), most, replace=False))]
        words += f"; {most} of them, drawn at random, are looked at"
    if not arm.shapes.capsules:
        words += "; the arm has no shapes, so only the lines between its joints were held to the rules"
    every = Poses(np.tile(q, (len(payloads), 1)), np.repeat(payloads, len(q)))
    return CandidateSet(every, words, clear.rejected)
