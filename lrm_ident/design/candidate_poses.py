"""Candidate poses: the full grid of joint levels, less those that break a clearance rule.

Rules of the thesis (section 5.2): bodies stay 3 cm apart, the tool 16 cm from the inner arm and from what it is mounted
on, and nothing goes below the table. Bodies are the shapes of the arm's file; for an arm without shapes, the lines
between its joints. Frames are those of the nominal arm: the margins have to cover its sag.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from lrm_ident.design.pose_design import CandidateSet, ClearAngles
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.collision.distance import segment_to_box, segment_to_segment
from lrm_math.collision.scene import Scene, clearance_of
from lrm_math.errors import LrmError, UnknownName
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.forward import frames
from lrm_math.kinematics.poses import Poses

DEFAULT_LEVELS = 5
MAX_COMBINATIONS = 300_000
NEAR_LINKS = 4  # the last links, which the tool can fold back upon but never leave; their shapes keep it clear
MOST_CANDIDATES = 6000  # more are thinned out at random; the best index hardly changes
ANY, MOST_DRAWS, RANDOM_CANDIDATES = "any", 40, 1000
"""Levels of joints that may stand anywhere, as where nobody states any: few levels leave open how a joint errs between
them. How often poses are drawn for that; how many are offered."""
Narrowing = Callable[[Array], Array]
"""From angles (N, n) in rad to those that may be used."""


@dataclass(frozen=True)
class ClearanceRules:
    """Minimum distances (m): between bodies, of the TCP from the inner links and from boxes; and the lowest z.

    `floor` may be None where nothing is known of a table, or where a box of the arm's file is the table.
    """

    body_distance: float = 0.03
    tcp_distance: float = 0.16
    floor: float | None = None


APART = ClearanceRules.body_distance


def floor_above_table(arm: Arm, apart: float = APART) -> float | None:
    """Lowest z (m) that is `apart` above the table that the arm's file states; None if it states none."""
    return None if arm.table is None else arm.table + apart


@dataclass(frozen=True, eq=False)
class CandidateGrid:
    """Angles (N, n) in rad that keep the rules, of `tried` combinations; how many each rule rejected, by its name."""

    q: Array
    tried: int
    rejected: dict[str, int]


def parse_levels(arm: Arm, text: str = ANY) -> tuple[tuple[float, ...], ...]:
    """The levels of every joint (rad) from text such as `5`, `-100,0,100` or `5; joint2=-50,0,50; joint6=3`.

    One number is a count of levels, evenly from limit to limit; several are angles in deg; `any` gives no levels.

    Raises:
        LrmError: text that cannot be parsed, or an angle beyond a joint's limits. UnknownName: no such joint.
    """
    if text.strip() == ANY:
        return ()
    by_joint: dict[str, str] = {}
    for part in text.split(";"):
        place, equals, angles = part.strip().rpartition("=")
        if equals and place.strip() not in arm.joint_names:
            raise UnknownName("joint", place.strip(), arm.joint_names)
        by_joint[place.strip()] = angles.strip()
    default = by_joint.get("", str(DEFAULT_LEVELS))
    return tuple(_levels(arm, i, by_joint.get(name, default)) for i, name in enumerate(arm.joint_names))


def _levels(arm: Arm, i: int, text: str) -> tuple[float, ...]:
    joint, expected = arm.joints[i], "give a count such as 5, or angles in deg such as -100,0,100"
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        raise LrmError(f"levels of joint {i + 1}: '{text}' is not a list of numbers; {expected}") from None
    if len(numbers) == 1 and numbers[0] == round(numbers[0]) and numbers[0] >= 1:
        return tuple(np.linspace(joint.lower, joint.upper, int(numbers[0])).tolist()) if numbers[0] > 1 else (0.0,)
    angles = np.radians(numbers)
    if len(numbers) < 2 or np.any(angles < joint.lower - 1e-9) or np.any(angles > joint.upper + 1e-9):
        low, high = np.degrees([joint.lower, joint.upper])
        raise LrmError(f"levels of joint {i + 1}: '{text}'; {expected}, within {low:g} to {high:g} deg")
    return tuple(angles.tolist())


def candidate_grid(arm: Arm, levels: Sequence[Sequence[float]], rules: ClearanceRules | None = None) -> CandidateGrid:
    """Every combination of levels that keeps the rules.

    Raises:
        LrmError: more than `MAX_COMBINATIONS`, or none that keeps the rules.
    """
    count = int(np.prod([len(angles) for angles in levels]))
    if count > MAX_COMBINATIONS:
        raise LrmError(f"{count} combinations of levels; at most {MAX_COMBINATIONS} are checked, take --levels {ANY}")
    q = np.array(list(product(*levels)), dtype=np.float64)
    violated = violated_rules(arm, q, rules or ClearanceRules())
    good = _none_of(violated, len(q))
    if not good.any():
        worst = max(violated, key=lambda name: int(violated[name].sum()))
        raise LrmError(f"none of {count} combinations of levels keeps the rules; most break: {worst}")
    return CandidateGrid(q[good], count, {name: int(rows.sum()) for name, rows in violated.items()})


def random_poses(arm: Arm, count: int, rules: ClearanceRules, seed: int) -> Array:
    """(K, n), at most `count` angles (rad), drawn evenly between the limits, that keep the rules."""
    rng = np.random.default_rng(seed)
    low, high = np.array([(joint.lower, joint.upper) for joint in arm.joints]).T
    accepted = np.empty((0, arm.dof))
    for _ in range(MOST_DRAWS):
        if len(accepted) >= count:
            break
        q = rng.uniform(low, high, size=(2 * count, arm.dof))
        accepted = np.concatenate([accepted, q[keeps_rules(arm, q, rules)]])
    return accepted[:count]


def keeps_rules(arm: Arm, q: Array, rules: ClearanceRules) -> NDArray[np.bool_]:
    """(N,), which of the angles (N, n) violate no rule."""
    return _none_of(violated_rules(arm, q, rules), len(q))


def _none_of(violated: dict[str, NDArray[np.bool_]], count: int) -> NDArray[np.bool_]:
    return np.asarray(~np.any([np.zeros(count, dtype=np.bool_), *violated.values()], axis=0))


def lowest_point(arm: Arm, q: Array) -> float:
    """Lowest z (m) of joints and TCP at angles (N, n), rad."""
    return float(_points(arm, q)[1][:, 1:, 2].min())


def _points(arm: Arm, q: Array) -> tuple[Array, Array]:
    """Frames (N, n + 2, 4, 4) of the links and their origins (N, n + 2, 3), m."""
    chain = chain_of(arm)
    placed = frames(chain, chain.values(list(np.ascontiguousarray(q.T))), len(q))
    return placed, placed[:, :, :3, 3]


def violated_rules(arm: Arm, q: Array, rules: ClearanceRules) -> dict[str, NDArray[np.bool_]]:
    """Violations of every rule: which of the angles (N, n) violate it (N,)."""
    link_frames, points = _points(arm, q)
    violated, near = {}, f"the TCP within {rules.tcp_distance * 1e3:g} mm"
    if len(arm.links) > NEAR_LINKS:
        violated[f"{near} of an inner link"] = _tcp_to_links(points) < rules.tcp_distance
    if arm.shapes.capsules:
        scene = Scene.of(arm)
        bodies = clearance_of(scene, link_frames).distance
        violated[f"bodies within {rules.body_distance * 1e3:g} mm"] = bodies < rules.body_distance
        violated[f"{near} of a box"] = _tcp_to_boxes(scene, points[:, -1]) < rules.tcp_distance
    if rules.floor is not None:
        violated[f"below z = {rules.floor * 1e3:g} mm"] = points[:, 1:, 2].min(axis=1) < rules.floor
    return violated


def _tcp_to_links(points: Array) -> Array:
    """(N,), distance of the TCP from the lines between the frames of the base and the inner joints (N, n + 2, 3)."""
    inner, tcp = points[:, : points.shape[1] - 1 - NEAR_LINKS], points[:, -1:]
    return np.asarray(segment_to_segment(inner[:, :-1], inner[:, 1:], tcp, tcp).min(axis=1))


def _tcp_to_boxes(scene: Scene, tcp: Array) -> Array:
    """(N,), distance of the TCP (N, 3) from the nearest box (m); infinite where there is none."""
    nearest = np.full(len(tcp), np.inf)
    for rotation, centre, half in zip(scene.box_rotation, scene.box_centre, scene.box_half, strict=True):
        local = (tcp - centre) @ rotation
        nearest = np.minimum(nearest, segment_to_box(local, local, np.broadcast_to(half, local.shape)))
    return nearest


def _at_any_angles(arm: Arm, count: int, rules: ClearanceRules, seed: int) -> CandidateGrid:
    """At most `count` random poses that keep the rules. Raises `LrmError`: none does."""
    q = random_poses(arm, count, rules, seed)
    if not len(q):
        raise LrmError("no random pose keeps the rules: give --levels, or smaller distances")
    return CandidateGrid(q, len(q), {})


def clear_poses(
    arm: Arm,
    levels: Sequence[Sequence[float]],
    payloads: Sequence[float],
    rules: ClearanceRules,
    seed: int,
    narrowed: Narrowing | None = None,
) -> CandidateSet:
    """The combinations of levels (rad) that keep the rules, each under every payload (kg). Raises `LrmError`.

    `levels`: empty for poses at any angles, drawn at random; more of them where they are narrowed.
    """
    drawn = RANDOM_CANDIDATES if narrowed is None else MOST_CANDIDATES
    clear = candidate_grid(arm, levels, rules) if levels else _at_any_angles(arm, drawn, rules, seed)
    q = clear.q if narrowed is None else narrowed(clear.q)
    seen, most = None if narrowed is None else len(q), MOST_CANDIDATES // len(payloads)
    thinned = len(q) > most
    if thinned:
        q = q[np.sort(np.random.default_rng(seed).choice(len(q), most, replace=False))]
    shapeless = not arm.shapes.capsules
    origin = ClearAngles(len(clear.q), clear.tried, not levels, seen, most if thinned else None, shapeless)
    every = Poses(np.tile(q, (len(payloads), 1)), np.repeat(payloads, len(q)))
    return CandidateSet(every, origin, clear.rejected)
