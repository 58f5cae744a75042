"""Check of the reading of distances alone: can an arm have been so far from a point, as they were read or otherwise?"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from lrm_ident.data.measurement_file.conventions import LENGTH_UNITS
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.observations.distances import Distances
from lrm_ident.data.registration.anchor import FEWEST, MAX_RELATIVE_ERROR, trilaterate
from lrm_ident.data.registration.hypotheses import SIMPLE, UNIT_NAMES, Hypothesis, joint_hypotheses
from lrm_ident.data.registration.row_choice import drawn_rows
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.errors import NoEquilibrium
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of

BETTER = 0.4
"""Share of what the arm as drawn misses the distances by, as read, that another reading must come below."""
LEAST, MOST = 3 * FEWEST, 100
"""Distances, else a point that is not known fits whatever; and how many are looked at."""


def misread_distances(arm: Arm, data: Measurements, seen: Distances) -> tuple[float, Hypothesis | None] | None:
    """How far the arm as drawn misses the distances (m, RMS) and the simplest reading that it does not miss so.

    None where they can be taken as read, or where there are too few.
    """
    rows = seen.rows[drawn_rows(len(seen.rows), MOST)]
    if len(rows) < LEAST:
        return None
    poses, distance = data.poses.take(rows), seen.values[rows]
    read = Hypothesis(data.source.stated, poses.q, np.empty((0, 3)))
    missed = _missed(arm, poses, distance, seen.start)
    if missed <= MAX_RELATIVE_ERROR * float(distance.std()):
        return None
    explanation = None
    for other, stretched in _readings(read, arm):
        missed_by_reading = _missed(arm, replace(poses, q=other.q), stretched * distance, seen.start) / stretched
        if missed_by_reading < BETTER * missed and (explanation is None or other.complexity < explanation.complexity):
            explanation = other
    return missed, explanation


def _readings(read: Hypothesis, arm: Arm) -> Iterator[tuple[Hypothesis, float]]:
    """Other joint angles, and the distances in other units by the factor of each."""
    for other in joint_hypotheses(read, arm):
        if other.words:
            yield other, 1.0
    unit_factor = LENGTH_UNITS[read.reading.unit or "mm"]
    for unit, metres in LENGTH_UNITS.items():
        if metres != unit_factor:
            yield read.also(f"the distances look like {UNIT_NAMES[unit]}", SIMPLE, unit=unit), metres / unit_factor


def _missed(arm: Arm, poses: Poses, distance: Array, start: tuple[float, float, float] | None) -> float:
    """RMS (m) by which the arm as drawn misses distances (N,), from the stated point or from the best one."""
    try:
        tcp = solve_equilibrium(model_of(arm, ()), poses).tcp
    except NoEquilibrium:
        return np.inf
    if start is None:
        return trilaterate(tcp, distance)[1]
    return float(np.sqrt(np.mean((np.linalg.norm(tcp - np.array(start), axis=1) - distance) ** 2)))
