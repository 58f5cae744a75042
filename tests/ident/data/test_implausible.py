"""Quantities of no plausible size are said with file, place and the unit that they seem to be in."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.data.robot_files.arm_text import arm_text
from lrm_ident.data.robot_files.urdf import read_urdf
from lrm_ident.data.robot_files.urdf_arm import import_arm
from lrm_ident.data.robot_files.urdf_export import bare_urdf
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm, shipped_arms
from lrm_math.arm.plausible_arm import implausible
from lrm_math.errors import FileError
from lrm_math.plausibility import PlausibleSize, implausible_value, times
from tests.conftest import EXAMPLE
from tests.support.commands import run_command, stderr_of, stdout_of

NUMBER = re.compile(r"(?<![\w.])-?\d+\.?\d*(?:e-?\d+)?")


def scaled(text: str, key: str, factor: float) -> str:
    """An arm file with the numbers of some keys multiplied."""

    def line(found: re.Match[str]) -> str:
        return found[1] + NUMBER.sub(lambda number: f"{float(number[0]) * factor:.8f}", found[2])

    return re.sub(rf"^(\s*(?:{key})\s*=\s*)([^#\n]*)", line, text, flags=re.MULTILINE)


@pytest.mark.parametrize("name", sorted(shipped_arms()))
@pytest.mark.parametrize(
    ("key", "factor", "said"),
    [
        (r"\w+_mm", 1e-3, "lengths look like metres"),
        ("mass_g", 1e-3, "masses look like kilograms"),
        ("limits_deg", np.pi / 180, "limits_deg looks like radians"),
        ("(?:theta|alpha)_deg", np.pi / 180, "looks like radians"),
        ("gravity_m_per_s2", 1e3, "mm/s2"),
    ],
)
def test_an_arm_in_other_units(name: str, key: str, factor: float, said: str, tmp_path: Path) -> None:
    path = tmp_path / "arm.toml"
    path.write_text(scaled(shipped_arms()[name].read_text(), key, factor))
    with pytest.raises(FileError, match=said):
        load_arm(path)


@pytest.mark.parametrize("name", sorted(shipped_arms()))
def test_shipped_arms_are_plausible(name: str) -> None:
    assert list(implausible(load_arm(name))) == []


def test_the_arm_is_said_not_the_positions(tmp_path: Path) -> None:
    arm = tmp_path / "arm.toml"
    arm.write_text(scaled(shipped_arms()["lrm-lab"].read_text(), r"\w+_mm", 1e-3))
    said = stderr_of("fit", EXAMPLE, "--arm", arm)
    assert "the arm is 0.418 mm long: its lengths look like metres" in said
    assert "micrometres" not in said


@pytest.mark.parametrize(
    ("attribute", "factor", "said"),
    [("xyz", 1e3, "look like .*millimetres"), ("value", 1e3, "look like grams"), ("value", 4e4, "body '.*' weighs")],
)
def test_a_urdf_in_other_units(attribute: str, factor: float, said: str, tmp_path: Path) -> None:
    text = ElementTree.tostring(bare_urdf(load_arm("so101")).tree, encoding="unicode")

    def one(found: re.Match[str]) -> str:
        return found[1] + " ".join(str(float(word) * factor) for word in found[2].split()) + '"'

    where = r'(<origin[^>]*?xyz=")([^"]*)"' if attribute == "xyz" else r'(<mass value=")([^"]*)"'
    path = tmp_path / "robot.urdf"
    path.write_text(re.sub(where, one, text))
    with pytest.raises(FileError, match=said):
        import_arm(read_urdf(path))


def changed(folder: Path, change: Callable[[list[str], list[str]], None], header: str = "") -> Path:
    """The first rows of the shipped data, with every row changed; `change(names, cells)` in place."""
    path = folder / "data.csv"
    names, *rows = [line.split(",") for line in EXAMPLE.read_text().splitlines()[:61]]
    for row in rows:
        change(names, row)
    path.write_text("\n".join(",".join(row) for row in [[*names, *([header] if header else [])], *rows]) + "\n")
    shutil.copy(EXAMPLE.with_suffix(".toml"), path.with_suffix(".toml"))
    return path


def column(name: str, value: Callable[[str], str]) -> Callable[[list[str], list[str]], None]:
    """A change of one column."""

    def change(names: list[str], cells: list[str]) -> None:
        place = names.index(name)
        cells[place] = value(cells[place])

    return change


@pytest.mark.parametrize(
    ("change", "header", "said"),
    [
        (column("payload_g", lambda _: "0.25"), "", "line 2, column payload_g: 0.25 g is not plausible.*kg .250 g"),
        (column("x_mm", lambda _: "-1e300"), "", "line 2, column x_mm: 1e.300 mm is not plausible as a coordinate"),
        (column("payload_g", lambda _: "250000"), "", "column payload_g.*mg"),
        (column("t_s", lambda _: "20240715101500"), "", "column t_s: 20240715101500 s.*dates as"),
        (column("t_s", lambda t: f"{(1.7e9 + float(t)) * 1e3:.0f}"), "", "milliseconds"),
        (lambda _, cells: cells.append("294.15"), "temp_c", "column temp_c: 294.1 degC.*kelvin .21 degC"),
        (lambda _, cells: cells.append("300"), "sd_mm", "column sd_mm: 300 mm.*micrometres"),
    ],
)
def test_columns_in_other_units(
    change: Callable[[list[str], list[str]], None], header: str, said: str, lab: Arm, tmp_path: Path
) -> None:
    with pytest.raises(FileError, match=said):
        load_measurements(changed(tmp_path, change, header), lab)


def test_a_noise_that_no_tracker_has_is_said(lab: Arm, tmp_path: Path) -> None:
    path = changed(tmp_path, lambda _, cells: cells.append("0.0003"), "sd_mm")
    notices = load_measurements(path, lab).notices
    assert any("sd_mm is 0.0003 mm" in words and "0.3 mm" in words for words in notices)


def test_metadata_in_other_units(lab: Arm, tmp_path: Path) -> None:
    path = changed(tmp_path, lambda _, __: None)
    path.with_suffix(".toml").write_text('schema = "lrm/measurements/1"\nnoise_sd_mm = 300.0\n')
    with pytest.raises(FileError, match=r"noise_sd_mm: 300 mm is not plausible.*micrometres"):
        load_measurements(path, lab)


def test_dates_are_times(lab: Arm, tmp_path: Path) -> None:
    minutes = iter(range(60))
    path = changed(tmp_path, column("t_s", lambda _: f"2024-07-15T10:{next(minutes):02d}:00+02:00"))
    data = load_measurements(path, lab)
    assert data.poses.t is not None
    np.testing.assert_allclose(data.poses.t, 60.0 * np.arange(60))


@pytest.mark.long
@pytest.mark.parametrize(
    ("poses", "said"), [("5-2", "runs backwards; is 2-5 meant"), ("1-300", "none of the 300 poses")]
)
def test_ranges_of_poses_that_cannot_be_left_out(poses: str, said: str) -> None:
    assert said in stderr_of("fit", EXAMPLE, "--leave-out", poses)


@given(
    st.floats(1e-3, 1e3),
    st.floats(2.0, 50.0),
    st.lists(st.floats(-1e6, 1e6, allow_nan=False), min_size=1, max_size=8),
)
def test_a_value_is_doubted_exactly_outside_its_range(low: float, width: float, values: list[float]) -> None:
    quantity = PlausibleSize("length", "mm", low, low * width, times(m=1e3))
    outside = [row for row, value in enumerate(values) if value and not low <= abs(value) <= low * width]
    found = implausible_value(quantity, values)
    assert (found is None) == (not outside)
    if found:
        assert found.row == outside[0]
        assert ("looks like m" in found.what) == (low <= abs(values[found.row]) * 1e3 <= low * width)


def test_an_imported_arm_may_be_written_and_shown(tmp_path: Path) -> None:
    (tmp_path / "arm.toml").write_text(arm_text(load_arm("so101"), source="", comments=()))
    assert "so101" in stdout_of("arm", "show", tmp_path / "arm.toml")
    assert run_command("arm", "show", "ur5")[0] == 0
