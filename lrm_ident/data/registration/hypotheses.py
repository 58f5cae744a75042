"""Ways in which a measurement file may have been misread: what would change, and how it is said in words."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from lrm_ident.data.apply_reading import ANGLE_UNITS, LENGTH_UNITS, axes_matrix, axes_words
from lrm_math.arrays import Array
from lrm_math.model.reading import Reading

UNIT_NAMES = {"um": "micrometres", "mm": "millimetres", "cm": "centimetres", "inch": "inches", "m": "metres"}
RIGHT_ANGLES = (90.0, -90.0, 180.0)
FULL_TURN = 2.0 * np.pi
SIMPLE, COMPOUND, FREE = 1.0, 1.5, 2.0
"""Complexity of one mistake, of one that touches several joints or the arm's file, and of a free frame."""


@dataclass(frozen=True)
class Hypothesis:
    """One way to read a file, beside the way it was read.

    Attributes:
        reading: the whole reading.
        words: what was mistaken; empty if nothing.
        complexity: 0 if nothing was mistaken.
        remedy: what a person does about it where no option of the command helps.
    """

    reading: Reading
    words: tuple[str, ...] = ()
    complexity: float = 0.0
    remedy: str = ""

    def also(self, words: str, complexity: float, remedy: str = "", **fields: object) -> Hypothesis:
        """Adds one mistake more; `fields`: of the reading."""
        return Hypothesis(
            self.reading.model_copy(update=fields),
            (*self.words, words),
            self.complexity + complexity,
            "; ".join(part for part in (self.remedy, remedy) if part),
        )


@dataclass(frozen=True)
class JointHypothesis:
    """A hypothesis on joint angles, with the angles (N, n) that it makes of those read (rad)."""

    hypothesis: Hypothesis
    q: Array


def joint_hypotheses(reading: Reading, q: Array) -> Iterator[JointHypothesis]:
    """Joint angles (N, n), rad, as read, in the other unit, with other signs, in another order, from another zero."""
    read = Hypothesis(reading)
    yield JointHypothesis(read, q)
    yield from _other_units(read, q)
    yield from _other_signs(read, q)
    yield from _other_orders(read, q)
    for joint in range(q.shape[1]):
        for turn in RIGHT_ANGLES:
            turned = q.copy()
            turned[:, joint] += np.radians(turn)
            words = f"the zero of joint {joint + 1} looks turned by {turn:g} deg"
            remedy = f"add {turn:g} to theta_deg of joint {joint + 1} in the arm file"
            yield JointHypothesis(read.also(words, COMPOUND, remedy), turned)


def _other_units(read: Hypothesis, q: Array) -> Iterator[JointHypothesis]:
    now = read.reading.angle_unit
    if now != "rad" and np.abs(q).max() <= FULL_TURN * ANGLE_UNITS["deg"]:
        yield JointHypothesis(
            read.also("the joint angles look like radians", SIMPLE, angle_unit="rad"), q / ANGLE_UNITS["deg"]
        )
    if now != "deg" and np.abs(q).max() > FULL_TURN:
        yield JointHypothesis(
            read.also("the joint angles look like degrees", SIMPLE, angle_unit="deg"), q * ANGLE_UNITS["deg"]
        )
    for joint, largest in enumerate(np.abs(q).max(axis=0).tolist()):
        if now != "rad" and 0.0 < largest <= FULL_TURN * ANGLE_UNITS["deg"]:
            yield _one_joint(read, q, joint, "rad", 1.0 / ANGLE_UNITS["deg"])
        elif now == "rad" and largest > FULL_TURN:
            yield _one_joint(read, q, joint, "deg", ANGLE_UNITS["deg"])


def _one_joint(read: Hypothesis, q: Array, joint: int, unit: str, factor: float) -> JointHypothesis:
    """The angles of one joint alone in another unit, in which they are so many times larger."""
    number = (read.reading.joint_order or range(1, q.shape[1] + 1))[joint]
    words = f"the angles of joint {joint + 1} alone look like {'radians' if unit == 'rad' else 'degrees'}"
    turned = q.copy()
    turned[:, joint] *= factor
    return JointHypothesis(read.also(words, SIMPLE, f"name the column q{number}_{unit}"), turned)


def one_axis(read: Hypothesis, tcp: Array, nominal: Array, tolerance: float) -> Iterator[tuple[Hypothesis, Array]]:
    """Readings of positions (N, 3) with one axis in another unit than the others, and the positions then (m).

    The unit is that which makes the axis as long as those of the arm as drawn, `nominal` (N, 3), m.
    """
    now = read.reading.unit or "mm"
    extent, drawn = (np.median(np.abs(points - np.median(points, axis=0)), axis=0) for points in (tcp, nominal))
    for axis, (seen, wanted) in enumerate(zip(extent.tolist(), drawn.tolist(), strict=True)):
        unit = nearest_unit(now, wanted / seen, tolerance) if seen > 0.0 and wanted > 0.0 else None
        if unit is not None and unit[1] != 1.0:
            scaled = tcp.copy()
            scaled[:, axis] *= unit[1]
            words = f"{'xyz'[axis]} alone looks like {UNIT_NAMES[unit[0]]}"
            yield read.also(words, SIMPLE, f"name its column {'xyz'[axis]}_{unit[0]}"), scaled


def _other_signs(read: Hypothesis, q: Array) -> Iterator[JointHypothesis]:
    n = q.shape[1]
    sets = [*combinations(range(n), 1), *combinations(range(n), 2), *([tuple(range(n))] if n > 2 else [])]
    before = np.array(read.reading.joint_sign or [1] * n)
    for joints in sets:
        signs = np.ones(n, dtype=np.int64)
        signs[list(joints)] = -1
        words = f"{_joints(joints)} counted the other way round"
        complexity = SIMPLE if len(joints) == 1 else COMPOUND if len(joints) == n else FREE
        yield JointHypothesis(read.also(words, complexity, joint_sign=(before * signs).tolist()), q * signs)


def _other_orders(read: Hypothesis, q: Array) -> Iterator[JointHypothesis]:
    n = q.shape[1]
    before = np.array(read.reading.joint_order or range(1, n + 1))
    signs = np.array(read.reading.joint_sign or [1] * n)
    orders = []
    for i, k in combinations(range(n), 2):
        order = list(range(n))
        order[i], order[k] = k, i
        orders.append((f"joints {i + 1} and {k + 1} look swapped", order, SIMPLE))
    if n > 3:
        orders.append(("the joints look numbered from the tool", list(range(n))[::-1], COMPOUND))
    for words, order, complexity in orders:
        swapped = (q * signs)[:, order] * signs
        yield JointHypothesis(read.also(words, complexity, joint_order=before[order].tolist()), swapped)


def _joints(numbers: tuple[int, ...]) -> str:
    names = [str(number + 1) for number in numbers]
    return f"joint {names[0]} looks" if len(names) == 1 else f"joints {', '.join(names[:-1])} and {names[-1]} look"


def with_unit(before: Hypothesis, unit: str, factor: float) -> Hypothesis:
    """The hypothesis that the positions are in another unit; `factor`: how much longer they then are."""
    if factor == 1.0:
        return before
    return before.also(f"the positions look like {UNIT_NAMES[unit]}", SIMPLE, unit=unit)


def nearest_unit(now: str, scale: float, tolerance: float) -> tuple[str, float] | None:
    """The unit that makes positions `scale` times longer than in the unit `now`, and its factor; None if none does."""
    fitting = {
        unit: metres / LENGTH_UNITS[now]
        for unit, metres in LENGTH_UNITS.items()
        if scale > 0 and abs(np.log(scale * LENGTH_UNITS[now] / metres)) < tolerance
    }
    unit = min(fitting, key=lambda name: abs(np.log(scale / fitting[name])), default=None)
    return None if unit is None else (unit, fitting[unit])


def with_axes(before: Hypothesis, turn: Array) -> Hypothesis:
    """The hypothesis that the axes are others by the signed permutation (3, 3), on top of those read."""
    if np.array_equal(turn, np.eye(3)):
        return before
    axes = axes_words(turn @ axes_matrix(before.reading.axes or "x,y,z"))
    return before.also(_axes_in_words(turn), SIMPLE, axes=axes)


def _axes_in_words(turn: Array) -> str:
    words = axes_words(turn).split(",")
    if [word[-1] for word in words] == list("xyz"):
        minus = [word[-1] for word in words if word[0] == "-"]
        if len(minus) == 2:
            return f"the axes look turned by 180 deg about {({'x', 'y', 'z'} - set(minus)).pop()}"
        return f"{minus[0]} looks mirrored" if len(minus) == 1 else "x, y and z look mirrored"
    moved = [name for name, word in zip("xyz", words, strict=True) if word[-1] != name]
    if len(moved) == 2 and not any(word[0] == "-" for word in words):
        return f"{moved[0]} and {moved[1]} look swapped"
    return "the axes look turned" if np.linalg.det(turn) > 0 else "the axes look swapped and mirrored"


def with_free_frame(before: Hypothesis, mirrored: bool) -> Hypothesis:
    """The hypothesis that the positions are measured in another frame, rigidly moved; perhaps a left-handed one."""
    if mirrored:
        before = with_axes(before, np.diag([1.0, 1.0, -1.0]))
    return before.also("the positions look measured in another frame", FREE, frame="unknown")
