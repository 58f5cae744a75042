"""Tables as trackers, numpy and spreadsheets write them: spaces, dates, orientations as Q0 … Q3, columns of no use."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.data.measurement_file.times import seconds_of
from lrm_ident.data.measurements import Measurements
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.errors import FileError

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
    assert t is not None
    np.testing.assert_allclose(t - t[0], np.arange(9.0))


def test_a_date_of_two_meanings_is_none() -> None:
    assert seconds_of(["3/4/2024 10:00:00", "4/4/2024 10:00:00"]) is None
    assert seconds_of(["30/4/2024 10:00:00", "1/5/2024 10:00:00"]) is not None


@pytest.mark.parametrize(
    "name", ["t_s", "Time", "temp_c", "payload_g", "session", "sd_mm", "approach", "srot_deg", "gx"]
)
@pytest.mark.parametrize("cell", ["", "n/a", "yesterday", "nan"])
def test_an_optional_column_that_cannot_be_read_is_left_out_and_said(
    arm: Arm, tmp_path: Path, name: str, cell: str
) -> None:
    data = read(tmp_path, arm, {name: [cell] * 9})
    assert len(data) == 9
    assert any(f"column {name} left out: no cell is a" in words for words in data.notices), data.notices


@pytest.mark.parametrize("name", ["t_s", "temp_c", "sd_mm"])
def test_one_bad_cell_of_a_readable_column_is_named(arm: Arm, tmp_path: Path, name: str) -> None:
    with pytest.raises(FileError, match=f"line 5, column {name}: 'late' is n"):
        read(tmp_path, arm, {name: ["1", "2", "3", "late", "5", "6", "7", "8", "9"]})


@pytest.mark.parametrize("cell", ["", "late"])
def test_rows_without_a_time_are_left_out_where_that_is_asked_for(arm: Arm, tmp_path: Path, cell: str) -> None:
    (tmp_path / "data.toml").write_text('schema = "lrm/measurements/1"\nbad_rows = "skip"\n')
    data = read(tmp_path, arm, {"t_s": ["1", "2", cell, "4", "5", "6", "7", "8", "9"]})
    assert len(data) == 8
    assert any("1 row with cells that are no numbers left out: line 4" in words for words in data.notices)


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
    assert any(f"qw = '{names[0]}'" in words for words in data.notices)


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
