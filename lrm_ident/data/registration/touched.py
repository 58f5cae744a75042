"""Places of touched points, from the arm: positions in its frame, a start for the fit, and a check of the reading."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lrm_ident.data.measurements import Measurements
from lrm_ident.data.registration.hypotheses import Hypothesis, joint_hypotheses
from lrm_ident.data.registration.similarity import Similarity, robust_similarity
from lrm_ident.data.rigid_motion import skew, to_xyz_angles
from lrm_math.arm.arm import Arm
from lrm_math.arm.plausible_arm import reach
from lrm_math.arrays import Array
from lrm_math.effects import Effect
from lrm_math.effects.tracker_errors import TouchedBoard, TouchedPoint
from lrm_math.errors import NoEquilibrium
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of

LINE = 1e-3
"""m: points that lie nearer to one line do not show a turn about it."""
MISREAD, BETTER = 0.15, 0.35
"""Share of the reach by which no assembled arm misses points that it touches, and the part of what it misses, as read,
that another reading must come below."""


def rigid_motion_between(source: Array, target: Array, turns: bool) -> Similarity:
    """The rigid motion that takes points (N, 3) to others (m): a shift of what does not turn, else by Kabsch 1976; the
    smallest one of points on a line."""
    centre, goal = source.mean(axis=0), target.mean(axis=0)
    rotation = np.eye(3)
    if turns:
        _, size, Vt = np.linalg.svd(source - centre)
        if size[1] > LINE:
            return robust_similarity(source, target, mirrored=False, scale=1.0)
        if size[0] > LINE:
            rotation = _smallest_turn(Vt[0], (target - goal).T @ ((source - centre) @ Vt[0]))
    return Similarity(rotation, goal - rotation @ centre)


def _smallest_turn(first: Array, second: Array) -> Array:
    """(3, 3), rotation of one direction to another."""
    u, v = first / np.linalg.norm(first), second / np.linalg.norm(second)
    K, cosine = skew(np.cross(u, v)), float(u @ v)
    return np.asarray(np.eye(3) + K + K @ K / max(1.0 + cosine, 1e-9))


def in_frame_of_touches(arm: Arm, data: Measurements) -> Measurements:
    """Touched points in the arm's frame, where the arm as drawn comes nearest to them; others as they are."""
    if not data.touched:
        return data
    tcp = data.tcp.copy()
    drawn = solve_equilibrium(model_of(arm, ()), data.poses).tcp
    for number, frame in enumerate(data.touched, start=1):
        rows = data.poses.placement == number
        tcp[rows] = rigid_motion_between(tcp[rows], drawn[rows], frame.turns).apply(tcp[rows])
    return replace(data, tcp=tcp)


def with_touched(model: Model, data: Measurements) -> Model:
    """The model, knowing where what was touched stood; as it is where nothing was, or where it was fitted to these.

    Each place is the one from which the model's own TCPs touch best, and its numbers are free parameters.
    """
    kinds = [TouchedBoard if frame.turns else TouchedPoint for frame in data.touched]
    needed = [kind(model.arm, f"placement{number}") for number, kind in enumerate(kinds, start=1)]
    keys = [key for effect in needed for key in effect.keys]
    there = set(model.keys)
    known = all(key in there and model.value(key) != 0.0 for key in keys)
    if not needed or (known and model.fitted_to in (None, data.source.sha256)):
        return model
    kept: list[Effect] = [effect for effect in model.effects if not isinstance(effect, TouchedPoint)]
    values = {key: model.value(key) for effect in kept for key in effect.keys}
    arm_only = replace(model_of(model.arm, kept, values), within=model.within)
    touching = solve_equilibrium(arm_only, data.poses).tcp
    for number, (effect, frame) in enumerate(zip(needed, data.touched, strict=True), start=1):
        rows = data.poses.placement == number
        motion = Similarity(np.eye(3), np.zeros(3))
        if rows is not None and np.any(rows):
            motion = rigid_motion_between(touching[rows], data.tcp[rows], frame.turns)
        numbers = (*motion.translation.tolist(), *to_xyz_angles(motion.rotation))
        values |= dict(zip(effect.keys, numbers, strict=False))
    free = [key for key in model.free if key in values or key in keys]
    extended = replace(model_of(model.arm, (*kept, *needed), values), within=model.within, fitted_to=model.fitted_to)
    return replace(extended, state=model.state, free=tuple(dict.fromkeys([*free, *keys])) if model.free else ())


def misread_touches(arm: Arm, data: Measurements) -> tuple[float, Hypothesis | None] | None:
    """How far the arm as drawn misses the points that it touched (m, RMS), and the simplest reading that it does not
    miss so; None where they can be taken as read."""
    read = Hypothesis(data.source.stated, data.poses.q, np.empty((0, 3)))
    missed = _missed(arm, data, read.q)
    if missed <= MISREAD * reach(arm):
        return None
    found = None
    for other in joint_hypotheses(read, arm):
        simpler = found is None or other.complexity < found.complexity
        if other.words and simpler and _missed(arm, data, other.q) < BETTER * missed:
            found = other
    return missed, found


def _missed(arm: Arm, data: Measurements, q: Array) -> float:
    """RMS (m) by which the arm as drawn misses the points that it touched, each board where it fits best."""
    try:
        drawn = solve_equilibrium(model_of(arm, ()), replace(data.poses, q=q)).tcp
    except NoEquilibrium:
        return np.inf
    left = np.zeros_like(drawn)
    for number, frame in enumerate(data.touched, start=1):
        rows = data.poses.placement == number
        left[rows] = drawn[rows] - rigid_motion_between(data.tcp[rows], drawn[rows], frame.turns).apply(data.tcp[rows])
    return float(np.sqrt((left**2).sum(axis=1).mean()))
