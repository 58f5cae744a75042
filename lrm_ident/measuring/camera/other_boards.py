"""Boards of other makers: what a board in a photo is, where the stated one is not seen in it.

Other programs print the pattern of OpenCV before 4.6 and other dictionaries, and count columns and rows the other way.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import islice, product

import numpy as np
from numpy.typing import NDArray

from lrm_ident.measuring.camera.board import (
    DICTIONARIES,
    FEWEST,
    CharucoBoard,
    detected,
    marker_numbers,
)

LOOKED_AT = 3
"""Photos that are looked at: every dictionary takes as long as the stated board."""


def other_board(pictures: Iterable[NDArray[np.uint8]], board: CharucoBoard) -> str:
    """The board that is in some photos (H, W), in words and with the options that read it; empty if none is."""
    for picture in islice(pictures, LOOKED_AT):
        for other in _others(picture, board):
            if len(detected(picture, other).numbers) >= FEWEST:
                return _words(board, other)
    return ""


def _others(picture: NDArray[np.uint8], board: CharucoBoard) -> Iterator[CharucoBoard]:
    """The board laid out otherwise, and in the dictionary whose markers are in the photo, the stated one first."""
    yield from _layouts(board)
    of_another = {name: len(marker_numbers(picture, name)) for name in DICTIONARIES}
    most = max(of_another.values())
    for name, count in of_another.items():  # the smallest of a family that has all of its markers
        if count == most > 0 and name != board.dictionary:
            other = _changed(board, dictionary=name)
            if other.fits:
                yield other
                yield from _layouts(other)


def _layouts(board: CharucoBoard) -> Iterator[CharucoBoard]:
    sizes = dict.fromkeys([(board.columns, board.rows), (board.rows, board.columns)])
    for (columns, rows), legacy in product(sizes, (False, True)):
        other = _changed(board, columns=columns, rows=rows, legacy=legacy)
        if other != board and other.fits:
            yield other


def _changed(board: CharucoBoard, **fields: object) -> CharucoBoard:
    """The board with other fields; a copy would keep what was computed of it."""
    return CharucoBoard.model_validate(board.model_dump() | fields)


def _words(board: CharucoBoard, other: CharucoBoard) -> str:
    options, words = [], []
    if other.dictionary != board.dictionary:
        words.append(f"its markers are of the dictionary {other.dictionary}")
        options.append(f"--dictionary {other.dictionary}")
    if (other.columns, other.rows) != (board.columns, board.rows):
        words.append(f"it has {other.columns} columns and {other.rows} rows")
        options.append(f"--columns {other.columns} --rows {other.rows}")
    if other.legacy != board.legacy:
        words.append("it has the pattern of OpenCV before 4.6" if other.legacy else "it has no legacy pattern")
        options.append("--legacy" if other.legacy else "--no-legacy")
    return f"the board is there, but {' and '.join(words)}: give {' '.join(options)}"
