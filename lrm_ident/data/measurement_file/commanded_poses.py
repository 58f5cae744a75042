"""Commanded poses of a table: joint angles, load, approach, gravity; doubts about their order, in words."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.measurement_file.approach_path import states_from_beside
from lrm_ident.data.measurement_file.conventions import motion_of
from lrm_ident.data.measurement_file.known_columns import DOWN, TILT
from lrm_ident.data.measurement_file.number_table import NumberTable, cell_error
from lrm_ident.data.measurement_file.power_ons import PowerOnTime, powered, running, warmed
from lrm_ident.data.wording import enumerate_words
from lrm_math.arm.arm import Arm, feasible_approach
from lrm_math.arrays import Array
from lrm_math.errors import FileError
from lrm_math.kinematics.chain import INVERSE, Vector, X, Y, rotate, trig_of
from lrm_math.kinematics.history import history_of
from lrm_math.kinematics.motion import recorded
from lrm_math.kinematics.poses import Poses
from lrm_math.model.reading import Reading

LISTED = 8
SAME_POSE = float(np.radians(1.0))
MANY = 20
"""Rows that are not sorted by a position by chance."""
SLOW_PACE_H = 1.0
"""Time between two poses beyond which their times are rather milliseconds."""


def read_poses(
    table: NumberTable,
    arm: Arm,
    how: Reading,
    start: Array | None = None,
    beside: float | None = None,
    power: Sequence[PowerOnTime] = (),
) -> Poses:
    """The poses of a table; gravity in the frame of its positions.

    Args:
        start: (n,), joint angles before the first one (rad).
        beside: how far (rad) from it the arm was sent before each pose; None where that is not known.
        power: when the servos got power.

    Raises `FileError`: gravity is stated twice, or points up.
    """
    q, number, none = table["angles"], table.integers("pose"), np.zeros(len(table))
    moves, states = recorded(q, start, after_gap(number))
    sides = moves
    if "sides" in table:
        sides = table["sides"]
    elif "approach" in table:
        sides = feasible_approach(arm, q, table["approach"] * (how.joint_sign or np.ones(q.shape[1])))
    straight = bool(np.all((sides == moves) | (moves == 0.0))) and "approach" not in table
    t, session, payload = _times(table), table.column("session"), table.column("payload")
    load = none if payload is None else payload
    friction = states if straight else None
    if not straight and beside is not None and "sides" in table:
        begins = after_gap(number) | (False if session is None else np.diff(session, prepend=session[:1]) != 0.0)
        friction = states_from_beside(q, sides, arm, beside, begins)
    down = _gravity(table, arm, how)
    return Poses(
        q=q,
        payload=load,
        direction=sides,
        t=t,
        session=session,
        temperature=table.column("temperature"),
        number=number,
        friction=friction,
        gravity=down,
        history=history_of(q, load, t, session, number, down, start, table.column("hold")),
        running=None if t is None else running(power, t, np.ones(len(t)) if session is None else session),
        powered=None if t is None else powered(power, t),
        warmed=warmed(power, table.column("temperature")),
        sha256=table.cells.sha256,
    )


def _times(table: NumberTable) -> Array | None:
    """(N,), s, or None: no times are stated, or they run backwards, so that no interval between them can be trusted."""
    return None if _runs_backwards(table).any() else table.column("t")


def _runs_backwards(table: NumberTable) -> NDArray[np.bool_]:
    """(N,), rows with an earlier time than the row before, in the same session."""
    t, session = table.column("t"), table.column("session")
    if t is None:
        return np.zeros(len(table), dtype=np.bool_)
    same_session = True if session is None else np.diff(session) == 0
    return np.concatenate([[False], (np.diff(t) < 0) & same_session])


def _gravity(table: NumberTable, arm: Arm, how: Reading) -> Array | None:
    """(N, 3), unit vectors of gravity in the frame of the positions; None where the file states none.

    Roll and pitch turn that frame from where gravity is as the arm file says.
    """
    if "gravity" not in table and "tilt" not in table:
        return None
    if "gravity" in table and "tilt" in table:
        raise FileError(
            table.cells.path, "header", "gravity is stated twice", f"{', '.join(DOWN)} or {', '.join(TILT)}"
        )
    level = np.array(arm.gravity) @ motion_of(how)[0]
    if not level.any():
        raise FileError(table.cells.path, "header", "gravity is stated", f"the arm file of {arm.name} has none")
    if "tilt" in table:
        seen: Vector = [np.full(len(table), component) for component in level / np.linalg.norm(level)]
        roll, pitch = table["tilt"].T
        for axis, angle in ((Y, pitch), (X, roll)):
            rotate(seen, INVERSE[axis], trig_of(angle))
        return np.stack(seen, axis=1)
    down = table["gravity"] / np.linalg.norm(table["gravity"], axis=1, keepdims=True)
    up = down @ level < 0.0
    if up.any():
        what = "gravity points the other way than in the arm file"
        raise cell_error(table.cells, int(np.argmax(up)), DOWN[2], what, "down: an accelerometer at rest reads up")
    return np.asarray(down)


def pose_notices(table: NumberTable) -> Iterator[str]:
    """Notices about the order of the poses, their times and repetitions."""
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
    if axis := _sorted_by(table):
        yield (
            f"the rows are sorted by {axis}, so perhaps their order is not that of the measurement: then directions of "
            "approach and drifts come out wrong. Sort the rows by time, or state the times (t_s)"
        )
    yield from time_notices(table)
    first = {pose: row for row, pose in enumerate(number.tolist())}
    q, of = table["angles"], [first[pose] for pose in table.integers("repeat_of").tolist()]
    away = np.abs(q - q[of]).max(axis=1) > SAME_POSE
    if away.any():
        yield f"repeat_of: {pose_words(number[away])} is not commanded where the pose is that it repeats"


def _sorted_by(table: NumberTable) -> str:
    """The axis by whose positions many rows are sorted although no joint moves one way; "" if there is none."""
    if "position" not in table or _times(table) is not None or len(table) < MANY:
        return ""
    axes, joints = (_one_way(table[name]) for name in ("position", "angles"))
    return "xyz"[int(np.argmax(axes))] if axes.any() and not joints.any() else ""


def _one_way(values: Array) -> NDArray[np.bool_]:
    """(k,), which columns of values (N, k) never fall, or never rise, and are not all the same."""
    steps = np.diff(values, axis=0)
    one_way: NDArray[np.bool_] = ((steps >= 0.0).all(axis=0) | (steps <= 0.0).all(axis=0)) & (steps != 0.0).any(axis=0)
    return one_way


def time_notices(table: NumberTable) -> Iterator[str]:
    """Notices about the times of the poses."""
    t, back = table.column("t"), _runs_backwards(table)
    if back.any():
        yield (
            f"t_s runs backwards at {pose_words(table.integers('pose')[back])}, so no times are used. Was the clock "
            "set, or is it another power-on (add the column session)? Are the rows in the order measured?"
        )
    pace_h = 0.0 if t is None or len(t) < 2 else float(np.median(np.abs(np.diff(t)))) / 3600.0
    if pace_h > SLOW_PACE_H:
        yield f"half of the poses are {pace_h:.3g} h or more apart; if t_s is in milliseconds: rename it t_ms"


def perhaps_radians(q: Array, how: Reading) -> tuple[str, ...]:
    """The doubt, in words, whether angles (N, n), rad, were radians read as degrees, where nobody stated their unit."""
    if how.angle_unit is not None or not 0.0 < np.abs(q).max(initial=0.0) <= np.radians(2.0 * np.pi):
        return ()
    most = np.degrees(np.abs(q).max())
    return (f"no joint angle is beyond {most:.3g} deg; if they are radians: --angle-unit rad",)


def pose_words(numbers: NDArray[np.int64]) -> str:
    """The first of some poses, by number, and how many more there are."""
    return f"pose {enumerate_words([str(number) for number in numbers.tolist()], LISTED)}"


def after_gap(number: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(N,), whether the pose before is missing: ascending numbers leave some out. Else numbers are names."""
    steps = np.diff(number)
    usual = np.gcd.reduce(steps) if len(steps) and (steps > 0).all() else 0
    return np.concatenate([[False], (steps != usual) & (usual > 0)]) if len(number) else np.zeros(0, dtype=np.bool_)


def directions(q: Array, start: Array | None, gap: NDArray[np.bool_] | None = None) -> Array:
    """(N, n), sign of the last move of each joint before each pose; 0 before its first move, and after a `gap` (N,)."""
    return recorded(q, start, gap)[0]
