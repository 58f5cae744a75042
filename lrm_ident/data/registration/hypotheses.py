"""Ways in which a measurement file may have been misread: what would change, and how it is said in words."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations, product

import numpy as np

from lrm_ident.data.measurement_file.conventions import ANGLE_UNITS, LENGTH_UNITS, axes_matrix, axes_words
from lrm_ident.data.registration.zero_conventions import FULL_TURN, conventions
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.model.reading import Reading

UNIT_NAMES = {"um": "micrometres", "mm": "millimetres", "cm": "centimetres", "inch": "inches", "m": "metres"}
RIGHT_ANGLES = (90.0, -90.0, 180.0)
COUNTS, MOST_DEG, MOST_SHARE = 4096, 720.0, 100.5
"""Of an encoder of 12 bits in a turn; what degrees and shares of a range are at most."""
HALF_TURN, PULSES_US, DEG_PER_US = 180.0, (400.0, 2600.0), (180.0 / 2000.0, 270.0 / 2000.0, 120.0 / 1000.0)
"""Of a hobby servo: its range as Arduino's `Servo.write` counts it (deg), its pulses, what they turn usual servos."""
RATIOS = (0.5, 2.0 / 3.0, 1.5, 2.0)
"""Of a joint's turn to the number for it: gears, and servos of 180 or 270 deg that are taken for the other."""
SIMPLE, COMPOUND, FREE = 1.0, 1.5, 2.0
"""Complexity of one mistake, of one that touches several joints or the arm's file, and of a free frame."""


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One way to read a file, beside the way it was read.

    Attributes:
        reading: the whole reading.
        q, tcp: joint angles (N, n), rad, and positions (N, 3), m, that it makes of those read.
        words: what was mistaken; empty if nothing.
        complexity: 0 if nothing was mistaken.
        remedy: what a person does about it where no option of the command helps.
        imputed: whether a column is imputed from all others, so that only these show it.
    """

    reading: Reading
    q: Array
    tcp: Array
    words: tuple[str, ...] = ()
    complexity: float = 0.0
    remedy: str = ""
    imputed: bool = False

    def also(self, words: str, complexity: float, remedy: str = "", **fields: object) -> Hypothesis:
        """Adds one mistake more; `fields`: of the reading."""
        return replace(
            self,
            reading=self.reading.model_copy(update=fields),
            words=(*self.words, words),
            complexity=self.complexity + complexity,
            remedy="; ".join(part for part in (self.remedy, remedy) if part),
        )

    def with_joint(self, joint: int, angles: Array) -> Hypothesis:
        """Other angles (N,), rad, of one joint."""
        q = self.q.copy()
        q[:, joint] = angles
        return replace(self, q=q)


def joint_hypotheses(read: Hypothesis, arm: Arm) -> Iterator[Hypothesis]:
    """Joint angles as read, in another unit, with other signs, in another order, from another zero.

    In another unit with other signs or in another order, too: who exports from a program has its conventions, not one.
    As motors count that move two joints together.
    """
    yield read
    units = list(_other_units(read))
    counted = list(_servo_units(read, arm))
    yield from (*units, *counted)
    yield from _other_zeros(read, arm)
    yield from _other_ratios(read)
    yield from _coupled_joints(read)
    for unit in (read, *(other for other in units if other.reading.angle_unit != read.reading.angle_unit)):
        yield from other_signs(unit)
        yield from _other_orders(unit)
    for servos in counted:
        yield from other_signs(servos)
    yield from _turned_zeros(read)


def _turned_zeros(read: Hypothesis) -> Iterator[Hypothesis]:
    """The zero of one joint, or of two, turned by right angles, as of an arm that was drawn in another pose."""
    every = range(read.q.shape[1])
    for joints in (*combinations(every, 1), *combinations(every, 2)):
        for turns in product(RIGHT_ANGLES, repeat=len(joints)):
            turned = read
            for joint, turn in zip(joints, turns, strict=True):
                words = f"the zero of joint {joint + 1} looks turned by {turn:g} deg"
                remedy = f"add {turn:g} to theta_deg of joint {joint + 1} in the arm file"
                complexity = COMPOUND if len(joints) == 1 else 0.5 * FREE
                angles = read.q[:, joint] + np.radians(turn)
                turned = turned.also(words, complexity, remedy).with_joint(joint, angles)
            yield turned


def _other_units(read: Hypothesis) -> Iterator[Hypothesis]:
    angle_unit, deg, largest = read.reading.angle_unit, ANGLE_UNITS["deg"], np.abs(read.q).max(axis=0)
    if angle_unit != "rad" and largest.max() <= FULL_TURN * deg:
        words = "the joint angles look like radians"
        yield replace(read.also(words, SIMPLE, angle_unit="rad"), q=read.q / deg)
    if angle_unit != "deg" and largest.max() > FULL_TURN:
        words = "the joint angles look like degrees"
        yield replace(read.also(words, SIMPLE, angle_unit="deg"), q=read.q * deg)
    for joint, most in enumerate(largest.tolist()):
        if angle_unit != "rad" and 0.0 < most <= FULL_TURN * deg:
            yield _one_joint(read, joint, "rad", 1.0 / deg)
        elif angle_unit == "rad" and most > FULL_TURN:
            yield _one_joint(read, joint, "deg", deg)


def _servo_units(read: Hypothesis, arm: Arm) -> Iterator[Hypothesis]:
    """Numbers as servos count them and LeRobot records them: no unit of an angle, since only a calibration tells it."""
    numbers = read.q / ANGLE_UNITS[read.reading.angle_unit or "deg"]
    if numbers.min() >= 0.0 and MOST_DEG < numbers.max() <= COUNTS:
        words = "the joint angles look like counts of encoders"
        remedy = f"convert them: deg = (count - {COUNTS // 2}) * 360 / {COUNTS}"
        yield replace(read.also(words, COMPOUND, remedy), q=(numbers / COUNTS - 0.5) * FULL_TURN)
    if numbers.min() >= 0.0 and HALF_TURN / 2.0 < numbers.max() <= HALF_TURN:
        words = "the joint angles look counted from 0 to 180, as Arduino's Servo.write does"
        yield replace(read.also(words, COMPOUND, "subtract 90 from each"), q=np.radians(numbers - 90.0))
    if PULSES_US[0] <= numbers.min() and numbers.max() <= PULSES_US[1]:
        words = "the joint angles look like pulses of hobby servos in microseconds"
        for scale in DEG_PER_US:
            remedy = f"convert them by what each servo turns: deg = (us - 1500) * {scale:.4g}, or its own table"
            yield replace(read.also(words, COMPOUND, remedy), q=np.radians((numbers - 1500.0) * scale))
    if MOST_SHARE / 2.0 < np.abs(numbers).max() <= MOST_SHARE:
        half = np.array([0.5 * (joint.upper - joint.lower) for joint in arm.joints])
        words = "the joint angles look like LeRobot's -100 to 100 of each joint's range"
        remedy = "record with use_degrees=true, or convert them by range_min and range_max of LeRobot's calibration: "
        remedy += "deg = value / 100 * (range_max - range_min) / 2 * 360 / 4095"
        yield replace(read.also(words, COMPOUND, remedy), q=numbers / 100.0 * half)


def _other_zeros(read: Hypothesis, arm: Arm) -> Iterator[Hypothesis]:
    """Angles from the zeros of a recording that are not those of the arm's file."""
    if read.reading.joint_sign is None and read.reading.joint_order is None:
        for rule in conventions(arm):
            words = f"the joint angles look counted from {rule.words}"
            yield replace(read.also(words, COMPOUND, f"convert them: {rule.formula(arm)}"), q=rule.applied(read.q))


def _other_ratios(read: Hypothesis) -> Iterator[Hypothesis]:
    """One joint, or each, that turns by another ratio than its numbers."""
    for ratio in RATIOS:
        for joint in range(read.q.shape[1]):
            words = f"joint {joint + 1} looks to turn {ratio:.3g} times as far as its angles say"
            remedy = f"multiply the column of q{joint + 1} by {ratio:.3g} (a gear, a servo of another range?)"
            yield read.also(words, COMPOUND, remedy).with_joint(joint, ratio * read.q[:, joint])
        words = f"all joints look to turn {ratio:.3g} times as far as their angles say"
        remedy = f"multiply all angles by {ratio:.3g} (servos of another range?)"
        yield replace(read.also(words, COMPOUND, remedy), q=ratio * read.q)


def _coupled_joints(read: Hypothesis) -> Iterator[Hypothesis]:
    """Angles of motors or encoders that count several joints together: a parallelogram linkage, a differential.

    A fit takes the joints as those of a serial arm afterwards: a torque bends each at its own spring.
    """
    n, serial = read.q.shape[1], "the fit takes the springs as those of a serial arm"
    for first, joint in combinations(range(n), 2):
        a, b, qa, qb = f"q{first + 1}", f"q{joint + 1}", read.q[:, first], read.q[:, joint]
        words = f"the angle of joint {joint + 1} looks counted together with that of joint {first + 1}"
        for told, angles in ((f"{b} - {a}", qb - qa), (f"{b} + {a}", qb + qa),
                             (f"-{b} - {a}", -qb - qa), (f"-{b} + {a}", qa - qb)):  # fmt: skip
            remedy = f"write {told} into the column of {b} (a parallelogram linkage?); {serial}"
            yield read.also(words, FREE, remedy).with_joint(joint, angles)
        words = f"the angles of joints {first + 1} and {joint + 1} look like those of the two motors of a differential"
        both, apart = (f"({b} + {a}) / 2", 0.5 * (qb + qa)), (f"({b} - {a}) / 2", 0.5 * (qb - qa))
        for with_coupling, other in ((both, apart), (apart, both)):
            remedy = f"write {with_coupling[0]} into the column of {a}, {other[0]} into that of {b}; {serial}"
            yield read.also(words, FREE, remedy).with_joint(first, with_coupling[1]).with_joint(joint, other[1])
        if joint > first + 1:
            words = (
                f"the angles of joints {first + 2} to {joint + 1} look counted from the base, not from the link before"
            )
            remedy = f"subtract from each the angle of the joint before, as recorded; {serial}"
            relative = read.also(words, FREE, remedy)
            for k in range(first + 1, joint + 1):
                relative = relative.with_joint(k, read.q[:, k] - read.q[:, k - 1])
            yield relative


def _one_joint(read: Hypothesis, joint: int, unit: str, factor: float) -> Hypothesis:
    """The angles of one joint alone in another unit, in which they are so many times larger."""
    number = (read.reading.joint_order or range(1, read.q.shape[1] + 1))[joint]
    words = f"the angles of joint {joint + 1} alone look like {'radians' if unit == 'rad' else 'degrees'}"
    return read.also(words, SIMPLE, f"name the column q{number}_{unit}").with_joint(joint, read.q[:, joint] * factor)


def one_axis(read: Hypothesis, nominal: Array, tolerance: float) -> Iterator[Hypothesis]:
    """Positions with one axis in another unit than the others.

    The unit is that which makes the axis as long as those of the arm as drawn, `nominal` (N, 3), m.
    """
    current_unit = read.reading.unit or "mm"
    extent, drawn = (np.median(np.abs(points - np.median(points, axis=0)), axis=0) for points in (read.tcp, nominal))
    for axis, (seen, wanted) in enumerate(zip(extent.tolist(), drawn.tolist(), strict=True)):
        unit = nearest_unit(current_unit, wanted / seen, tolerance) if seen > 0.0 and wanted > 0.0 else None
        if unit is not None and unit[1] != 1.0:
            words, scale = f"{'xyz'[axis]} alone looks like {UNIT_NAMES[unit[0]]}", np.ones(3)
            scale[axis] = unit[1]
            yield replace(read.also(words, SIMPLE, f"name its column {'xyz'[axis]}_{unit[0]}"), tcp=read.tcp * scale)


def other_signs(read: Hypothesis) -> Iterator[Hypothesis]:
    """The angles with the sign of one joint, of two, or of all turned."""
    n = read.q.shape[1]
    sets = [*combinations(range(n), 1), *combinations(range(n), 2), *([tuple(range(n))] if n > 2 else [])]
    before = np.array(read.reading.joint_sign or [1] * n)
    for joints in sets:
        signs = np.ones(n, dtype=np.int64)
        signs[list(joints)] = -1
        words = f"{_joints(joints)} counted the other way round"
        complexity = SIMPLE if len(joints) == 1 else COMPOUND if len(joints) == n else FREE
        yield replace(read.also(words, complexity, joint_sign=(before * signs).tolist()), q=read.q * signs)


def _other_orders(read: Hypothesis) -> Iterator[Hypothesis]:
    n = read.q.shape[1]
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
        swapped = (read.q * signs)[:, order] * signs
        yield replace(read.also(words, complexity, joint_order=before[order].tolist()), q=swapped)


def _joints(numbers: tuple[int, ...]) -> str:
    names = [str(number + 1) for number in numbers]
    return f"joint {names[0]} looks" if len(names) == 1 else f"joints {', '.join(names[:-1])} and {names[-1]} look"


def with_unit(before: Hypothesis, unit: str, factor: float) -> Hypothesis:
    """The hypothesis that the positions are in another unit; `factor`: how much longer they then are."""
    if factor == 1.0:
        return before
    other = before.also(f"the positions look like {UNIT_NAMES[unit]}", SIMPLE, unit=unit)
    return replace(other, tcp=before.tcp * factor)


def nearest_unit(current_unit: str, scale: float, tolerance: float) -> tuple[str, float] | None:
    """The unit that makes positions `scale` times longer than in `current_unit`, and its factor; None if none does."""
    fitting = {
        unit: metres / LENGTH_UNITS[current_unit]
        for unit, metres in LENGTH_UNITS.items()
        if scale > 0 and abs(np.log(scale * LENGTH_UNITS[current_unit] / metres)) < tolerance
    }
    unit = min(fitting, key=lambda name: abs(np.log(scale / fitting[name])), default=None)
    return None if unit is None else (unit, fitting[unit])


def with_axes(before: Hypothesis, turn: Array) -> Hypothesis:
    """The hypothesis that the axes are others by the signed permutation (3, 3), on top of those read."""
    if np.array_equal(turn, np.eye(3)):
        return before
    axes = axes_words(turn @ axes_matrix(before.reading.axes or "x,y,z"))
    return replace(before.also(_axes_in_words(turn), SIMPLE, axes=axes), tcp=before.tcp @ turn.T)


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
