"""Measured numbers as a `Reading` says: signed axes, a frame's rigid motion, signs and order of the joints."""

from __future__ import annotations

import numpy as np

from lrm_ident.data.robot_files.rigid_motion import placement_motion, to_xyz_angles
from lrm_math.arm.arm import Placement
from lrm_math.arm.arm_file import MM
from lrm_math.arrays import Array
from lrm_math.model.reading import AXES, FrameTable, Reading

LENGTH_UNITS = {"um": 1e-6, "mm": 1e-3, "cm": 1e-2, "inch": 0.0254, "m": 1.0}
"""Metres of each unit of positions."""
ANGLE_UNITS = {"deg": float(np.radians(1.0)), "rad": 1.0}
"""Radians of each unit of joint angles."""


def axes_matrix(axes: str) -> Array:
    """(3, 3), signed permutation that takes the file's coordinates to the arm's."""
    matrix = np.zeros((3, 3))
    for row, word in enumerate(axes.split(",")):
        matrix[row, AXES.index(word[-1])] = -1.0 if word.startswith("-") else 1.0
    return matrix


def axes_words(matrix: Array) -> str:
    """The inverse of `axes_matrix`: the nearest signed permutation of a matrix (3, 3), as `x,y,-z`."""
    columns = np.argmax(np.abs(matrix), axis=1)
    return ",".join(
        ("-" if matrix[row, column] < 0 else "") + AXES[int(column)] for row, column in enumerate(columns.tolist())
    )


def frame_table(rotation: Array, translation: Array) -> FrameTable:
    """The table of a rigid motion: rotation (3, 3) and translation (3,), m."""
    x, y, z = (translation / MM).tolist()
    a, b, c = np.degrees(to_xyz_angles(rotation)).tolist()
    return FrameTable(x_mm=x, y_mm=y, z_mm=z, alpha_deg=a, beta_deg=b, gamma_deg=c)


def frame_motion(frame: FrameTable) -> Array:
    """(4, 4), rigid motion of a frame (m)."""
    x, y, z = frame.x_mm * MM, frame.y_mm * MM, frame.z_mm * MM
    return placement_motion(Placement(x, y, z, *np.radians([frame.alpha_deg, frame.beta_deg, frame.gamma_deg])))


def rigid_motion(frame: FrameTable) -> tuple[Array, Array]:
    """Rotation (3, 3) and translation (3,), m, of a frame."""
    T = frame_motion(frame)
    return T[:3, :3], T[:3, 3]


def motion_of(reading: Reading) -> tuple[Array, Array]:
    """Rotation (3, 3), or mirror, and translation (3,), m, from a file's positions to the arm's frame.

    To the file's own frame, with the arm's axes, as long as that frame is not known.
    """
    axes = np.eye(3) if reading.axes is None else axes_matrix(reading.axes)
    if not isinstance(reading.frame, FrameTable):
        return axes, np.zeros(3)
    rotation, translation = rigid_motion(reading.frame)
    return rotation @ axes, translation


def read_positions(reading: Reading, positions: Array) -> Array:
    """(N, 3), positions of a file (m) as `motion_of` takes them."""
    turn, shift = motion_of(reading)
    return np.asarray(positions @ turn.T + shift)


def read_joints(reading: Reading, columns: Array) -> Array:
    """(..., n), quantities of the file's joints in the order and with the signs of the arm's joints."""
    ordered = columns if reading.joint_order is None else columns[..., [number - 1 for number in reading.joint_order]]
    return ordered if reading.joint_sign is None else ordered * np.array(reading.joint_sign, dtype=np.float64)
