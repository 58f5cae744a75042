"""The board's corners in a photo, or why the photo is of no use."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrm_ident.measuring.camera.board import CharucoBoard
from lrm_ident.measuring.camera.opencv import opencv
from lrm_math.arrays import Array

FEWEST = 8  # corners: 16 numbers for a pose of six
BLURRED = 1.7  # px, standard deviation of the blur of an edge: beyond, corners are lost
SATURATED = 0.98  # share of the board's pixels at the end of the scale
CORNERS_OF_REGION = 2.0  # px around the outermost corners


@dataclass(frozen=True, eq=False)
class Corners:
    """Corners of the board found in a photo: their `numbers` (n,) and `pixels` (n, 2)."""

    numbers: NDArray[np.int64]
    pixels: Array


@dataclass(frozen=True)
class RejectedPhoto:
    """A photo that is of no use, and why."""

    reason: str


def find_corners(picture: NDArray[np.uint8], board: CharucoBoard) -> Corners | RejectedPhoto:
    """The corners in a grey picture (H, W)."""
    found = _detect(picture, board)
    if len(found.numbers) < FEWEST:
        mirrored = _detect(np.ascontiguousarray(picture[:, ::-1]), board)
        if len(mirrored.numbers) >= FEWEST:
            return RejectedPhoto("the board is mirrored: print it unmirrored, or turn off the camera's mirror image")
        return RejectedPhoto(f"{len(found.numbers)} of {len(board.corners)} corners seen, {FEWEST} are needed")
    if np.linalg.matrix_rank(board.corners[found.numbers, :2] - board.corners[found.numbers[0], :2]) < 2:
        return RejectedPhoto("the corners seen are all in one row")
    return _quality(picture, found) or found


def _detect(picture: NDArray[np.uint8], board: CharucoBoard) -> Corners:
    cv2 = opencv()
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.CharucoDetector(board.charuco, cv2.aruco.CharucoParameters(), parameters)
    pixels, numbers, _, _ = detector.detectBoard(picture)
    if numbers is None:
        return Corners(np.zeros(0, dtype=np.int64), np.zeros((0, 2)))
    return Corners(np.asarray(numbers, dtype=np.int64).ravel(), np.asarray(pixels, dtype=np.float64).reshape(-1, 2))


def _quality(picture: NDArray[np.uint8], corners: Corners) -> RejectedPhoto | None:
    """Reason why a picture of the board is too poor, if it is: blurred edges, or burnt out."""
    low = np.maximum(corners.pixels.min(axis=0) - CORNERS_OF_REGION, 0).astype(int)
    high = (corners.pixels.max(axis=0) + CORNERS_OF_REGION).astype(int) + 1
    region = picture[low[1] : high[1], low[0] : high[0]].astype(np.float64)
    dark, bright = np.percentile(region, [5, 95])
    if bright - dark < 25.0:
        return RejectedPhoto(f"hardly any contrast ({bright - dark:.0f} of 255 grey levels)")
    if np.mean((region < 2) | (region > 253)) > SATURATED:
        return RejectedPhoto("over- or underexposed")
    down, right = np.gradient(region)
    steepest = float(np.percentile(np.hypot(down, right), 98))
    blur = (bright - dark) / (np.sqrt(2.0 * np.pi) * max(steepest, 1e-9))
    if blur > BLURRED:
        return RejectedPhoto(f"blurred: edges are {2.0 * blur:.1f} px wide; more light, or hold still")
    return None
