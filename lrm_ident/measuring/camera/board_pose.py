"""Pose of the board in the camera's frame and its covariance from the corners' reprojection (PnP).

A plane seen from afar has two poses that look nearly alike (Collins & Bartoli 2014): where the second fits nearly as
well, the photo is refused.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lrm_ident.data.rigid_motion import homogeneous, skew
from lrm_ident.measuring.camera.board import Corners, RejectedPhoto, find_corners
from lrm_ident.measuring.camera.capture import Picture
from lrm_ident.measuring.camera.lens import Lens
from lrm_ident.measuring.camera.opencv import opencv
from lrm_math.arrays import Array
from lrm_math.errors import LrmError

STEPS = 20
AMBIGUOUS = 25.0  # squared noise by which the better of the two poses must win
POOR = 4.0  # times the lens's noise that corners may be off
A_DEGREE_APART = 2.9996  # trace of the rotation from one pose to another


@dataclass(frozen=True, eq=False)
class BoardPose:
    """Pose of a board.

    Attributes:
        rotation, position: (3, 3) and (3,), m, board to camera.
        covariance: (6, 6), of position and rotation vector in the camera's axes (m, rad).
        noise: px per axis, RMS of the corners. corners: their number.
    """

    rotation: Array
    position: Array
    covariance: Array
    noise: float
    corners: int

    @property
    def matrix(self) -> Array:
        """(4, 4), board to camera."""
        return homogeneous(self.rotation, self.position)

    @property
    def of_camera(self) -> BoardPose:
        """The same seen from the board: pose of the camera in the board's frame."""
        R = self.rotation.T
        J = -np.block([[R, R @ skew(self.position)], [np.zeros((3, 3)), R]])
        return replace(self, rotation=R, position=-R @ self.position, covariance=J @ self.covariance @ J.T)


def find_board(name: str, picture: Picture, lens: Lens) -> BoardPose | RejectedPhoto:
    """The pose of the board in a picture of that name. Raises `LrmError`: it is of another size than the lens."""
    if picture.shape[::-1] != lens.size:
        size, right = ("{} × {}".format(*size) for size in (picture.shape[::-1], lens.size))
        raise LrmError(f"{name}: {size} pixels; its lens was calibrated for {right}")
    corners = find_corners(picture, lens.board)
    return corners if isinstance(corners, RejectedPhoto) else board_pose(corners, lens)


def board_pose(corners: Corners, lens: Lens) -> BoardPose | RejectedPhoto:
    """The pose of the board whose corners were found."""
    cv2, points = opencv(), lens.board.corners[corners.numbers]
    _, turns, shifts, _ = cv2.solvePnPGeneric(
        points.astype(np.float64), corners.pixels, lens.matrix, np.array(lens.distortion), flags=cv2.SOLVEPNP_IPPE
    )
    tried = [
        _refined(cv2.Rodrigues(turn)[0], np.asarray(shift).ravel(), points, corners.pixels, lens)
        for turn, shift in zip(turns, shifts, strict=True)
    ]
    tried.sort(key=lambda solution: solution[2])
    rotation, position, square, information = tried[0]
    noise = float(np.sqrt(square / (2 * len(points) - 6)))
    if position[2] <= 0.0:
        return RejectedPhoto("the board would be behind the camera")
    if noise > POOR * lens.noise_px:
        return RejectedPhoto(
            f"the corners are off by {noise:.2f} px; the lens was calibrated to {lens.noise_px:.2f} px"
        )
    worse = [solution[2] - square for solution in tried[1:] if np.trace(solution[0].T @ rotation) < A_DEGREE_APART]
    if worse and worse[0] < AMBIGUOUS * lens.noise_px**2:
        return RejectedPhoto("two poses of the board fit alike; lean it against the view, or come closer")
    covariance: Array = np.asarray(np.linalg.inv(information) * lens.noise_px**2)
    return BoardPose(rotation, position, covariance, noise, len(points))


def _refined(R: Array, t: Array, points: Array, pixels: Array, lens: Lens) -> tuple[Array, Array, float, Array]:
    """Gauss–Newton on the reprojection: rotation, position, sum of squares (px²), information JᵀJ (6, 6)."""
    cv2 = opencv()
    for _ in range(STEPS):
        seen, J = _linearised(R, t, points, lens)
        step = np.linalg.lstsq(J, (pixels - seen).ravel(), rcond=None)[0]
        t = t + step[:3]
        R = cv2.Rodrigues(step[3:])[0] @ R
        if np.abs(step).max() < 1e-10:
            break
    seen, J = _linearised(R, t, points, lens)
    return R, t, float(((pixels - seen) ** 2).sum()), J.T @ J


def covariance_at(pose: Array, lens: Lens) -> Array:
    """(6, 6), covariance of a board's pose (4, 4) from a photo of all of its corners, as of `BoardPose`."""
    _, J = _linearised(pose[:3, :3], pose[:3, 3], lens.board.corners, lens)
    return np.asarray(np.linalg.inv(J.T @ J) * lens.noise_px**2)


def _linearised(R: Array, t: Array, points: Array, lens: Lens) -> tuple[Array, Array]:
    """Pixels (n, 2) and their derivatives (2 n, 6) for a shift and a rotation vector in the camera's axes."""
    arms = points @ R.T
    seen, G = lens.project(arms + t)
    return seen, np.concatenate([G, -G @ skew(arms)], axis=2).reshape(-1, 6)  # δ × arm = −arm × δ
