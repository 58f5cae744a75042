"""Measurement files as spreadsheets and other programs write them; what is ambiguous is an error with its line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.data.measurement_file.column_names import column_name
from lrm_ident.data.measurement_file.known_columns import KNOWN
from lrm_ident.data.measurement_file.load import load_measurements, load_poses
from lrm_math.arm.arm import Arm
from lrm_math.errors import FileError
from tests.conftest import ROOT

ROWS = [(1, 10.5, -20.25, 30.0, 40.0, 5.5, 60.125, 101.5, -20.75, 300.25), (2, 0, 15, 3, -4, 50, 6, 99.5, 2.75, 0.5)]
NAMES = ["pose", *(f"q{i}_deg" for i in range(1, 7)), "x_mm", "y_mm", "z_mm"]


def text(
    names: list[str], delimiter: str = ",", comma: bool = False, rows: list[tuple[float, ...]] | None = None
) -> str:
    lines = [delimiter.join(names), *(delimiter.join(map(str, row)) for row in rows or ROWS)]
    return "\n".join([lines[0], *(line.replace(".", ",") if comma else line for line in lines[1:])]) + "\n"


def scaled(lengths: float, angles: float) -> list[tuple[float, ...]]:
    return [(row[0], *(v * angles for v in row[1:7]), *(v * lengths for v in row[7:])) for row in ROWS]


SAME: dict[str, bytes] = {
    "semicolons": text(NAMES, ";").encode(),
    "tabs": text(NAMES, "\t").encode(),
    "decimal commas": text(NAMES, ";", comma=True).encode(),
    "decimal commas and tabs": text(NAMES, "\t", comma=True).encode(),
    "byte order mark, Windows line ends": b"\xef\xbb\xbf" + text(NAMES).replace("\n", "\r\n").encode(),
    "Excel's sep line": ("sep=;\r\n" + text(NAMES, ";", comma=True).replace("\n", "\r\n")).encode("utf-8-sig"),
    "Excel's Unicode text": text(NAMES, "\t", comma=True).encode("utf-16"),
    "Excel's empty columns and rows": (text(NAMES, ";") + ";;;;;;;;;\n").replace("\n", ";;\n").encode(),
    "comment lines": ("# lab, Tuesday\n% second\n" + text(NAMES) + "// end\n").encode(),
    "numpy's header": ("# " + text(NAMES)).encode(),
    "quoted cells": text([f'"{name}"' for name in NAMES]).encode(),
    "capitals": text([name.upper() for name in NAMES]).encode(),
    "spaces": text([f" {name} " for name in NAMES], ", ").encode(),
    "no units": text(["Nr", *(f"Joint {i}" for i in range(1, 7)), "X", "Y", "Z"]).encode(),
    "units in brackets": text(["No.", *(f"J{i} [deg]" for i in range(1, 7)), "X (mm)", "Y (mm)", "Z (mm)"]).encode(),
    "tcp": text(["id", *(f"theta_{i}" for i in range(1, 7)), "tcp_x_mm", "tcp_y_mm", "tcp_z_mm"]).encode(),
    "from zero": text(["index", *(f"joint_{i}" for i in range(6)), "pos_x", "pos_y", "pos_z"]).encode(),
    "metres": text([*NAMES[:7], "x_m", "y_m", "z_m"], rows=scaled(1e-3, 1.0)).encode(),
    "radians": text(["", *(f"q{i} (rad)" for i in range(1, 7)), *NAMES[7:]], rows=scaled(1, np.pi / 180)).encode(),
    "minus signs of a word processor": text(NAMES).replace(",-", ",\u2212").encode(),
    "en dashes, spaces, lines of an old Mac": text(NAMES, "; ").replace("-", "\u2013").replace("\n", "\r").encode(),
    "no pose numbers": text(NAMES[1:], rows=[row[1:] for row in ROWS]).encode(),
}  # fmt: skip


@pytest.mark.parametrize("name", SAME)
def test_the_same_numbers_in_another_format(tmp_path: Path, lab: Arm, name: str) -> None:
    path = tmp_path / "data.csv"
    path.write_bytes(SAME[name])
    data = load_measurements(path, lab)
    np.testing.assert_allclose(np.degrees(data.poses.q), [row[1:7] for row in ROWS], atol=1e-9)
    np.testing.assert_allclose(data.tcp * 1e3, [row[7:] for row in ROWS], atol=1e-9)
    np.testing.assert_array_equal(data.pose, [1, 2])
    assert not any("last line" in words for words in data.notices)


AMBIGUOUS: dict[str, tuple[str, tuple[str, ...]]] = {
    "comma and point": (text(NAMES, ";").replace("300.25", "1,300.25"), ("line 2", "1,300.25")),
    "commas beside points": (text(NAMES, ";").replace("300.25", "300,25"), ("line 2", "300,25", "decimal point")),
    "thousands or decimals": (
        text(NAMES, ";", rows=[(1, 1, 2, 3, 4, 5, 6, "1,250", "2,500", 3)]),  # type: ignore[list-item]
        ("line 2", "1,250", "thousands"),
    ),
    "decimal commas between commas": (text(NAMES, comma=True), ("line 2", "header has 10")),
    "two columns for x": (text([*NAMES, "X [mm]"], rows=[(*row, 1.0) for row in ROWS]), ("line 1", "x_mm", "X [mm]")),
    "two columns for joint 2": (text([*NAMES, "J2"], rows=[(*row, 1.0) for row in ROWS]), ("q2_deg", "J2")),
    "more joints than the arm": (
        text([*NAMES, "q7"], rows=[(*row, 1.0) for row in ROWS]),
        ("7 joints", "lrm-lab has 6"),
    ),
    "no header": ("\n".join(text(NAMES).splitlines()[1:]) + "\n", ("line 1", "no header")),
    "an unknown unit": (text([*NAMES[:7], "x_furlong", "y_mm", "z_mm"]), ("header", "missing column x_mm")),
    "joints in mm": (text(["pose", "q1_mm", *NAMES[2:]]), ("header", "missing column q1_deg")),
    "approach of one joint": (
        text([*NAMES, "approach2"], rows=[(*row, 1.0) for row in ROWS]),
        ("no column approach1", "go together"),
    ),
    "delimiters alone": ("sep=|\n|||\n", ("is empty",)),
}


@pytest.mark.parametrize("name", AMBIGUOUS)
def test_ambiguity_is_an_error_that_shows_the_line(tmp_path: Path, lab: Arm, name: str) -> None:
    content, words = AMBIGUOUS[name]
    path = tmp_path / "data.csv"
    path.write_text(content)
    with pytest.raises(FileError) as caught:
        load_measurements(path, lab)
    for word in words:
        assert word in str(caught.value)


def test_names_that_are_read_otherwise_are_told(tmp_path: Path, lab: Arm) -> None:
    path = tmp_path / "data.csv"
    path.write_text(text([*NAMES[:7], "tcp_x", "y_mm", "z_mm"]))
    (notice,) = load_measurements(path, lab).notices
    assert "x_mm = 'tcp_x'" in notice


def test_poses_take_the_same_names(tmp_path: Path, lab: Arm) -> None:
    path = tmp_path / "poses.csv"
    path.write_text(text([f"J{i}" for i in range(1, 7)], ";", comma=True, rows=[row[1:7] for row in ROWS]))
    np.testing.assert_allclose(np.degrees(load_poses(path, lab).q), [row[1:7] for row in ROWS])


@pytest.mark.parametrize("begin", ["Format Version,1.23,Take Name,t", "Objects", "Trajectories;;", "fr 7"])
def test_a_recording_is_sent_to_import(tmp_path: Path, lab: Arm, begin: str) -> None:
    path = tmp_path / "take.csv"
    path.write_text(f"{begin}\n\n,Type,Rigid Body\n")
    with pytest.raises(FileError, match="a tracker's recording; lrm-ident import"):
        load_measurements(path, lab)


def test_of_two_statements_of_the_noise_the_one_not_used_is_told(tmp_path: Path, lab: Arm) -> None:
    path = tmp_path / "data.csv"
    path.write_text(text([*NAMES, "sd_mm"], rows=[[*row, 0.1] for row in ROWS]))
    assert load_measurements(path, lab).notices == ()
    path.with_suffix(".toml").write_text('schema = "lrm/measurements/1"\nnoise_sd_mm = 0.5\n')
    (notice,) = load_measurements(path, lab).notices
    assert "noise_sd_mm of the file beside the data is not used" in notice


@given(st.text(max_size=12))
def test_any_text_is_a_name_or_not(name: str) -> None:
    found = column_name(name)
    assert found is None or (found.factor > 0 and found.name)


@pytest.mark.parametrize(
    "name", ["x_nominal", "x_err", "q1_meas_deg", "distance_deg", "x y", "xx", "q", "qx1", "x_kg", "q1 [mm]"]
)
def test_other_columns_are_left_alone(name: str) -> None:
    assert column_name(name) is None


SIDECARS: dict[str, Callable[[Path], None]] = {
    "a model": lambda path: path.write_text('schema = "lrm/model/1"\narm = "lrm-lab"\neffects = []\n') and None,
    "an arm": lambda path: path.write_text('schema = "lrm/arm/1"\n') and None,
}


@pytest.mark.parametrize("name", SIDECARS)
def test_a_file_beside_is_known_by_its_schema(tmp_path: Path, lab: Arm, name: str) -> None:
    path = tmp_path / "run1.csv"
    path.write_text(text(NAMES))
    SIDECARS[name](path.with_suffix(".toml"))
    (notice,) = load_measurements(path, lab).notices
    assert "run1.toml" in notice
    assert "schema" in notice or "lrm/" in notice


def test_every_column_is_documented() -> None:
    documented = (ROOT / "docs" / "files.md").read_text(encoding="utf-8")
    assert [known.name for known in KNOWN if known.columns[0] not in documented] == []
