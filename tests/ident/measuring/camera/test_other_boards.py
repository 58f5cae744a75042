"""Boards of other makers: an older pattern, another dictionary, columns for rows; each remedy that is named helps."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("cv2", reason="OpenCV is not installed (extra 'camera')")

from lrm_ident.measuring.camera.board import DICTIONARIES, CharucoBoard, Dictionary, board_pdf, detected
from lrm_ident.measuring.camera.opencv import opencv
from tests.support.commands import stderr_of
from tests.support.sweep import soak
from validation.camera.rendered_photos import PhotoScene

BOARDS = {
    "--legacy": CharucoBoard(rows=4, legacy=True),
    "--dictionary 5X5_50": CharucoBoard(rows=4, dictionary="5X5_50"),
    "--columns 4 --rows 6": CharucoBoard(columns=4, rows=6),
    "--dictionary APRILTAG_36h11 --columns 4 --rows 6": CharucoBoard(columns=4, rows=6, dictionary="APRILTAG_36h11"),
    "--dictionary 6X6_50 --legacy": CharucoBoard(rows=4, dictionary="6X6_50", legacy=True),
}
"""By the options that read each of them beside `--columns 6 --rows 4`."""


def photo(folder: Path, board: CharucoBoard) -> Path:
    """A folder with a photo of a board, a little askew."""
    folder.mkdir()
    pose = np.eye(4)
    pose[:3, :3] = opencv().Rodrigues(np.array([0.2, -0.25, 0.1]))[0]
    pose[:3, 3] = -0.045, -0.035, 0.17
    opencv().imwrite(str(folder / "p.png"), PhotoScene().photo(board, pose, 0))
    return folder


@pytest.mark.long
@pytest.mark.parametrize("options", [*list(BOARDS)[:2], *soak(*list(BOARDS)[2:])])
def test_another_board_is_named_with_the_options_that_read_it(tmp_path: Path, options: str) -> None:
    folder, out = photo(tmp_path / "photos", BOARDS[options]), tmp_path / "lens.toml"
    words = ["camera", "calibrate", folder, "--columns", "6", "--rows", "4", "-o", out]
    said = stderr_of(*words)
    assert f"give {options}" in said
    assert "1 usable photos" in stderr_of(*words, *shlex.split(options))


@pytest.mark.long
def test_a_board_of_todays_pattern_is_named_where_the_older_one_was_stated(tmp_path: Path) -> None:
    folder = photo(tmp_path / "photos", CharucoBoard(rows=4))
    words = ["camera", "calibrate", folder, "--columns", "6", "--rows", "4", "-o", tmp_path / "lens.toml"]
    assert "give --no-legacy" in stderr_of(*words, "--legacy")
    assert "1 usable photos" in stderr_of(*words, "--no-legacy")


def test_a_photo_without_any_board_names_none(tmp_path: Path) -> None:
    (tmp_path / "photos").mkdir()
    opencv().imwrite(str(tmp_path / "photos" / "p.png"), np.full((200, 300), 120, dtype=np.uint8))
    said = stderr_of("camera", "calibrate", tmp_path / "photos", "-o", tmp_path / "lens.toml")
    assert "0 of 20 corners seen, 8 are needed" in said


@pytest.mark.parametrize("dictionary", DICTIONARIES)
def test_a_printed_board_of_any_dictionary_is_its_own(dictionary: Dictionary) -> None:
    board = CharucoBoard(dictionary=dictionary)
    assert board_pdf(board, "a4").startswith(b"%PDF")
    grey = np.pad(np.kron(board.picture, np.ones((3, 3))), 40, constant_values=255).astype(np.uint8)
    assert len(detected(grey, board).numbers) == 20


def test_a_dictionary_that_is_none_and_one_that_is_too_small(tmp_path: Path) -> None:
    words = ("camera", "board", "-o", tmp_path / "b.pdf", "--dictionary")
    assert "unknown dictionary '4X4_51'" in stderr_of(*words, "4X4_51")
    said = stderr_of(*words, "APRILTAG_16h5", "--columns", "12", "--rows", "8", "--square-mm", "10")
    assert "need 48 markers; APRILTAG_16h5 has 30" in said
