"""Commanded poses of a table: joint angles within the arm's limits, load, direction of approach."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.apply_reading import ANGLE_UNITS, LENGTH_UNITS, read_joints
from lrm_ident.data.csv_table import CsvTable
from lrm_ident.data.measurement_table import ANGLES, POSITION
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import GRAM, MM
from lrm_math.arrays import Array
from lrm_math.effects.friction import friction_states
from lrm_math.errors import FileError
from lrm_math.kinematics.poses import Poses
from lrm_math.model.reading import AS_NAMED, Reading

LIMIT_TOLERANCE = np.radians(1e-6)


class BeyondLimits(FileError):
    """A joint angle beyond the limits of the arm."""


def in_units(table: CsvTable, how: Reading) -> CsvTable:
    """The table with the stated units in place of those of its columns' names."""
    factors: dict[str, float] = {}
    if how.unit:
        factors |= dict.fromkeys((*POSITION, "distance_mm"), LENGTH_UNITS[how.unit] / MM)
    if how.angle_unit:
        names = [name for name in table.header if ANGLES.fullmatch(name)]
        factors |= dict.fromkeys(names, ANGLE_UNITS[how.angle_unit] / ANGLE_UNITS["deg"])
    return table.with_factors(factors)


def poses_of_table(
    table: CsvTable,
    q: Array,
    known: dict[str, Array],
    number: NDArray[np.int64] | None,
    start: Array | None,
    how: Reading,
) -> Poses:
    """Poses with angles `q` (N, n) in rad and the other columns of a table, `known` those that are read already."""
    moves = directions(q, start)
    sides = read_approach(table, moves, how)
    straight = bool(np.all((sides == moves) | (moves == 0.0)))
    return Poses(
        q=q,
        payload=read_payload(table),
        direction=sides,
        t=known.get("t_s"),
        session=known.get("session"),
        temperature=known.get("temp_c"),
        number=number,
        friction=friction_states(q, moves, start) if straight and "approach" not in table.header else None,
        running=_running(known.get("t_s"), known.get("session")),
    )


def _running(t: Array | None, session: Array | None) -> Array | None:
    """(N,), time since the first pose of the session (s)."""
    if t is None:
        return None
    _, number = np.unique(np.zeros(len(t)) if session is None else session, return_inverse=True)
    first = np.full(int(number.max()) + 1, np.inf)
    np.minimum.at(first, number, t)
    return np.asarray(t - first[number])


def read_angles(table: CsvTable, arm: Arm, how: Reading = AS_NAMED) -> Array:
    """(N, n) joint angles (rad), every one within the arm's limits. Raises `FileError`, `BeyondLimits`."""
    columns = np.stack([table.numbers(f"q{i + 1}_deg") for i in range(arm.dof)], axis=1)
    q = np.radians(read_joints(how, columns))
    order = how.joint_order or range(1, arm.dof + 1)
    for i, joint in enumerate(arm.joints):
        outside = (q[:, i] < joint.lower - LIMIT_TOLERANCE) | (q[:, i] > joint.upper + LIMIT_TOLERANCE)
        if outside.any():
            row = int(np.argmax(outside))
            low, high = np.degrees([joint.lower, joint.upper])
            raise BeyondLimits(
                table.path,
                table.at(row, f"q{order[i]}_deg"),
                f"{np.degrees(q[row, i]):g} deg is beyond the limits of joint {i + 1}",
                f"{low:g} to {high:g} deg",
            )
    return q


def read_payload(table: CsvTable) -> Array:
    """(N,) load (kg), zero where the column is missing. Raises `FileError` for a negative one."""
    if "payload_g" not in table.header:
        return np.zeros(len(table.rows))
    payload = table.numbers("payload_g")
    table.reject(payload < 0, "payload_g", "a negative load")
    return payload * GRAM


def read_approach(table: CsvTable, moves: Array, how: Reading) -> Array:
    """(N, n), approach directions: the columns `approach1` … or `approach`, else the moves. Raises `FileError`."""
    own = [f"approach{i + 1}" for i in range(moves.shape[1])]
    if set(own) <= set(table.header):
        sides = np.stack([table.numbers(name) for name in own], axis=1)
        for name, side in zip(own, sides.T, strict=True):
            table.reject(~np.isin(side, (-1.0, 0.0, 1.0)), name, "not a side", "1, -1, or 0 if unknown")
        return read_joints(how, sides)
    if "approach" not in table.header:
        return moves
    side = table.numbers("approach")
    table.reject(~np.isin(side, (-1.0, 0.0, 1.0)), "approach", "not a side", "1, -1, or 0 if unknown")
    return read_joints(how, np.repeat(side[:, None], moves.shape[1], axis=1))


def directions(q: Array, start: Array | None) -> Array:
    """(N, n), sign of the last move of each joint before each pose; 0 before its first move."""
    before = q[:1] if start is None else np.asarray(start)[None, :]
    moves = np.sign(np.diff(np.concatenate([before, q]), axis=0))
    for row in range(1, len(moves)):
        moves[row] = np.where(moves[row] == 0.0, moves[row - 1], moves[row])
    return moves


def read_whole(table: CsvTable, column: str) -> NDArray[np.int64]:
    """(N,), a column of whole numbers. Raises `FileError`."""
    values = table.numbers(column)
    table.reject(values != np.round(values), column, "not a whole number")
    return values.astype(np.int64)
