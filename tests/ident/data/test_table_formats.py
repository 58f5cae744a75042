"""Measurement files as spreadsheets, trackers and newcomers write them; what is ambiguous is an error."""

from __future__ import annotations

import random
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.data.measurement_file.column_names import column_name
from lrm_ident.data.measurement_file.known_columns import KNOWN
from lrm_ident.data.measurement_file.load import load_measurements, load_poses
from lrm_ident.data.measurement_file.times import seconds_of
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.observations.encoder_readings import EncoderReadings
from lrm_ident.data.registration.checked import Misread, load_checked
from lrm_ident.data.table_text.csv_file import read_table, read_text
from lrm_ident.data.table_text.workbook import sheets_of
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm, read_arm
from lrm_math.errors import FileError
from lrm_math.model.reading import Reading
from lrm_math.toml_file import parse_toml
from tests.conftest import EXAMPLE, ROOT
from tests.support.commands import stderr_of, stdout_of
from tests.support.sweep import examples, seeds

ROWS = [(1, 10.5, -20.25, 30.0, 40.0, 5.5, 60.125, 101.5, -20.75, 300.25), (2, 0, 15, 3, -4, 50, 6, 99.5, 2.75, 0.5)]
NAMES = ["pose", *(f"q{i}_deg" for i in range(1, 7)), "x_mm", "y_mm", "z_mm"]


def text(
    names: list[str], delimiter: str = ",", comma: bool = False, rows: list[tuple[float, ...]] | None = None
) -> str:
    lines = [delimiter.join(names), *(delimiter.join(map(str, row)) for row in rows or ROWS)]
    return "\n".join([lines[0], *(line.replace(".", ",") if comma else line for line in lines[1:])]) + "\n"


def scaled(lengths: float, angles: float) -> list[tuple[float, ...]]:
    return [(row[0], *(v * angles for v in row[1:7]), *(v * lengths for v in row[7:])) for row in ROWS]


def joined(delimiter: str, *rows: Sequence[object]) -> bytes:
    """Lines of cells."""
    return "".join(delimiter.join(map(str, row)) + "\n" for row in rows).encode()


SHORT, UNITS = [*(f"J{i}" for i in range(1, 7)), "X", "Y", "Z"], [*["°"] * 6, *["mm"] * 3]
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
    "names in German": text(
        ["Nr", *(f"Gelenk{i} [°]" for i in range(1, 7)), "X in cm", "Y in cm", "Z in cm"], rows=scaled(0.1, 1.0)
    ).encode(),
    "another stem": text(["Nr", *(f"Achse {i}" for i in range(6)), "X", "Y", "Z"]).encode(),
    "a title above": ("Messung vom 3. Mai, erster Arm\n\n" + text(NAMES)).encode(),
    "a title with many commas": ("Messung, 3. Mai, erster Arm, mit Last, im Labor, Tag 2\n" + text(NAMES)).encode(),
    "a date with a point and a comma": joined(
        ",", [*NAMES, "Date"], *([*row, '"01.02,2024"'] for row in ROWS)
    ),
    "a title above, decimal commas": ("Messung; 3. Mai\n" + text(NAMES, ";", comma=True)).encode(),
    "a title above, empty rows below": ("Messung;;;;;;;;;\n" + text(NAMES, ";") + ";;;;;;;;;\n").encode(),
    "files put together": joined(",", SHORT, UNITS, ROWS[0][1:], SHORT, UNITS, ROWS[1][1:]),
    "a unit of a column that is not used": joined(
        ",", ["Nr", *SHORT, "Quality"], ["", *UNITS, "%"], *([*row, 95] for row in ROWS)
    ),
    "a note with a comma and a point": joined(
        ";", [*NAMES, "Note"], *([*(str(v).replace(".", ",") for v in row), "ok, 2. try"] for row in ROWS)
    ),
    "decimal commas in quotes": joined(",", NAMES, *([f'"{v}"'.replace(".", ",") for v in row] for row in ROWS)),
    "bars": text(NAMES, "|").encode(),
    "a name in two lines": text(["pose", '"q1\n[deg]"', *NAMES[2:]]).encode(),
    "two columns of notes": joined(",", [*NAMES, "note", "note"], *([*row, "a", "b"] for row in ROWS)),
    "inch marks in notes": joined(",", [*NAMES, "note"], *([*row, '3" tool'] for row in ROWS)),
    "a note in two lines": joined(",", [*NAMES, "note"], *([*row, '"again,\nslower"'] for row in ROWS)),
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
    assert not any("last line" in words for words in data.source.notices)


def test_a_line_that_stands_twice_is_read_once(tmp_path: Path, lab: Arm) -> None:
    """Its number, too, is that of the line before: an export pasted twice. Before: an error."""
    path = tmp_path / "data.csv"
    path.write_text(text(NAMES, rows=[*ROWS, *ROWS]))
    data = load_measurements(path, lab)
    np.testing.assert_array_equal(data.pose, [1, 2])
    assert any("line 4, 5: the same in every cell as an earlier line, left out" in one for one in data.source.notices)


AMBIGUOUS: dict[str, tuple[str, tuple[str, ...]]] = {
    "comma and point": (text(NAMES, ";").replace("300.25", "1,300.25"), ("line 2", "1,300.25")),
    "commas beside points": (text(NAMES, ";").replace("300.25", "300,25"), ("300,25", "line 2 has", "point: '10.5'")),
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
    "an unknown unit in a row of units": (
        joined(",", SHORT, [*UNITS[:8], "furlong"], ROWS[0][1:]).decode(),
        ("line 2, column Z", "the unit 'furlong' is not known; one of mm"),
    ),
    "an unknown unit of a load": (
        joined(",", [*SHORT, "load"], [*UNITS, "stone"], [*ROWS[0][1:], 100.0]).decode(),
        ("line 2, column load", "the unit 'stone' is not known; one of g"),
    ),
    "two blocks of other columns": (
        text(NAMES) + text([*NAMES, *(f"note {k}" for k in range(12))], rows=[(*row, *range(12)) for row in ROWS]),
        ("header has 10",),
    ),
    "another table above, with words": (
        "servo,gain,offset\njoint1,1.0,0.5\njoint2,1.1,0.2\n\n" + text(NAMES),
        ("line 5", "10 cells, the header has 3; does another table begin here?"),
    ),
    "digits in groups": (text(NAMES).replace("300.25", "3_00.25"), ("line 2", "'3_00.25' is not a number")),
    "rows of two arms": (
        joined(",", ["Robot", *NAMES[1:]], ["left", *ROWS[0][1:]], ["right", *ROWS[1][1:]]).decode(),
        ("column Robot", "2 arms: left, right", "file of its own"),
    ),
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
    (notice,) = load_measurements(path, lab).source.notices
    assert "x_mm = 'tcp_x'" in notice


def test_two_families_of_numbered_columns_are_not_guessed(lab: Arm, tmp_path: Path) -> None:
    """Nor one that has another number of columns than the arm has joints."""
    path = tmp_path / "data.csv"
    for more in (["Gelenk", "Geber"], []):
        stems = more or ["Gelenk"]
        names = [f"{stem}{i}" for stem in stems for i in range(1, 7 if more else 6)]
        rows = [(number, *([1.0] * len(names)), *row[7:]) for number, row in enumerate(ROWS, start=1)]
        path.write_text(text(["pose", *names, *NAMES[7:]], rows=rows))
        with pytest.raises(FileError, match="missing column q1_deg"):
            load_measurements(path, lab)


COMMANDS_AND_ENCODERS = {
    "as a UR writes them": ("target_q_{}", "actual_q_{}", 0),
    "as ours beside theirs": ("q{}_deg", "q{}_actual", 1),
    "as of servos": ("goal_position_{}", "present_position_{}", 1),
    "in words": ("cmd joint {} [deg]", "measured joint {} [deg]", 1),
}


@pytest.mark.parametrize("name", COMMANDS_AND_ENCODERS)
def test_commands_and_what_encoders_read_are_told_apart_by_their_words(tmp_path: Path, lab: Arm, name: str) -> None:
    """Before: two such families were not read at all, and the encoders' alone were taken for commands."""
    command, encoder, first = COMMANDS_AND_ENCODERS[name]
    path, numbers = tmp_path / "data.csv", range(first, first + 6)
    rows = [(*row[1:7], *(angle + 1.0 for angle in row[1:7]), *([9.0] * 6), *row[7:]) for row in ROWS]
    currents = [f"actual_current_{i}" for i in numbers]
    header = [*(command.format(i) for i in numbers), *(encoder.format(i) for i in numbers), *currents, *NAMES[7:]]
    path.write_text(text(header, rows=rows))
    path.with_suffix(".toml").write_text(
        'schema = "lrm/measurements/1"\nnoise_sd_mm = 0.1\nfeedback_sd_deg = 0.1\n', encoding="utf-8"
    )
    data = load_measurements(path, lab)
    np.testing.assert_allclose(np.degrees(data.poses.q), [row[1:7] for row in ROWS])
    (read_back,) = data.of(EncoderReadings)
    np.testing.assert_allclose(np.degrees(read_back.values), np.add([row[1:7] for row in ROWS], 1.0))
    path.write_text(text(header[6:], rows=[row[6:] for row in rows]))
    with pytest.raises(FileError, match=r"missing column q1_deg.* is what encoders read: rename it to q1_deg"):
        load_measurements(path, lab)


def test_numbered_columns_that_name_no_joints_are_no_encoders(tmp_path: Path, lab: Arm) -> None:
    path = tmp_path / "data.csv"
    rows = [(*row, *([3.0] * 6)) for row in ROWS]
    path.write_text(text([*NAMES, *(f"measured_force_{i}" for i in range(6))], rows=rows))
    assert not load_measurements(path, lab).of(EncoderReadings)
    assert "measured_force_0" in " ".join(load_measurements(path, lab).source.notices)


@pytest.mark.parametrize("yaw", ["yaw_deg", "Yaw", "yaw [deg]"])
def test_roll_pitch_and_yaw_of_the_tool_are_not_taken_for_gravity(tmp_path: Path, lab: Arm, yaw: str) -> None:
    """Before: the tool's roll and pitch turned gravity without a word."""
    path = tmp_path / "data.csv"
    path.write_text(text([*NAMES, "roll_deg", "pitch_deg", yaw], rows=[(*row, 5.0, -4.0, 90.0) for row in ROWS]))
    with pytest.raises(FileError, match="of the tool, or how the base leans"):
        load_measurements(path, lab)
    path.write_text(text([*NAMES, "roll_deg", "pitch_deg"], rows=[(*row, 5.0, -4.0) for row in ROWS]))
    assert load_measurements(path, lab).poses.gravity is not None


def test_poses_that_are_named_by_numbers_have_these(tmp_path: Path, lab: Arm) -> None:
    """Before: P001 was refused as no number. Gaps still end what is known of the way."""
    path = tmp_path / "data.csv"
    rows = [[name, *row[1:], of] for name, row, of in zip(("P001", "P004"), ROWS, ("", "P001"), strict=True)]
    path.write_text("\n".join(",".join(map(str, row)) for row in [[*NAMES, "repeat_of"], *rows]) + "\n")
    data = load_measurements(path, lab)
    assert (data.pose.tolist(), data.repeat_of.tolist()) == ([1, 4], [1, 1])
    assert any("'P001' is 1" in notice for notice in data.source.notices)
    path.write_text(path.read_text().replace("P004", "Q004"))
    with pytest.raises(FileError, match="column pose: 'P001' is not a number"):
        load_measurements(path, lab)


@pytest.mark.parametrize(("name", "unit"), [("stamp", 1.0), ("timestamp_ns", 1e9), ("t_us", 1e6), ("t_h", 1 / 3600)])
def test_times_of_recordings_are_read_in_their_unit(tmp_path: Path, lab: Arm, name: str, unit: float) -> None:
    path = tmp_path / "data.csv"
    rows = [(*row, round(unit * 72.0 * number, 6)) for number, row in enumerate(ROWS)]
    path.write_text(text([*NAMES, name], rows=rows))
    t = load_measurements(path, lab).poses.t
    assert t is not None
    np.testing.assert_allclose(np.diff(t), 72.0, rtol=1e-3)


def test_columns_that_are_not_used_are_told_with_the_names_that_would_be(tmp_path: Path, lab: Arm) -> None:
    path = tmp_path / "data.csv"
    names = [NAMES[0], *(f"J{i}" for i in range(1, 7)), *NAMES[7:], "Last [g]", "time"]
    path.write_text(text(names, rows=[(*row, 150.0, float(number)) for number, row in enumerate(ROWS)]))
    unused, taken = load_measurements(path, lab).source.notices
    assert unused == "columns not used: Last [g]. If one is a load or session, name it payload_g or session"
    assert taken == "read as: q1_deg … q6_deg = 'J1' … 'J6', t_s = 'time'"


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
    assert load_measurements(path, lab).source.notices == ()
    path.with_suffix(".toml").write_text('schema = "lrm/measurements/1"\nnoise_sd_mm = 0.5\n')
    (notice,) = load_measurements(path, lab).source.notices
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
    (notice,) = load_measurements(path, lab).source.notices
    assert "run1.toml" in notice
    assert "schema" in notice or "lrm/" in notice


def test_every_column_is_documented() -> None:
    documented = (ROOT / "docs" / "files.md").read_text(encoding="utf-8")
    assert [known.name for known in KNOWN if known.columns[0] not in documented] == []


HEADER = ("q1_deg", "q2_deg", "x_mm", "y_mm", "z_mm")
NUMBERS = np.round(np.random.default_rng(0).uniform(-80.0, 80.0, (9, 5)), 3)


@pytest.fixture(scope="module")
def arm() -> Arm:
    return load_arm("two-joint")


def read(folder: Path, arm: Arm, more: dict[str, list[str]]) -> Measurements:
    """Measurements of a file with columns more."""
    path = folder / "data.csv"
    rows = [[*map(str, row), *(cells[k] for cells in more.values())] for k, row in enumerate(NUMBERS.tolist())]
    path.write_text("\n".join(",".join(row) for row in [[*HEADER, *more], *rows]) + "\n")
    return load_measurements(path, arm)


@pytest.mark.parametrize("comments", ["# ", ""])
def test_a_table_divided_by_spaces(arm: Arm, tmp_path: Path, comments: str) -> None:
    path = tmp_path / "numpy.txt"
    np.savetxt(path, NUMBERS, header=" ".join(HEADER), comments=comments)
    np.testing.assert_allclose(load_measurements(path, arm).tcp, 1e-3 * NUMBERS[:, 2:])


@pytest.mark.parametrize("delimiter", [" ", ",", "\t", "   "])
def test_numbers_without_a_header(arm: Arm, tmp_path: Path, delimiter: str) -> None:
    path = tmp_path / "numpy.txt"
    np.savetxt(path, NUMBERS, delimiter=delimiter)
    with pytest.raises(FileError, match="line 1: numbers, but no header; name the columns"):
        load_measurements(path, arm)


@pytest.mark.parametrize(
    "form",
    [
        "{:.3f}", "2024-07-15T10:00:0{:.3f}", "'15.07.2024 10:00:0{:.3f}", "15.07.2024 10:00:0{:.3f}",
        "7/15/2024 10:00:0{:.3f} AM", "15/07/2024 10:00:0{:.3f}", "3/4/2024 10:00:0{:.3f}", "10:00:0{:.3f}",
    ],
)  # fmt: skip
def test_times_as_programs_write_them(arm: Arm, tmp_path: Path, form: str) -> None:
    t = read(tmp_path, arm, {"Time Stamp": [form.format(k + 0.25) for k in range(9)]}).poses.t
    np.testing.assert_allclose(t - t[0], np.arange(9.0))


def test_a_date_of_two_meanings_is_none() -> None:
    assert seconds_of(["3/4/2024 10:00:00", "4/4/2024 10:00:00"]) is None
    assert seconds_of(["30/4/2024 10:00:00", "1/5/2024 10:00:00"]) is not None


@pytest.mark.parametrize(
    "name", ["t_s", "Time", "temp_c", "payload_g", "session", "sd_mm", "approach", "srot_deg", "gx"]
)
@pytest.mark.parametrize("cell", ["", "n/a", "yesterday", "nan"])
def test_an_unreadable_optional_column_is_left_out_and_said(arm: Arm, tmp_path: Path, name: str, cell: str) -> None:
    data = read(tmp_path, arm, {name: [cell] * 9})
    assert len(data) == 9
    assert any(f"column {name} left out: no cell is a" in words for words in data.source.notices), data.source.notices


@pytest.mark.parametrize("name", ["t_s", "temp_c", "sd_mm"])
def test_one_bad_cell_of_a_readable_column_is_named(arm: Arm, tmp_path: Path, name: str) -> None:
    with pytest.raises(FileError, match=f"line 5, column {name}: 'late' is n"):
        read(tmp_path, arm, {name: ["1", "2", "3", "late", "5", "6", "7", "8", "9"]})


@pytest.mark.parametrize("cell", ["", "late"])
def test_rows_without_a_time_are_left_out_where_that_is_asked_for(arm: Arm, tmp_path: Path, cell: str) -> None:
    (tmp_path / "data.toml").write_text('schema = "lrm/measurements/1"\nbad_rows = "skip"\n')
    data = read(tmp_path, arm, {"t_s": ["1", "2", cell, "4", "5", "6", "7", "8", "9"]})
    assert len(data) == 8
    assert any("1 row with cells that are no numbers left out: line 4" in words for words in data.source.notices)


@pytest.mark.parametrize("names", [("Q0", "Q1", "Q2", "Q3"), ("q0", "q1", "q2", "q3")])
def test_an_orientation_as_leica_writes_it_is_no_joint(tmp_path: Path, names: tuple[str, ...]) -> None:
    arm, rng, path = load_arm("ur5"), np.random.default_rng(1), tmp_path / "leica.csv"
    turns = rng.normal(size=(8, 4))
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    rows = np.column_stack([rng.uniform(-90.0, 90.0, (8, 6)), rng.uniform(100.0, 400.0, (8, 3)), turns])
    header = ",".join([*(f"j{k}" for k in range(1, 7)), "X  [mm]", "Y  [mm]", "Z  [mm]", *names])
    np.savetxt(path, rows, delimiter=",", header=header, comments="")
    path.with_suffix(".toml").write_text('schema = "lrm/measurements/1"\n')
    data = load_measurements(path, arm)
    np.testing.assert_allclose(np.degrees(data.poses.q), rows[:, :6], atol=1e-9)
    assert any(f"qw = '{names[0]}'" in words for words in data.source.notices)


@pytest.mark.parametrize("before", ["", "arm_", "left_", "main_", "action.right_"])
def test_names_of_joints_with_what_stands_before_them(tmp_path: Path, before: str) -> None:
    arm, path = load_arm("so101"), tmp_path / "data.csv"
    q = np.random.default_rng(0).uniform(-60.0, 60.0, (6, 5))
    header = ",".join([*(f"{before}{joint.name}.pos" for joint in arm.joints), "x_mm", "y_mm", "z_mm"])
    np.savetxt(path, np.column_stack([q, 300.0 + q[:, :3]]), delimiter=",", header=header, comments="")
    np.testing.assert_allclose(np.degrees(load_measurements(path, arm).poses.q), q)


def test_joints_of_two_arms_are_refused(tmp_path: Path) -> None:
    arm, path = load_arm("so101"), tmp_path / "data.csv"
    names = [f"{side}_{joint.name}" for side in ("left", "right") for joint in arm.joints]
    path.write_text(",".join([*names, "x_mm", "y_mm", "z_mm"]) + "\n" + ",".join(["10"] * 13) + "\n")
    with pytest.raises(FileError, match="left_shoulder_pan and right_shoulder_pan are both q1_deg"):
        load_measurements(path, arm)


MAIN = 'xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"'
RELATION = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
CELLS = st.text(st.characters(codec="utf-8", exclude_categories=("C",)), max_size=8)


def letters(column: int) -> str:
    return (letters(column // 26 - 1) if column >= 26 else "") + chr(ord("A") + column % 26)


def workbook(path: Path, rows: list[list[object]], dated: frozenset[tuple[int, int]] = frozenset()) -> Path:
    """An .xlsx with one sheet; dates (serial numbers of the second style) in the cells `dated`."""
    return workbook_of(path, {"Data": rows}, dated)


def workbook_of(
    path: Path, sheets: dict[str, list[list[object]]], dated: frozenset[tuple[int, int]] = frozenset(),
    hidden: str = "", hidden_row: int = 0, space: str = MAIN,
) -> Path:  # fmt: skip
    """An .xlsx with shared strings, numbers, and formulas without values; one sheet and one row may be hidden."""
    shared: list[str] = []
    with zipfile.ZipFile(path, "w") as parts:
        listed, links = "", ""
        for number, (name, rows) in enumerate(sheets.items(), start=8):
            lines = []
            for i, row in enumerate(rows):
                cells = ""
                for j, value in enumerate(row):
                    place = f'r="{letters(j)}{i + 1}"'
                    if isinstance(value, str) and value.startswith("="):
                        cells += f"<c {place}><f>{value[1:]}</f></c>"
                    elif isinstance(value, str):
                        shared.append(value)
                        cells += f'<c {place} t="s"><v>{len(shared) - 1}</v></c>' if value else ""
                    else:
                        cells += f'<c {place} s="{int((i, j) in dated)}"><v>{value!r}</v></c>'
                hides = ' hidden="1"' if i + 1 == hidden_row else ""
                lines.append(f'<row r="{i + 1}"{hides}>{cells}</row>' if cells else "")
            sheet = f"<worksheet {space}><sheetData>{''.join(lines)}</sheetData></worksheet>"
            parts.writestr(f"xl/worksheets/sheet{number}.xml", sheet)
            state = ' state="hidden"' if name == hidden else ""
            listed += f'<sheet name="{name}"{state} sheetId="{number}" r:id="rId{number}"/>'
            links += f'<Relationship Id="rId{number}" Target="worksheets/sheet{number}.xml"/>'
        whole = f'<workbook {space} xmlns:r="{RELATION}"><sheets>{listed}</sheets></workbook>'
        parts.writestr("xl/workbook.xml", whole)
        parts.writestr("xl/_rels/workbook.xml.rels", f"<R>{links}</R>")
        strings = "".join(f'<si><t xml:space="preserve">{escape(each)}</t></si>' for each in shared)
        parts.writestr("xl/sharedStrings.xml", f"<sst {space}>{strings}</sst>")
        xfs = '<cellXfs><xf numFmtId="0"/><xf numFmtId="22"/></cellXfs>'
        parts.writestr("xl/styles.xml", f"<styleSheet {space}>{xfs}</styleSheet>")
    return path


def test_a_workbook_is_read_as_the_csv_of_its_first_sheet(tmp_path: Path, lab: Arm) -> None:
    path = workbook(tmp_path / "data.xlsx", [NAMES, *map(list, ROWS)])
    data = load_measurements(path, lab)
    np.testing.assert_allclose(np.degrees(data.poses.q), [row[1:7] for row in ROWS], atol=1e-9)
    np.testing.assert_allclose(data.tcp * 1e3, [row[7:] for row in ROWS], atol=1e-9)
    assert "read from the sheet 'Data'" in data.source.notices


TABLE: list[list[object]] = [[*NAMES], *map(list, ROWS)]
WRONG: list[list[object]] = [[*NAMES], *([*row[:-1], row[-1] + 1] for row in ROWS)]
BOOKS: dict[str, tuple[dict[str, object], str]] = {
    "notes before": ({"sheets": {"Notes": [["Operator", "Anna"], ["Tuesday"]], "Data": TABLE}}, "not read: 'Notes'"),
    "dimensions before": (
        {"sheets": {"Setup": [["link", "length", "mass"], [1, 120, 85], [2, 95.5, 60]], "Data": TABLE}},
        "read from the sheet 'Data'; not read: 'Setup'",
    ),
    "an empty sheet before": ({"sheets": {"Empty": [], "Data": TABLE}}, "read from the sheet 'Data'"),
    "a hidden sheet before": ({"sheets": {"Old": WRONG, "Data": TABLE}, "hidden": "Old"}, "not read: 'Old'"),
    "positions alone before": (
        {"sheets": {"Tracker": [["t", "x", "y", "z"], *([k, 1.0, 2.0, 3.0] for k in range(9))], "Data": TABLE}},
        "read from the sheet 'Data'; not read: 'Tracker'",
    ),
    "the plan before": ({"sheets": {"Plan": [row[:7] for row in TABLE], "Data": TABLE}}, "read from the sheet 'Data'"),
    "a damaged plan before": (
        {"sheets": {"Plan": [[*NAMES, "q1_deg"], [*ROWS[0], 1.0]], "Data": TABLE}},
        "read from the sheet 'Data'",
    ),
    "another run behind, which counts too": (
        {"sheets": {"Data": TABLE, "Run 2": WRONG}},
        "measurements stand in the sheet 'Run 2', too: put all that count into one sheet",
    ),
    "another run behind": ({"sheets": {"Data": TABLE, "Run 2": WRONG}}, "not read: 'Run 2'"),
    "strict Open XML": (
        {"sheets": {"Data": TABLE}, "space": 'xmlns="http://purl.oclc.org/ooxml/spreadsheetml/main"'},
        "read from the sheet 'Data'",
    ),
    "a table further down": ({"sheets": {"Data": [[], [], *([""] * 2 + row for row in TABLE)]}}, "the sheet 'Data'"),
    "a hidden row": ({"sheets": {"Data": TABLE}, "hidden_row": 3}, "rows that the sheet hides are read, too: line 3"),
}


@pytest.mark.parametrize("name", BOOKS)
def test_of_a_workbook_the_first_sheet_with_numbers_is_read(tmp_path: Path, lab: Arm, name: str) -> None:
    """Before: the first one alone, whether it was empty, hidden or a chart; hidden rows without a word."""
    how, said = BOOKS[name]
    data = load_measurements(workbook_of(tmp_path / "data.xlsx", **how), lab)  # type: ignore[arg-type]
    np.testing.assert_allclose(data.tcp * 1e3, [row[7:] for row in ROWS], atol=1e-9)
    assert any(said in notice for notice in data.source.notices), data.source.notices
    assert not any("above the header" in notice for notice in data.source.notices)


def test_of_a_workbook_without_the_table_the_sheet_that_was_read_is_named(tmp_path: Path, lab: Arm) -> None:
    path = workbook_of(tmp_path / "data.xlsx", {"Raw": [["x", "y"], [1.0, 2.0]], "More": [["y", "z"], [1.0, 2.0]]})
    with pytest.raises(FileError, match="header of the sheet 'Raw': missing column q1_deg"):
        load_measurements(path, lab)


def test_a_formula_without_its_value_is_named(tmp_path: Path, lab: Arm) -> None:
    """As programs write it that do not calculate. Before: the cell is empty."""
    path = workbook(tmp_path / "data.xlsx", [[*NAMES], [*ROWS[0][:9], "=Z2*1000"], [*ROWS[1]]])
    with pytest.raises(FileError, match=r"line 2, column z_mm: '=Z2\*1000' is a formula without its value"):
        load_measurements(path, lab)


@pytest.mark.parametrize(
    ("member", "content", "said"),
    [
        ("mimetype", "application/vnd.oasis.opendocument.spreadsheet", "OpenDocument spreadsheet"),
        ("xl/workbook.bin", "", "binary Excel file"),
    ],
)
def test_other_spreadsheets_are_named(tmp_path: Path, lab: Arm, member: str, content: str, said: str) -> None:
    with zipfile.ZipFile(tmp_path / "data.ods", "w") as parts:
        parts.writestr(member, content)
    with pytest.raises(FileError, match=f"{said}.*; save it as .xlsx or as CSV"):
        load_measurements(tmp_path / "data.ods", lab)


def test_dates_of_a_workbook_are_times(tmp_path: Path, lab: Arm) -> None:
    rows = [[*NAMES, "t_s"], *([*row, 45488.5 + i / 86400] for i, row in enumerate(ROWS))]
    path = workbook(tmp_path / "data.xlsx", rows, frozenset({(1, 10), (2, 10)}))
    t = load_measurements(path, lab).poses.t
    np.testing.assert_allclose(t, [0.0, 1.0], atol=2e-3)


@examples(15, 30)
@given(st.lists(st.lists(CELLS, min_size=1, max_size=30), min_size=1, max_size=5))
def test_cells_of_a_workbook_keep_places(tmp_path_factory: pytest.TempPathFactory, rows: list[list[str]]) -> None:
    import csv

    path = workbook(tmp_path_factory.mktemp("book") / "any.xlsx", [list(row) for row in rows])
    read = list(csv.reader(sheets_of(path, path.read_bytes())[0].text.splitlines()))
    for i, row in enumerate(rows):
        there = read[i] if i < len(read) else []
        assert [" ".join(cell.split()) for cell in row if cell] == [there[j] for j, cell in enumerate(row) if cell]


@pytest.mark.parametrize("seed", seeds(6, 20))
def test_a_damaged_workbook_is_one_line(tmp_path: Path, lab: Arm, seed: int) -> None:
    path, rng = workbook(tmp_path / "data.xlsx", [NAMES, *map(list, ROWS)]), random.Random(seed)
    content = bytearray(path.read_bytes())
    for _ in range(40):
        content[rng.randrange(4, len(content))] = rng.randrange(256)
    path.write_bytes(content[: rng.randrange(60, len(content))])
    with pytest.raises(FileError):
        load_measurements(path, lab)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "is empty"),
        (b"\n\n", "is empty"),
        (b"\x89PNG\x0d\x0a\x00\x01", "no text"),
        (b"\xd0\xcf\x11\xe0", "before 2007"),
    ],
)
def test_what_is_no_table_is_said(tmp_path: Path, lab: Arm, content: bytes, said: str) -> None:
    path = tmp_path / "data.csv"
    path.write_bytes(content)
    with pytest.raises(FileError, match=said):
        load_measurements(path, lab)


def test_latin_1_is_read_and_said(tmp_path: Path, lab: Arm) -> None:
    path = tmp_path / "data.csv"
    path.write_bytes(text([NAMES[0], *(f"q{i} (°)" for i in range(1, 7)), *NAMES[7:]]).encode("latin-1"))
    data = load_measurements(path, lab)
    np.testing.assert_allclose(np.degrees(data.poses.q), [row[1:7] for row in ROWS], atol=1e-9)
    assert any("Latin-1" in notice for notice in data.source.notices)
    assert "°" in read_text(path).text


@pytest.mark.parametrize("brackets", ["{}", "[{}]", "({})"])
def test_a_row_of_units_counts_as_the_names_units(tmp_path: Path, lab: Arm, brackets: str) -> None:
    units = ["-", *["rad"] * 6, "m", "cm", "mm"]
    rows = [(row[0], *(v * np.pi / 180 for v in row[1:7]), row[7] / 1e3, row[8] / 10, row[9]) for row in ROWS]
    lines = text(["nr", *(f"q{i}" for i in range(1, 7)), "x", "y", "z"], rows=rows).splitlines()
    path = tmp_path / "data.csv"
    path.write_text("\n".join([lines[0], ",".join(brackets.format(unit) for unit in units), *lines[1:]]) + "\n")
    data = load_measurements(path, lab)
    np.testing.assert_allclose(np.degrees(data.poses.q), [row[1:7] for row in ROWS], atol=1e-9)
    np.testing.assert_allclose(data.tcp * 1e3, [row[7:] for row in ROWS], atol=1e-9)


def test_a_row_of_units_that_contradicts_a_name_is_an_error(tmp_path: Path, lab: Arm) -> None:
    lines = text(NAMES).splitlines()
    path = tmp_path / "data.csv"
    path.write_text("\n".join([lines[0], ",".join(["", *["deg"] * 6, "m", "m", "m"]), *lines[1:]]) + "\n")
    with pytest.raises(FileError, match="line 2, column x_mm: its unit is stated as m"):
        load_measurements(path, lab)


def example_rows() -> list[list[str]]:
    return [line.split(",") for line in EXAMPLE.read_text().splitlines()]


def written(path: Path, rows: list[list[str]]) -> Path:
    path.write_text("\n".join(",".join(row) for row in rows) + "\n")
    return path


def scaled_column(name: str, factor: float) -> list[list[str]]:
    header, *rows = example_rows()
    j = header.index(name)
    return [header, *([*row[:j], repr(float(row[j]) * factor), *row[j + 1 :]] for row in rows)]


@pytest.mark.long
@pytest.mark.parametrize("joint", [1, 2, 3])
def test_one_joint_in_radians_is_recognised(tmp_path: Path, lab: Arm, joint: int) -> None:
    path = written(tmp_path / "data.csv", scaled_column(f"q{joint}_deg", np.pi / 180))
    with pytest.raises(Misread, match=f"joint {joint} alone look like radians.*q{joint}_rad"):
        load_checked(path, lab)


@pytest.mark.long
@pytest.mark.parametrize("axis", "xyz")
@pytest.mark.parametrize(("unit", "name"), [("m", "metres"), ("inch", "inches"), ("cm", "centimetres")])
def test_one_axis_in_another_unit_is_recognised(tmp_path: Path, lab: Arm, axis: str, unit: str, name: str) -> None:
    factor = {"m": 1e-3, "inch": 1 / 25.4, "cm": 0.1}[unit]
    path = written(tmp_path / "data.csv", scaled_column(f"{axis}_mm", factor))
    with pytest.raises(Misread, match=f"{axis} alone looks like {name}.*{axis}_{unit}"):
        load_checked(path, lab)


def test_angles_from_0_to_360_are_read_and_said(tmp_path: Path, lab: Arm) -> None:
    header, *rows = example_rows()
    turned = [[*row[:1], *row[1:]] for row in rows]
    j = header.index("q1_deg")
    for row in turned:
        row[j] = repr(float(row[j]) % 360.0)
    data = load_measurements(written(tmp_path / "data.csv", [header, *turned]), lab)
    np.testing.assert_allclose(data.poses.q, load_measurements(EXAMPLE, lab).poses.q, atol=1e-9)
    beyond = sum(float(row[j]) > np.degrees(lab.joints[0].upper) for row in turned)
    assert any(f"{beyond} angles are beyond the limits of joint 1" in notice for notice in data.source.notices)


def bad_rows(path: Path) -> tuple[Path, list[int]]:
    rows = example_rows()
    rows[4][rows[0].index("x_mm")] = "nan"
    rows[9][rows[0].index("q2_deg")] = "--"
    rows[12][rows[0].index("z_mm")] = ""
    return written(path, rows), [5, 10, 13]


def test_all_cells_that_are_no_numbers_are_named_at_once(tmp_path: Path, lab: Arm) -> None:
    path, lines = bad_rows(tmp_path / "data.csv")
    with pytest.raises(FileError) as caught:
        load_measurements(path, lab)
    for line in lines:
        assert f"line {line}, column" in str(caught.value)
    assert "; no number either: line " in str(caught.value)
    assert "leave 3 rows out with --bad-rows skip" in str(caught.value)


def test_a_load_that_some_rows_do_not_state_is_never_taken_as_none(tmp_path: Path, lab: Arm) -> None:
    """An empty cell may be no load, or the load of the row above: only the person who measured knows."""
    rows = example_rows()
    column = rows[0].index("payload_g")
    for number, row in enumerate(rows):
        row[column] = "load [g]" if number == 0 else "200" if number < 10 else ""
    with pytest.raises(FileError) as caught:
        load_measurements(written(tmp_path / "data.csv", rows), lab)
    said, empty = str(caught.value), len(rows) - 10
    assert f"line 11, column load [g]: the cell is empty, as in {empty} of {len(rows) - 1} rows" in said
    assert "write 0 where the tool carried nothing" in said
    assert f"leave {empty} rows out with --bad-rows skip" in said


def test_sessions_may_have_names(tmp_path: Path, lab: Arm) -> None:
    """Before: the column was left out, and with it every step between two days."""
    rows = example_rows()
    if "session" in rows[0]:
        rows = [[cell for name, cell in zip(rows[0], row, strict=True) if name != "session"] for row in rows]
    for number, row in enumerate(rows):
        row.append("session" if number == 0 else "Monday" if number < 10 else "after the fall")
    data = load_measurements(written(tmp_path / "data.csv", rows), lab)
    assert data.poses.session.tolist() == [1.0] * 9 + [2.0] * (len(rows) - 10)
    assert "sessions are numbered: 1 = 'Monday', 2 = 'after the fall'" in data.source.notices


def test_rows_of_one_number_and_the_same_angles_are_numbered_anew(tmp_path: Path, lab: Arm) -> None:
    rows = example_rows()[:21]
    again = [list(row) for row in rows[1:6]]
    for row in again:
        row[rows[0].index("x_mm")] = f"{float(row[rows[0].index('x_mm')]) + 0.1:.3f}"
    data = load_measurements(written(tmp_path / "data.csv", [*rows, *again]), lab)
    assert data.pose.tolist() == list(range(1, 26))
    assert data.repeat_of.tolist() == data.pose.tolist(), "another load or side may make the difference, not noise"
    again[0][rows[0].index("q1_deg")] = "1.5"
    with pytest.raises(FileError, match="already"):
        load_measurements(written(tmp_path / "data.csv", [*rows, *again]), lab)


def test_a_supply_voltage_that_some_rows_lack_refuses_no_file(tmp_path: Path, lab: Arm) -> None:
    """No model uses it."""
    rows = example_rows()
    for number, row in enumerate(rows):
        row.append("supply_v" if number == 0 else "" if number == 7 else "7.4")
    assert len(load_measurements(written(tmp_path / "data.csv", rows), lab)) == len(rows) - 1


@pytest.mark.long
def test_rows_with_bad_cells_are_skipped_when_asked_and_by_the_next_command(tmp_path: Path, lab: Arm) -> None:
    path, _ = bad_rows(tmp_path / "data.csv")
    data = load_measurements(path, lab, Reading(bad_rows="skip"))
    assert len(data) == len(load_measurements(EXAMPLE, lab)) - 3
    assert any("5, 10, 13" in notice for notice in data.source.notices)
    model = tmp_path / "model.toml"
    stdout_of("fit", path, "--arm", "lrm-lab", "--bad-rows", "skip", "-o", model)
    stdout_of("compare", model, path)
    assert "--bad-rows" in stderr_of("compare", model, path, "--bad-rows", "refuse")


def test_arguments_in_another_order_are_recognised(tmp_path: Path, lab: Arm) -> None:
    model = tmp_path / "model.toml"
    model.write_text('schema = "lrm/model/1"\narm = "lrm-lab"\n')
    with pytest.raises(FileError, match="another order"):
        load_measurements(model, lab)
    with pytest.raises(FileError, match=r"a \.csv is a table.*another order"):
        parse_toml(EXAMPLE)
    with pytest.raises(FileError, match="it is a model of lrm-lab: name that arm"):
        read_arm(model)


def test_equal_poses_are_said(tmp_path: Path) -> None:
    header, *rows = example_rows()
    same = [[str(i), *rows[0][1:-1], rows[i][-1]] for i in range(1, 61)]
    path = written(tmp_path / "data.csv", [header, *same])
    assert "60 poses, and all are equal" in stderr_of("fit", path, "--arm", "lrm-lab")


@pytest.mark.long
def test_too_few_poses_are_told_one_number(tmp_path: Path) -> None:
    header, *rows = example_rows()
    said = set()
    for count in (3, 6, 9):
        path = written(tmp_path / "data.csv", [header, *rows[:count]])
        said.add(stderr_of("fit", path, "--arm", "lrm-lab").partition("measure at least ")[2])
    assert len(said) == 1
    assert load_arm("lrm-lab").name == "lrm-lab"


@pytest.mark.parametrize(("name", "unit"), [("session", "Nr."), ("repeat_of", "pose")])
def test_the_unit_of_a_plain_number_is_not_read(tmp_path: Path, lab: Arm, name: str, unit: str) -> None:
    """The column was left unread: two sessions became one."""
    path = tmp_path / "data.csv"
    rows = [[k + 1, *row[1:], 1.0] for k, row in enumerate([*ROWS, *ROWS[:1]])]
    path.write_bytes(joined(",", ["pose", *SHORT, name], ["number", *UNITS, unit], *rows))
    assert not any("not used" in one for one in load_measurements(path, lab).source.notices)


def test_a_note_with_a_comma_is_no_decimal_number(tmp_path: Path, lab: Arm) -> None:
    path = tmp_path / "data.csv"
    head, first, *rest = text(NAMES).splitlines()
    path.write_text("\n".join([f"{head},note", f'{first},"3,4"', *(f"{line}," for line in rest), ""]))
    np.testing.assert_array_equal(load_measurements(path, lab).pose, [row[0] for row in ROWS])


def test_an_arm_that_some_rows_do_not_name_is_one(tmp_path: Path, lab: Arm) -> None:
    path = tmp_path / "data.csv"
    path.write_bytes(joined(",", [*NAMES, "arm"], [*ROWS[0], "A"], [*ROWS[1], "a"]))
    assert len(load_measurements(path, lab).pose) == 2


def test_decimal_commas_of_a_column_that_is_mostly_empty_are_read_as_those_of_the_others(tmp_path: Path) -> None:
    path = tmp_path / "data.csv"
    path.write_text("x_mm;load_g\n1,5;12,5\n2,5;\n3,5;\n")
    assert read_table(path).rows == (("1.5", "12.5"), ("2.5", ""), ("3.5", ""))
