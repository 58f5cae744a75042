"""A camera's lens: pinhole with Brown's distortion (Brown 1966; Zhang 2000), calibrated from photos of the board."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from lrm_ident.measuring.camera.board import CharucoBoard, Corners
from lrm_ident.measuring.camera.opencv import opencv
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.toml_file import StrictSchema

FEWEST_PHOTOS = 8
TILTED = 10.0  # deg by which some boards must lean, else focal length and distance are one
Coefficients = Annotated[list[float], Field(min_length=5, max_length=5)]


class Lens(StrictSchema):
    """A lens, and its file, schema `lrm/camera/1`. `distortion`: k1, k2, p1, p2, k3. `noise_px`: of a corner."""

    schema_: Literal["lrm/camera/1"] = Field(alias="schema")
    width_px: int
    height_px: int
    focal_x_px: float
    focal_y_px: float
    centre_x_px: float
    centre_y_px: float
    distortion: Coefficients
    noise_px: float
    photos: int
    board: CharucoBoard

    @property
    def matrix(self) -> Array:
        """(3, 3), of the camera (px)."""
        return np.array([[self.focal_x_px, 0, self.centre_x_px], [0, self.focal_y_px, self.centre_y_px], [0, 0, 1.0]])

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of a picture (px)."""
        return self.width_px, self.height_px

    def project(self, points: Array) -> tuple[Array, Array]:
        """Pixels (n, 2) of points (n, 3) in the camera's frame (m), and their derivatives (n, 2, 3) (px/m)."""
        cv2, still = opencv(), np.zeros(3)
        pixels, J = cv2.projectPoints(points.reshape(-1, 1, 3), still, still, self.matrix, np.array(self.distortion))
        return pixels.reshape(-1, 2), np.asarray(J)[:, 3:6].reshape(-1, 2, 3)


def calibrate_lens(photos: Sequence[Corners], board: CharucoBoard, size: tuple[int, int]) -> Lens:
    """The lens from the corners of several photos of the board.

    Raises `LrmError`: too few photos, or boards that all face the camera.
    """
    if len(photos) < FEWEST_PHOTOS:
        right = f"take {FEWEST_PHOTOS} or more: leaning, near and far, at the edges"
        raise LrmError(f"{len(photos)} usable photos; {right}")
    cv2 = opencv()
    objects = [board.corners[corners.numbers].astype(np.float32) for corners in photos]
    pixels = [corners.pixels.astype(np.float32).reshape(-1, 1, 2) for corners in photos]
    rms, K, distortion, turns, _ = cv2.calibrateCamera(objects, pixels, size, None, None)
    normals = np.array([cv2.Rodrigues(turn)[0][:, 2] for turn in turns])
    lean = np.degrees(np.arccos(np.clip(np.abs(normals[:, 2]), 0.0, 1.0)))
    if np.sort(lean)[-3:].min() < TILTED:
        raise LrmError(f"the boards lean by {lean.max():.0f} deg at most; lean some by 20 to 45 deg, in all directions")
    numbers = sum(2 * len(corners.numbers) for corners in photos)
    noise = float(rms) / np.sqrt(2.0) * np.sqrt(numbers / max(numbers - 9 - 6 * len(photos), 1))
    return Lens(
        schema="lrm/camera/1",
        width_px=size[0],
        height_px=size[1],
        focal_x_px=float(K[0, 0]),
        focal_y_px=float(K[1, 1]),
        centre_x_px=float(K[0, 2]),
        centre_y_px=float(K[1, 2]),
        distortion=np.asarray(distortion).ravel()[:5].tolist(),
        noise_px=noise,
        photos=len(photos),
        board=board,
    )
