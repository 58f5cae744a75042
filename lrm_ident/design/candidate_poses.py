"""Poses that could be measured: every combination of joint levels that keeps clear of itself and its surroundings.

Rules of the thesis (section 5.2): bodies stay 3 cm apart, the tool 16 cm from the inner arm and from what it stands on,
and nothing goes below the table. Bodies are the shapes of the arm's file; an arm without shapes is held to the lines
between its joints. Frames are those of the nominal arm: the margins have to cover its sag.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.collision.distance import segment_to_box, segment_to_segment
from lrm_math.collision.scene import Scene, clearance_of
from lrm_math.errors import LrmError, UnknownName
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.forward import frames

LEVELS = 5
MOST_COMBINATIONS = 300_000
NEAR_LINKS = 4  # the last links, which the tool can fold back upon but never leave; their shapes keep it clear


@dataclass(frozen=True)
class Rules:
    """How far to stay away (m): bodies from each other, the TCP from the inner links and from boxes; the lowest z.

    `floor` may be None where nothing is known of a table, or where a box of the arm's file is the table.
    """

    apart: float = 0.03
    tip: float = 0.16
    floor: float | None = None


@dataclass(frozen=True, eq=False)
class Combinations:
    """Angles (N, n) in rad that keep the rules, of `tried` combinations; how many each rule refused, by its name."""

    q: Array
    tried: int
    refused: dict[str, int]


def levels_of(arm: Arm, text: str = str(LEVELS)) -> tuple[tuple[float, ...], ...]:
    """The levels of every joint (rad) from words such as `5`, `-100,0,100` or `5; joint2=-50,0,50; joint6=3`.

    One number is a count of levels, evenly from limit to limit; several are angles in deg.

    Raises:
        LrmError: words that say nothing, or an angle beyond a joint's limits. UnknownName: no such joint.
    """
    words: dict[str, str] = {}
    for part in text.split(";"):
        place, equals, angles = part.strip().rpartition("=")
        if equals and place.strip() not in arm.joint_names:
            raise UnknownName("joint", place.strip(), arm.joint_names)
        words[place.strip()] = angles.strip()
    return tuple(_levels(arm, i, words.get(name, words.get("", str(LEVELS)))) for i, name in enumerate(arm.joint_names))


def _levels(arm: Arm, i: int, text: str) -> tuple[float, ...]:
    joint, right = arm.joints[i], "say a count such as 5, or angles in deg such as -100,0,100"
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        raise LrmError(f"levels of joint {i + 1}: '{text}' is not a list of numbers; {right}") from None
    if len(numbers) == 1 and numbers[0] == round(numbers[0]) and numbers[0] >= 1:
        return tuple(np.linspace(joint.lower, joint.upper, int(numbers[0])).tolist()) if numbers[0] > 1 else (0.0,)
    angles = np.radians(numbers)
    if len(numbers) < 2 or np.any(angles < joint.lower - 1e-9) or np.any(angles > joint.upper + 1e-9):
        low, high = np.degrees([joint.lower, joint.upper])
        raise LrmError(f"levels of joint {i + 1}: '{text}'; {right}, within {low:g} to {high:g} deg")
    return tuple(angles.tolist())


def combinations(arm: Arm, levels: Sequence[Sequence[float]], rules: Rules | None = None) -> Combinations:
    """Every combination of levels that keeps the rules.

    Raises:
        LrmError: more combinations than can be looked at, or none that keeps the rules.
    """
    count = int(np.prod([len(angles) for angles in levels]))
    if count > MOST_COMBINATIONS:
        raise LrmError(
            f"{count} combinations of levels; at most {MOST_COMBINATIONS} can be looked at, take fewer levels"
        )
    q = np.array(list(product(*levels)), dtype=np.float64)
    broken = broken_rules(arm, q, rules or Rules())
    good = ~np.any([np.zeros(len(q), dtype=np.bool_), *broken.values()], axis=0)
    if not good.any():
        worst = max(broken, key=lambda name: int(broken[name].sum()))
        raise LrmError(f"none of {count} combinations of levels keeps the rules; most break: {worst}")
    return Combinations(q[good], count, {name: int(rows.sum()) for name, rows in broken.items()})


def broken_rules(arm: Arm, q: Array, rules: Rules) -> dict[str, NDArray[np.bool_]]:
    """For every rule, which of the angles (N, n) break it (N,)."""
    chain = chain_of(arm)
    stands = frames(chain, chain.values(list(np.ascontiguousarray(q.T))), len(q))
    points = stands[:, :, :3, 3]
    broken = {}
    if arm.dof > NEAR_LINKS:
        broken[f"the TCP within {rules.tip * 1e3:g} mm of an inner link"] = _tip_near_links(points) < rules.tip
    if arm.shapes.capsules:
        scene = Scene.of(arm)
        broken[f"bodies within {rules.apart * 1e3:g} mm"] = clearance_of(scene, stands).distance < rules.apart
        broken[f"the TCP within {rules.tip * 1e3:g} mm of a box"] = _tip_near_boxes(scene, points[:, -1]) < rules.tip
    if rules.floor is not None:
        broken[f"below z = {rules.floor * 1e3:g} mm"] = points[:, 1:, 2].min(axis=1) < rules.floor
    return broken


def _tip_near_links(points: Array) -> Array:
    """(N,), distance of the TCP from the lines between the frames of the base and the inner joints (N, n + 2, 3)."""
    inner, tip = points[:, : points.shape[1] - 1 - NEAR_LINKS], points[:, -1:]
    return np.asarray(segment_to_segment(inner[:, :-1], inner[:, 1:], tip, tip).min(axis=1))


def _tip_near_boxes(scene: Scene, tip: Array) -> Array:
    """(N,), distance of the TCP (N, 3) from the nearest box (m); infinite where there is none."""
    nearest = np.full(len(tip), np.inf)
    for turn, centre, half in zip(scene.box_turn, scene.box_centre, scene.box_half, strict=True):
        seen = (tip - centre) @ turn
        nearest = np.minimum(nearest, segment_to_box(seen, seen, np.broadcast_to(half, seen.shape)))
    return nearest
