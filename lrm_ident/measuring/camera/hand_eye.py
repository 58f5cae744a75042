"""Place of the camera and mount of the board: robot-world/hand-eye calibration (Shah 2013), then refined."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from lrm_ident.data.rigid_motion import homogeneous, inverse, skew
from lrm_ident.measuring.camera.board_pose import BoardPose
from lrm_ident.measuring.camera.opencv import opencv
from lrm_math.arrays import Array
from lrm_math.errors import LrmError

FEWEST_POSES = 8
LEVER = 0.15
"""m: a rotation counts as what it moves at this distance, about the size of a small arm's links."""
ROBUST = 0.004  # m, beyond which a photo's residual counts less
MAX_RELATIVE_ERROR = 0.08  # m: median residual above which arm, poses and photos do not belong together


@dataclass(frozen=True, eq=False)
class HandEye:
    """`camera` (4, 4): camera in the arm's frame; `mount` (4, 4): board in the tool's frame (m).

    Attributes:
        seen: (N, 4, 4), the board in the camera's frame. own: (N, 6, 6), covariance of that (m, rad).
        residual: (N, 6), what is left of position and rotation vector in the arm's axes (m, rad).
    """

    camera: Array
    mount: Array
    seen: Array
    own: Array
    residual: Array

    @property
    def tool(self) -> Array:
        """(N, 4, 4), measured tool poses in the arm's frame."""
        return np.asarray(self.camera @ self.seen @ inverse(self.mount))

    @property
    def covariance(self) -> Array:
        """(N, 6, 6), covariance of the measured tool poses in the arm's axes: the board's, carried to the tool."""
        return measured_covariance(self.camera, self.mount, self.seen, self.own)


def hand_eye(tool: Array, boards: Sequence[BoardPose]) -> HandEye:
    """Solves for both poses from the nominal tool poses (N, 4, 4) in the arm's frame and the board's in the camera's.

    Raises `LrmError`: too few poses, or poses that have nothing to do with each other.
    """
    if len(boards) < FEWEST_POSES:
        raise LrmError(f"{len(boards)} usable photos; camera and board need {FEWEST_POSES} poses or more to be placed")
    seen, covariances = (np.array([getattr(board, name) for board in boards]) for name in ("matrix", "covariance"))
    cv2 = opencv()
    R, t, S, u = cv2.calibrateRobotWorldHandEye(
        list(seen[:, :3, :3]), list(seen[:, :3, 3]), list(tool[:, :3, :3]), list(tool[:, :3, 3])
    )
    camera, mount = inverse(homogeneous(S, u)), inverse(homogeneous(R, t))
    start = np.concatenate([_twist(camera), _twist(mount)])
    solution = least_squares(_left, start, loss="soft_l1", f_scale=ROBUST, args=(tool, seen)).x
    camera, mount = _motion(solution[:6]), _motion(solution[6:])
    residual = pose_difference(camera @ seen @ inverse(mount), tool)
    middle = float(np.median(np.linalg.norm(residual[:, :3], axis=1)))
    if middle > MAX_RELATIVE_ERROR:
        raise mismatched_poses(f"{middle * 1e3:.0f} mm")
    return HandEye(camera, mount, seen, covariances, residual)


def mismatched_poses(median: str) -> LrmError:
    """The error that photos show other poses than were commanded, by so much."""
    return LrmError(
        f"the photos do not fit the poses (median {median}): is it this arm, is every photo at the row of its pose "
        "(none missing, none too many), are the angles in degrees, do the joints turn the way the arm file says?"
    )


def pose_difference(measured: Array, nominal: Array) -> Array:
    """(N, 6), position and rotation vector of measured (N, 4, 4) less nominal poses, in fixed axes (m, rad)."""
    turned = Rotation.from_matrix(measured[:, :3, :3] @ nominal[:, :3, :3].transpose(0, 2, 1)).as_rotvec()
    return np.concatenate([measured[:, :3, 3] - nominal[:, :3, 3], turned], axis=1)


def measured_covariance(camera: Array, mount: Array, seen: Array, board_covariance: Array) -> Array:
    """Covariance of tool poses from the board's `seen` (N, 4, 4) in the camera's frame and their own, (N, 6, 6)."""
    board = camera @ seen
    lever = lever_columns((board @ inverse(mount))[:, :3, 3] - board[:, :3, 3])
    turned = lever @ np.kron(np.eye(2), camera[:3, :3])
    return np.asarray(turned @ board_covariance @ turned.transpose(0, 2, 1))


def lever_columns(arms: Array) -> Array:
    """(N, 6, 6), shift and rotation vector of a body, seen at points `arms` (N, 3), m, from where it turns."""
    out = np.tile(np.eye(6), (len(arms), 1, 1))
    out[:, :3, 3:] = -skew(arms)
    return out


def _left(z: Array, tool: Array, seen: Array) -> Array:
    difference = pose_difference(_motion(z[:6]) @ seen @ inverse(_motion(z[6:])), tool)
    difference[:, 3:] *= LEVER
    return np.asarray(difference.ravel())


def _motion(z: Array) -> Array:
    return homogeneous(Rotation.from_rotvec(z[3:]).as_matrix(), z[:3])


def _twist(T: Array) -> Array:
    return np.concatenate([T[:3, 3], Rotation.from_matrix(T[:3, :3]).as_rotvec()])
