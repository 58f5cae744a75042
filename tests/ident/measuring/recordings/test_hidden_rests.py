"""Rests in which the tip is hidden count as rests, and are left out; exports that Excel saved again are read."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from lrm_ident.data.measurement_file.number_table import numbers_of, read_csv
from tests.ident.data.test_newcomer_tables import workbook
from tests.ident.measuring.recordings.test_recordings import motive, poses
from tests.support.commands import stderr_of, stdout_of

HEADER_LINES = 8
BODIES = ("--arm", "lrm-lab", "--tool", "Tool", "--base", "Base")


def hidden(path: Path, begin: int, end: int) -> Path:
    """The export with the tool unseen in these frames."""
    lines = path.read_text().splitlines()
    for k in range(begin, end):
        cells = lines[k + HEADER_LINES].split(",")
        lines[k + HEADER_LINES] = ",".join([*cells[:10], *[""] * 8, *cells[18:]])
    path.write_text("\n".join(lines) + "\n")
    return path


def numbers(data: Path) -> list[float]:
    return [float(number) for number in numbers_of(read_csv(data, ["pose"]), "pose")]


@pytest.mark.long
@pytest.mark.parametrize(("begin", "end"), [(380, 720), (480, 700), (560, 700)], ids=["whole", "most", "the end"])
def test_a_hidden_rest_is_found_by_its_gap_and_left_out(tmp_path: Path, begin: int, end: int) -> None:
    source, data = hidden(motive(tmp_path / "take.csv"), begin, end), tmp_path / "data.csv"
    said = stdout_of("import", source, poses(tmp_path), *BODIES, "-o", data)
    assert "left out: pose 2: target 1 unseen" in said
    assert numbers(data) == [1, 3, 4]


def test_a_short_gap_on_the_way_is_no_rest(tmp_path: Path) -> None:
    source, data = hidden(motive(tmp_path / "take.csv"), 305, 390), tmp_path / "data.csv"
    stdout_of("import", source, poses(tmp_path), *BODIES, "-o", data)
    assert numbers(data) == [1, 2, 3, 4]


def test_rests_shorter_than_twice_the_dwell_name_the_dwell_that_finds_them(tmp_path: Path) -> None:
    source, data = motive(tmp_path / "take.csv"), tmp_path / "data.csv"
    words = ["import", source, poses(tmp_path), *BODIES, "-o", data]
    said = stderr_of(*words, "--dwell", "1.7")
    assert "a rest lasts 3.4 s (twice --dwell) or more" in said
    named = re.search(r"(--dwell) ([\d.]+) finds as many", said)
    assert named is not None
    stdout_of(*words, *named.groups())
    assert numbers(data) == [1, 2, 3, 4]


def cells_of(path: Path) -> list[list[str]]:
    return list(csv.reader(path.read_text().splitlines()))


def as_semicolons(path: Path) -> Path:
    """The file saved by Excel where commas are decimal."""
    rows = cells_of(path)
    wide = max(map(len, rows))
    lines = [";".join([*(cell.replace(".", ",") for cell in row), *[""] * (wide - len(row))]) for row in rows[1:]]
    path.write_text("\n".join(["sep=;", ";".join(rows[0]), *lines]) + "\n")
    return path


def as_workbook(path: Path) -> Path:
    rows: list[list[object]] = [
        [float(cell) if re.fullmatch(r"-?[\d.]+", cell) else cell for cell in row] for row in cells_of(path)
    ]
    return workbook(path.with_suffix(".xlsx"), rows)


@pytest.mark.long
@pytest.mark.parametrize("saved", [as_semicolons, as_workbook])
def test_what_excel_saved_again_is_the_same_on_either_side(tmp_path: Path, saved: Callable[[Path], Path]) -> None:
    first, again = tmp_path / "first.csv", tmp_path / "again.csv"
    stdout_of("import", motive(tmp_path / "take.csv"), poses(tmp_path), *BODIES, "-o", first)
    source, driven = saved(tmp_path / "take.csv"), saved(tmp_path / "poses.csv")
    stdout_of("import", source, driven, *BODIES, "-o", again)
    one, other = (np.genfromtxt(path, delimiter=",", skip_header=1) for path in (first, again))
    np.testing.assert_allclose(one, other, atol=1e-3)
