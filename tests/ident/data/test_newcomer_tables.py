"""Files of newcomers: workbooks, Latin-1, rows of units, angles from 0 to 360, cells that are no numbers."""

from __future__ import annotations

import random
import zipfile
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.data.registration.checked import Misread, load_checked
from lrm_ident.data.table_text.csv_file import read_text
from lrm_ident.data.table_text.workbook import sheet_text
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm, read_arm
from lrm_math.errors import FileError
from lrm_math.model.reading import Reading
from lrm_math.toml_file import parse_toml
from tests.conftest import EXAMPLE
from tests.ident.data.test_table_formats import NAMES, ROWS, text
from tests.support.commands import stderr_of, stdout_of
from tests.support.sweep import examples, seeds

pytestmark = pytest.mark.usefixtures("one_step_folds")

MAIN = 'xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"'
RELATION = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
CELLS = st.text(st.characters(codec="utf-8", exclude_categories=("C",)), max_size=8)


def letters(column: int) -> str:
    return (letters(column // 26 - 1) if column >= 26 else "") + chr(ord("A") + column % 26)


def workbook(path: Path, rows: list[list[object]], dated: frozenset[tuple[int, int]] = frozenset()) -> Path:
    """An .xlsx with shared strings, numbers, and dates (serial numbers of the second style) in the cells `dated`."""
    shared: list[str] = []
    lines = []
    for i, row in enumerate(rows):
        cells = ""
        for j, value in enumerate(row):
            if isinstance(value, str):
                shared.append(value)
                cells += f'<c r="{letters(j)}{i + 1}" t="s"><v>{len(shared) - 1}</v></c>' if value else ""
            else:
                cells += f'<c r="{letters(j)}{i + 1}" s="{int((i, j) in dated)}"><v>{value!r}</v></c>'
        lines.append(f'<row r="{i + 1}">{cells}</row>' if cells else "")
    sheet = '<sheets><sheet name="Data" sheetId="1" r:id="rId7"/></sheets>'
    with zipfile.ZipFile(path, "w") as parts:
        parts.writestr("xl/workbook.xml", f'<workbook {MAIN} xmlns:r="{RELATION}">{sheet}</workbook>')
        parts.writestr("xl/_rels/workbook.xml.rels", '<R><Relationship Id="rId7" Target="worksheets/sheet9.xml"/></R>')
        strings = "".join(f'<si><t xml:space="preserve">{escape(each)}</t></si>' for each in shared)
        parts.writestr("xl/sharedStrings.xml", f"<sst {MAIN}>{strings}</sst>")
        xfs = '<cellXfs><xf numFmtId="0"/><xf numFmtId="22"/></cellXfs>'
        parts.writestr("xl/styles.xml", f"<styleSheet {MAIN}>{xfs}</styleSheet>")
        parts.writestr(
            "xl/worksheets/sheet9.xml", f"<worksheet {MAIN}><sheetData>{''.join(lines)}</sheetData></worksheet>"
        )
    return path


def test_a_workbook_is_read_as_the_csv_of_its_first_sheet(tmp_path: Path, lab: Arm) -> None:
    path = workbook(tmp_path / "data.xlsx", [NAMES, *map(list, ROWS)])
    data = load_measurements(path, lab)
    np.testing.assert_allclose(np.degrees(data.poses.q), [row[1:7] for row in ROWS], atol=1e-9)
    np.testing.assert_allclose(data.tcp * 1e3, [row[7:] for row in ROWS], atol=1e-9)
    assert "read from the first sheet of the workbook" in data.notices


def test_dates_of_a_workbook_are_times(tmp_path: Path, lab: Arm) -> None:
    rows = [[*NAMES, "t_s"], *([*row, 45488.5 + i / 86400] for i, row in enumerate(ROWS))]
    path = workbook(tmp_path / "data.xlsx", rows, frozenset({(1, 10), (2, 10)}))
    t = load_measurements(path, lab).poses.t
    assert t is not None
    np.testing.assert_allclose(t, [0.0, 1.0], atol=2e-3)


@examples(15, 30)
@given(st.lists(st.lists(CELLS, min_size=1, max_size=30), min_size=1, max_size=5))
def test_cells_of_a_workbook_stay_in_their_places(
    tmp_path_factory: pytest.TempPathFactory, rows: list[list[str]]
) -> None:
    import csv

    path = workbook(tmp_path_factory.mktemp("book") / "any.xlsx", [list(row) for row in rows])
    read = list(csv.reader(sheet_text(path, path.read_bytes()).splitlines()))
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
    assert any("Latin-1" in notice for notice in data.notices)
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
    assert any(f"{beyond} angles are beyond the limits of joint 1" in notice for notice in data.notices)


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


@pytest.mark.long
def test_rows_with_bad_cells_are_skipped_when_asked_and_by_the_next_command(tmp_path: Path, lab: Arm) -> None:
    path, _ = bad_rows(tmp_path / "data.csv")
    data = load_measurements(path, lab, Reading(bad_rows="skip"))
    assert len(data) == len(load_measurements(EXAMPLE, lab)) - 3
    assert any("5, 10, 13" in notice for notice in data.notices)
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
    same = [[str(i), *rows[0][1:]] for i in range(1, 61)]
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
