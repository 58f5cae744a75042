"""A ChArUco board (Garrido-Jurado et al. 2014): a chessboard with a marker in every white square.

Printed as a page, and its corners found in a photo, or why that is of no use.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from lrm_ident.measuring.camera.opencv import opencv
from lrm_ident.measuring.pdf_page import MARGIN, RULER, paper_size, pdf_file, ruler_of_100_mm, words_at
from lrm_math.arm.arm_file import MM
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.toml_file import StrictSchema

PIXELS = 16
"""Pixels of one square in a picture: a marker is 12 of them, two for each of six modules."""
MARKER = 12 / 16
"""Edge of a marker over that of its square."""
FEWEST = 8  # corners: 16 numbers for a pose of six
BLURRED = 1.7  # px, standard deviation of the blur of an edge: beyond, corners are lost
SATURATED = 0.98  # share of the board's pixels at the end of the scale
CORNERS_OF_REGION = 2.0  # px around the outermost corners


Dictionary = Literal[
    "4X4_50", "4X4_100", "4X4_250", "4X4_1000", "5X5_50", "5X5_100", "5X5_250", "5X5_1000", "6X6_50", "6X6_100",
    "6X6_250", "6X6_1000", "7X7_50", "7X7_100", "7X7_250", "7X7_1000", "ARUCO_ORIGINAL", "APRILTAG_16h5",
    "APRILTAG_25h9", "APRILTAG_36h10", "APRILTAG_36h11",
]  # fmt: skip
"""Dictionaries of markers, by OpenCV's names, the smallest of a family first."""
DICTIONARIES: tuple[Dictionary, ...] = get_args(Dictionary)


class CharucoBoard(StrictSchema):
    """A board of `columns` × `rows` squares with edges of `square_mm`; markers of 3/4 of that of a `dictionary`.

    `legacy`: laid out as by OpenCV before 4.6, where the first square of a board with even rows is white.
    Its frame stands in its first corner, x along its columns, y down its rows, z into the paper (m).
    """

    columns: Annotated[int, Field(ge=3, le=20)] = 6
    rows: Annotated[int, Field(ge=3, le=20)] = 5
    square_mm: Annotated[float, Field(gt=1.0, le=200.0)] = 15.0
    dictionary: Dictionary = "4X4_50"
    legacy: bool = False

    def __str__(self) -> str:
        return f"{self.columns} × {self.rows} squares of {self.square_mm:g} mm"

    @cached_property
    def charuco(self) -> Any:
        """OpenCV's board. Raises `LrmError` if it has more markers than the dictionary."""
        cv2, (columns, rows), square = opencv(), (self.columns, self.rows), self.square_mm * MM
        markers = _markers(self.dictionary)
        if not self.fits:
            what = f"{columns} × {rows} squares need {columns * rows // 2} markers"
            raise LrmError(f"{what}; {self.dictionary} has {len(markers.bytesList)}: --dictionary 4X4_250")
        charuco = cv2.aruco.CharucoBoard((columns, rows), square, MARKER * square, markers)
        charuco.setLegacyPattern(self.legacy)
        return charuco

    @property
    def fits(self) -> bool:
        """Whether the dictionary has as many markers."""
        return self.columns * self.rows // 2 <= len(_markers(self.dictionary).bytesList)

    @property
    def corners(self) -> Array:
        """(C, 3), inner corners of the chessboard (m), by number."""
        return np.asarray(self.charuco.getChessboardCorners(), dtype=np.float64)

    @property
    def size(self) -> tuple[float, float]:
        """Width and height (m)."""
        return self.columns * self.square_mm * MM, self.rows * self.square_mm * MM

    @property
    def picture(self) -> NDArray[np.uint8]:
        """(P rows, P columns), black 0 and white 255; P pixels of a square are whole ones of a marker's modules."""
        pixels = pixels_of_square(self)
        size = (pixels * self.columns, pixels * self.rows)
        return np.asarray(self.charuco.generateImage(size, marginSize=0, borderBits=1), dtype=np.uint8)


def _markers(dictionary: str) -> Any:
    """OpenCV's dictionary of a name."""
    cv2 = opencv()
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{dictionary}"))


def pixels_of_square(board: CharucoBoard) -> int:
    """Pixels of one square in a picture: two for each of six modules of a marker, six of any other number."""
    modules = int(_markers(board.dictionary).markerSize) + 2
    return PIXELS if modules == 6 else 8 * modules


def board_pdf(board: CharucoBoard, paper: str) -> bytes:
    """A page (PDF 1.4) with the board at true scale, its size in words, and a ruler of 100 mm.

    Raises `LrmError`: no such paper, or a board that does not fit on it.
    """
    width, height = paper_size(paper)
    board_width, board_height = (1e3 * side for side in board.size)
    if board_width > width - 2 * MARGIN or board_height > height - 60.0:
        need = f"{board_width:g} × {board_height:g} mm"
        raise LrmError(f"a board of {need} does not fit on {paper}; fewer or smaller squares (--columns, --square-mm)")
    pixels = board.picture
    bits = zlib.compress(np.packbits(pixels > 127, axis=1).tobytes())
    rows, columns = pixels.shape
    image = (
        f"<< /Type /XObject /Subtype /Image /Width {columns} /Height {rows} /ColorSpace /DeviceGray "
        f"/BitsPerComponent 1 /Interpolate false /Filter /FlateDecode /Length {len(bits)} >>\nstream\n"
    ).encode() + bits + b"\nendstream"  # fmt: skip
    return pdf_file(width, height, _drawing(board, width, height), [image])


def _drawing(board: CharucoBoard, width: float, height: float) -> Iterator[str]:
    """Operators of the page; lengths in mm."""
    board_width, board_height = (1e3 * side for side in board.size)
    x_left, bottom = (width - board_width) / 2.0, height - MARGIN - 10.0 - board_height
    yield f"q {board_width:.4f} 0 0 {board_height:.4f} {x_left:.4f} {bottom:.4f} cm /Picture1 Do Q"
    size, marker = f"{board.columns} x {board.rows}", MARKER * board.square_mm
    words = f"ChArUco {size}, squares {board.square_mm:g} mm, markers {marker:g} mm, {board.dictionary}"
    yield words_at(x_left, bottom - 6.0, words)
    ruler, start = bottom - 22.0, (width - RULER) / 2.0
    yield from ruler_of_100_mm(start, ruler)
    yield words_at(start, ruler - 10.0, "Glue the board on something flat and stiff; matt paper, no gloss.")


def read_picture(path: Path) -> NDArray[np.uint8]:
    """A photo in grey (H, W). Raises `LrmError` if it cannot be read."""
    picture = opencv().imread(str(path), 0)
    if picture is None:
        raise LrmError(f"{path}: cannot be read as a picture")
    return np.asarray(picture, dtype=np.uint8)


@dataclass(frozen=True, eq=False)
class Corners:
    """Corners of the board found in a photo: their `numbers` (n,) and `pixels` (n, 2)."""

    numbers: NDArray[np.int64]
    pixels: Array


@dataclass(frozen=True)
class RejectedPhoto:
    """A photo that is of no use, and why."""

    reason: str


MIRRORED = RejectedPhoto("the board is mirrored: print it unmirrored, or turn off the camera's mirror image")


def find_corners(picture: NDArray[np.uint8], board: CharucoBoard) -> Corners | RejectedPhoto:
    """The corners in a grey picture (H, W)."""
    corners = detected(picture, board)
    if len(corners.numbers) < FEWEST:
        mirrored = detected(np.ascontiguousarray(picture[:, ::-1]), board)
        if len(mirrored.numbers) >= FEWEST:
            return MIRRORED
        return RejectedPhoto(f"{len(corners.numbers)} of {len(board.corners)} corners seen, {FEWEST} are needed")
    if np.linalg.matrix_rank(board.corners[corners.numbers, :2] - board.corners[corners.numbers[0], :2]) < 2:
        return RejectedPhoto("the corners seen are all in one row")
    return _quality(picture, corners) or corners


def detected(picture: NDArray[np.uint8], board: CharucoBoard) -> Corners:
    """All corners of a board that OpenCV sees in a grey picture (H, W)."""
    cv2 = opencv()
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.CharucoDetector(board.charuco, cv2.aruco.CharucoParameters(), parameters)
    pixels, numbers, _, _ = detector.detectBoard(picture)
    if numbers is None:
        return Corners(np.zeros(0, dtype=np.int64), np.zeros((0, 2)))
    return Corners(np.asarray(numbers, dtype=np.int64).ravel(), np.asarray(pixels, dtype=np.float64).reshape(-1, 2))


def marker_numbers(picture: NDArray[np.uint8], dictionary: str) -> list[int]:
    """Numbers of the markers of a dictionary in a grey picture (H, W), each once."""
    _, numbers, _ = opencv().aruco.ArucoDetector(_markers(dictionary)).detectMarkers(picture)
    return [] if numbers is None else sorted({*np.asarray(numbers).ravel().tolist()})


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
