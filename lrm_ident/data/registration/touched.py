"""Places of touched points, from the arm: positions in its frame, and a check of the reading."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lrm_ident.data.measurements import Measurements
from lrm_ident.data.registration.hypotheses import Hypothesis, joint_hypotheses
from lrm_ident.data.registration.similarity import rigid_motion_between
from lrm_math.arm.arm import Arm
from lrm_math.arm.plausible_arm import reach
from lrm_math.arrays import Array
from lrm_math.errors import NoEquilibrium
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of

MISREAD, BETTER = 0.15, 0.35
"""Share of the reach by which no assembled arm misses points that it touches, and the part of what it misses, as read,
that another reading must come below."""


def in_frame_of_touches(arm: Arm, data: Measurements) -> Measurements:
    """Touched points in the arm's frame, where the arm as drawn comes nearest to them; others as they are."""
    if not data.touched:
        return data
    tcp = data.tcp.copy()
    drawn = solve_equilibrium(model_of(arm, ()), data.poses).tcp
    for number, frame in enumerate(data.touched, start=1):
        rows = data.poses.placement == number
        tcp[rows] = rigid_motion_between(tcp[rows], drawn[rows], frame.turns).apply(tcp[rows])
    return data.with_tcp(tcp)


def misread_touches(arm: Arm, data: Measurements) -> tuple[float, Hypothesis | None] | None:
    """How far the arm as drawn misses the points that it touched (m, RMS), and the simplest reading that it does not
    miss so; None where they can be taken as read."""
    read = Hypothesis(data.source.stated, data.poses.q, np.empty((0, 3)))
    missed = _missed(arm, data, read.q)
    if missed <= MISREAD * reach(arm):
        return None
    explanation = None
    for other in joint_hypotheses(read, arm):
        simpler = explanation is None or other.complexity < explanation.complexity
        if other.words and simpler and _missed(arm, data, other.q) < BETTER * missed:
            explanation = other
    return missed, explanation


def _missed(arm: Arm, data: Measurements, q: Array) -> float:
    """RMS (m) by which the arm as drawn misses the points that it touched, each board where it fits best."""
    try:
        drawn = solve_equilibrium(model_of(arm, ()), replace(data.poses, q=q)).tcp
    except NoEquilibrium:
        return np.inf
    missed = np.zeros_like(drawn)
    for number, frame in enumerate(data.touched, start=1):
        rows = data.poses.placement == number
        missed[rows] = drawn[rows] - rigid_motion_between(data.tcp[rows], drawn[rows], frame.turns).apply(
            data.tcp[rows]
        )
    return float(np.sqrt((missed**2).sum(axis=1).mean()))
