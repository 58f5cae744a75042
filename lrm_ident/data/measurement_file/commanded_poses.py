"""Commanded poses of a table: joint angles within the arm's limits, load, direction of approach."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.measurement_file.number_table import NumberTable, cell_place
from lrm_ident.data.wording import enumerate_words
from lrm_math.arm.arm import Arm
from lrm_math.arm.joint_limits import feasible_approach
from lrm_math.arrays import Array
from lrm_math.effects.friction import friction_states
from lrm_math.errors import FileError
from lrm_math.kinematics.poses import Poses
from lrm_math.model.reading import Reading

LISTED = 8
LIMIT_TOLERANCE = np.radians(1e-6)


class BeyondLimits(FileError):
    """A joint angle beyond the limits of the arm."""


def read_poses(table: NumberTable, arm: Arm, how: Reading, start: Array | None = None) -> Poses:
    """The poses of a table, its joints in the arm's order and with its signs. Raises `FileError`.

    `start`: (n,), joint angles before the first one (rad).
    """
    q, number, none = read_angles(table, arm), table.integers("pose"), np.zeros(len(table))
    moves = directions(q, start, after_gap(number))
    sides = moves
    if "sides" in table:
        sides = table["sides"]
    elif "approach" in table:
        sides = feasible_approach(arm, q, table["approach"] * (how.joint_sign or np.ones(q.shape[1])))
    straight = bool(np.all((sides == moves) | (moves == 0.0))) and "approach" not in table
    t, session, payload = table.column("t"), table.column("session"), table.column("payload")
    return Poses(
        q=q,
        payload=none if payload is None else payload,
        direction=sides,
        t=t,
        session=session,
        temperature=table.column("temperature"),
        number=number,
        friction=friction_states(q, moves, start) if straight else None,
        running=None if t is None else _running(t, none if session is None else session),
        sha256=table.cells.sha256,
    )


def numbered_rows(table: NumberTable) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pose numbers (N,), and that of the pose that each row repeats, its own where the cell is empty.

    Raises `FileError`: a number that stands twice, or a repetition of no pose.
    """
    pose, first = table.integers("pose"), dict[int, int]()
    for row, number in enumerate(pose.tolist()):
        if first.setdefault(number, row) != row:
            what = f"pose {number} stands in line {table.cells.lines[first[number]]} already"
            right = "each row has its own number; name a repetition in the column repeat_of"
            raise table.error(row, "pose", what, right)
    stated = table.column("repeat_of")
    repeat = pose if stated is None else np.where(np.isnan(stated), pose, np.nan_to_num(stated)).astype(np.int64)
    unknown = ~np.isin(repeat, pose)
    if unknown.any():
        row = int(np.argmax(unknown))
        raise table.error(row, "repeat_of", f"there is no pose {repeat[row]}")
    return pose, repeat


def pose_notices(table: NumberTable, arm: Arm) -> Iterator[str]:
    """Notices about the order of the poses, and of angles that were read a full turn away from what is stated."""
    number = table.integers("pose")
    if "approach" not in table and "sides" not in table:
        gap = after_gap(number)
        if gap.any():
            yield (
                f"before {pose_words(number[gap])} the file lacks a pose: the direction of approach is unknown there; "
                "state it as approach, or approach1, approach2 … of each joint"
            )
        if (np.diff(number) < 0).any():
            yield "the pose numbers do not ascend: the rows are taken to be in the order measured"
    stated = table["angles"]
    q, turned = full_turns(stated, arm)
    for joint in np.flatnonzero(turned.any(axis=0)).tolist():
        row, count = int(np.argmax(turned[:, joint])), int(turned[:, joint].sum())
        was, read = np.degrees([stated[row, joint], q[row, joint]])
        beyond = "1 angle is" if count == 1 else f"{count} angles are"
        yield f"{beyond} beyond the limits of joint {joint + 1} and read a full turn away: {was:g} = {read:g} deg"


def pose_words(numbers: NDArray[np.int64]) -> str:
    """The first of some poses, by number, and how many more there are."""
    return f"pose {enumerate_words([str(number) for number in numbers.tolist()], LISTED)}"


def _running(t: Array, session: Array) -> Array:
    """(N,), time since the first pose of the session (s)."""
    _, number = np.unique(session, return_inverse=True)
    first = np.full(int(number.max()) + 1, np.inf)
    np.minimum.at(first, number, t)
    return np.asarray(t - first[number])


def read_angles(table: NumberTable, arm: Arm) -> Array:
    """(N, n) joint angles (rad), all within the arm's limits, by a full turn if need be. Raises `BeyondLimits`."""
    q = full_turns(table["angles"], arm)[0]
    for i, joint in enumerate(arm.joints):
        outside = (q[:, i] < joint.lower - LIMIT_TOLERANCE) | (q[:, i] > joint.upper + LIMIT_TOLERANCE)
        if outside.any():
            row = int(np.argmax(outside))
            low, high = np.degrees([joint.lower, joint.upper])
            what = f"{np.degrees(q[row, i]):g} deg is beyond the limits of joint {i + 1}"
            raise BeyondLimits(
                table.cells.path, cell_place(table.cells, row, f"q{i + 1}_deg"), what, f"{low:g} to {high:g} deg"
            )
    return q


def full_turns(q: Array, arm: Arm) -> tuple[Array, NDArray[np.bool_]]:
    """Angles (N, n) beyond the limits that are within them a full turn away are that (260 deg: -100); and which."""
    low = np.array([joint.lower for joint in arm.joints]) - LIMIT_TOLERANCE
    high = np.array([joint.upper for joint in arm.joints]) + LIMIT_TOLERANCE
    other = q - np.sign(q) * 2.0 * np.pi
    turned = ((q < low) | (q > high)) & (other >= low) & (other <= high)
    return np.where(turned, other, q), turned


def after_gap(number: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(N,), whether the pose before is missing: ascending numbers leave some out. Else numbers are names."""
    steps = np.diff(number)
    usual = np.gcd.reduce(steps) if len(steps) and (steps > 0).all() else 0
    return np.concatenate([[False], (steps != usual) & (usual > 0)]) if len(number) else np.zeros(0, dtype=np.bool_)


def directions(q: Array, start: Array | None, gap: NDArray[np.bool_] | None = None) -> Array:
    """(N, n), sign of the last move of each joint before each pose; 0 before its first move, and after a `gap` (N,)."""
    before = q[:1] if start is None else np.asarray(start)[None, :]
    moves = np.sign(np.diff(np.concatenate([before, q]), axis=0))
    for row in range(1, len(moves)):
        unknown = gap is not None and gap[row]
        moves[row] = 0.0 if unknown else np.where(moves[row] == 0.0, moves[row - 1], moves[row])
    return moves
