"""Photos of a printed board on an arm, rendered: lens distortion, blur, noise, exposure, a cluttered background.

Every pixel is traced back through the lens to the plane of the board; four rays a pixel.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from lrm_ident.measuring.camera.board import CharucoBoard
from lrm_ident.measuring.camera.lens import Lens
from lrm_ident.measuring.camera.opencv import opencv
from lrm_math.arrays import Array

RAYS = 2  # per pixel along either side
WEBCAM = Lens(
    schema="lrm/camera/1", width_px=1280, height_px=720, focal_x_px=922.0, focal_y_px=919.0, centre_x_px=646.0,
    centre_y_px=355.0, distortion=[0.07, -0.16, 0.0008, -0.0005, 0.06], noise_px=0.1, photos=20, board=CharucoBoard(),
)  # fmt: skip
"""A webcam of 70 degrees at 720p."""


@dataclass(frozen=True)
class PhotoScene:
    """Conditions of photos.

    Attributes:
        lens: the camera. blur: px, standard deviation. noise: grey levels. gain: exposure.
        mirrored: whether the print is. scale: how much larger the print is than stated.
    """

    lens: Lens = WEBCAM
    blur: float = 0.8
    noise: float = 2.5
    gain: float = 0.9
    mirrored: bool = False
    scale: float = 1.0

    def photo(self, board: CharucoBoard, pose: Array, seed: int) -> NDArray[np.uint8]:
        """(H, W), the photo of a board at a pose (4, 4), board to camera (m)."""
        cv2 = opencv()
        picture = _background(self.lens.size).copy()
        side = np.array(board.size) * self.scale
        edge = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
        rim = np.concatenate([edge * side * 1.12 - 0.06 * side, np.zeros((4, 1))], axis=1)
        seen = rim @ pose[:3, :3].T + pose[:3, 3]
        if (seen[:, 2] > 0.05).all():
            pixels, _ = self.lens.project(seen)
            low = np.clip(np.floor(pixels.min(axis=0)) - 3, 0, self.lens.size).astype(int)
            high = np.clip(np.ceil(pixels.max(axis=0)) + 4, 0, self.lens.size).astype(int)
            if (high - low > 4).all():
                picture[low[1] : high[1], low[0] : high[0]] = self._board(board, pose, low, high, picture)
        blurred = cv2.GaussianBlur(picture * np.float32(self.gain), (0, 0), self.blur)
        shift = (37 * seed % 211, 53 * seed % 307)
        noise = np.roll(_grain(self.lens.size), shift, axis=(0, 1)) * np.float32(self.noise)
        return np.asarray(np.clip(blurred + noise, 0, 255), dtype=np.uint8)

    def _board(self, board: CharucoBoard, pose: Array, low: Array, high: Array, behind: NDArray[np.float32]) -> Array:
        """Grey levels of a part of the picture, from pixel `low` to `high`."""
        cv2 = opencv()
        fine = [(np.arange((b - a) * RAYS) + 0.5) / RAYS - 0.5 + a for a, b in zip(low, high, strict=True)]
        u, v = np.meshgrid(*fine)
        pixels = np.stack([u.ravel(), v.ravel()], axis=1)
        rays = cv2.undistortPoints(pixels.reshape(-1, 1, 2), self.lens.matrix, np.array(self.lens.distortion)).reshape(
            -1, 2
        )
        rays = np.concatenate([rays, np.ones((len(rays), 1))], axis=1) @ pose[:3, :3]
        eye = -pose[:3, :3].T @ pose[:3, 3]
        with np.errstate(divide="ignore", invalid="ignore"):
            at = (eye + rays * (-eye[2] / rays[:, 2])[:, None])[:, :2] / (board.square_mm * 1e-3 * self.scale)
        texture = board.picture[:, ::-1] if self.mirrored else board.picture
        cells = np.floor(at * (texture.shape[1] / board.columns)).astype(int)
        inside = ((cells >= 0) & (cells < np.array(texture.shape[::-1]))).all(axis=1)
        paper = (at > -0.35) & (at < np.array([board.columns, board.rows]) + 0.35)
        part = behind[low[1] : high[1], low[0] : high[0]]
        grey = np.repeat(np.repeat(part, RAYS, axis=0), RAYS, axis=1).ravel().copy()
        grey[paper.all(axis=1)] = 225.0
        grey[inside] = np.where(texture[cells[inside, 1], cells[inside, 0]] > 127, 225.0, 22.0)
        fine_part = grey.reshape(u.shape).reshape(part.shape[0], RAYS, part.shape[1], RAYS)
        return np.asarray(fine_part.mean(axis=(1, 3)))


@lru_cache(maxsize=2)
def _background(size: tuple[int, int]) -> NDArray[np.float32]:
    y, x = np.mgrid[0 : size[1], 0 : size[0]]
    return np.asarray(120.0 + 40.0 * np.sin(x / 260.0) * np.cos(y / 190.0), dtype=np.float32)


@lru_cache(maxsize=2)
def _grain(size: tuple[int, int]) -> NDArray[np.float32]:
    """Noise of one grey level, shifted from photo to photo."""
    return np.random.default_rng(0).standard_normal(size[::-1]).astype(np.float32)
