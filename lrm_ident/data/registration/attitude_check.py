"""Whether measured orientations are those of the arm's tool, or their columns stand in another order."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import permutations

import numpy as np

from lrm_ident.data.apply_reading import motion_of
from lrm_ident.data.measurement_file.sensed_columns import QUATERNION
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.registration.row_choice import spaced_rows
from lrm_ident.data.weights.rotations import quaternions, rotation_matrix, rotation_vectors
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.errors import FileError
from lrm_math.model.equilibrium import equilibrium
from lrm_math.model.model import model_of
from lrm_math.model.sensed import tool_rotation

MOST = 100
FAR, BETTER = np.radians(15.0), 0.5
"""An orientation error that no assembled arm has, and the part of it that another reading must come below."""
NOT_THIS_ARM = np.radians(45.0)


def check_attitude(arm: Arm, data: Measurements) -> None:
    """Compares measured orientations with the arm as drawn.

    Raises `FileError`: the columns look ordered or signed otherwise, the tool's or the measuring frame turned, or the
    orientations are of another arm.
    """
    if data.attitude is None:
        return
    rows = np.flatnonzero(~np.isnan(data.attitude[:, 0, 0]))
    if not len(rows):
        return
    rows = rows[spaced_rows(len(rows), MOST)]
    measured, drawn = data.attitude[rows], tool_rotation(equilibrium(model_of(arm, ()), data.poses.take(rows)))
    error = _usual_angle(measured @ drawn.transpose(0, 2, 1))
    if error <= FAR:
        return
    found = min(_readings(measured, drawn, motion_of(data.reading)[0]), key=lambda reading: reading[0])
    what = f"the orientations miss those of {arm.name} by {np.degrees(error):.0f} deg"
    if found[0] < BETTER * error:
        raise FileError(data.path, ", ".join(QUATERNION), f"{what}; {found[1]}", f"then {np.degrees(found[0]):.1f} deg")
    if error > NOT_THIS_ARM:
        right = "correct [tool] of the arm file, or leave the columns out"
        raise FileError(data.path, ", ".join(QUATERNION), f"{what}, in whatever order the columns are read", right)


def _readings(measured: Array, drawn: Array, turn: Array) -> Iterator[tuple[float, str]]:
    """The usual error (rad) of every other reading of the orientations, and what a person does about it."""
    raw = quaternions(turn.T @ measured)
    for order in permutations(range(4)):
        for sign in (1.0, -1.0):
            values = raw[:, order] * [1.0, sign, sign, sign]
            error = _usual_angle(turn @ rotation_matrix(values) @ drawn.transpose(0, 2, 1))
            names = [""] * 4
            for ours, theirs in enumerate(order):
                names[theirs] = QUATERNION[ours]
            words = [] if order == (0, 1, 2, 3) else [f"the four columns look like {', '.join(names)}: rename them so"]
            words += [] if sign > 0 else ["they look like the inverse rotations: negate qx, qy and qz"]
            yield error, "; ".join(words)
    for which, left in (("tool", drawn.transpose(0, 2, 1) @ measured), ("base", measured @ drawn.transpose(0, 2, 1))):
        mean = _mean(left)
        angles = ", ".join(f"{angle:.0f}" for angle in np.degrees(rotation_vectors(mean[None])[0]))
        yield _usual_angle(left @ mean.T), f"the frame of the {which} looks turned by ({angles}) deg about x, y, z"


def _usual_angle(rotations: Array) -> float:
    """Median angle of rotations (N, 3, 3), rad."""
    return float(np.median(np.linalg.norm(rotation_vectors(rotations), axis=1)))


def _mean(rotations: Array) -> Array:
    """(3, 3), the rotation nearest to all of them (N, 3, 3) (Moakher 2002, chordal mean)."""
    U, _, Vt = np.linalg.svd(rotations.sum(axis=0))
    return np.asarray(U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt)
