"""Bad input, and quantities of no plausible size: one clear line of what and where, code 2, no file is written."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.data.registration.point_set import nominal_tcp
from lrm_ident.data.robot_files.arm_text import arm_text
from lrm_ident.data.robot_files.urdf import read_urdf
from lrm_ident.data.robot_files.urdf_arm import import_arm
from lrm_ident.data.robot_files.urdf_export import bare_urdf
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm, shipped_arms
from lrm_math.arm.plausible_arm import implausible
from lrm_math.errors import FileError
from lrm_math.kinematics.poses import poses_of
from lrm_math.plausibility import PlausibleSize, implausible_value, times
from tests.conftest import EXAMPLE, ROOT
from tests.support.commands import run_command, stderr_of, stdout_of
from tests.support.scaled_arm import scaled_arm

HEADER = "pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,x_mm,y_mm,z_mm"
NUMBERS = np.arange(1, 61)
ANGLES = np.stack([NUMBERS, 2 * NUMBERS % 90, -NUMBERS, 3 * NUMBERS % 90, -2 * NUMBERS % 90, NUMBERS % 50], axis=1)
NOMINAL = nominal_tcp(load_arm("lrm-lab"), poses_of(np.radians(ANGLES))) * 1e3
MEASURED = NOMINAL + np.random.default_rng(0).normal(0.0, 0.3, NOMINAL.shape)
ROWS = [
    ",".join(map(str, [number, *angles, *(f"{value:.3f}" for value in position)]))
    for number, angles, position in zip(NUMBERS, ANGLES.tolist(), MEASURED, strict=True)
]
"""Sixty poses of the nominal arm, as a tracker measures them."""
LAB = (ROOT / "config" / "arms" / "lrm-lab.toml").read_text()


def assert_names(stderr: str, *words: str) -> None:
    for word in words:
        assert word in stderr, f"'{word}' is not in: {stderr}"


@pytest.mark.slow
def test_the_process_itself_ends_with_the_line_and_exit_code_2() -> None:
    command = [sys.executable, "-m", "lrm_ident", "fit", "nothing.csv", "--arm", "lrm-lab"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 2, done.stdout + done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert_names(done.stderr, "error: ", "no such file")


def edited(row: int, column: int, text: str) -> list[str]:
    rows = list(ROWS)
    cells = rows[row].split(",")
    cells[column] = text
    rows[row] = ",".join(cells)
    return rows


BAD_DATA: dict[str, tuple[list[str], tuple[str, ...]]] = {
    "truncated": ([HEADER, *ROWS[:20], ROWS[20][:12]], ("line 22", "cells", "cut off")),
    "text in a number column": ([HEADER, *edited(4, 7, "far")], ("line 6", "x_mm", "'far' is not a number")),
    "NaN": ([HEADER, *edited(9, 8, "nan")], ("line 11", "y_mm", "finite")),
    "infinity": ([HEADER, *edited(9, 2, "inf")], ("line 11", "q2_deg", "finite")),
    "empty cell": ([HEADER, *edited(9, 9, "")], ("line 11", "z_mm", "empty")),
    "duplicate pose": ([HEADER, *edited(7, 0, "3")], ("line 9", "pose 3", "line 4")),
    "pose number with a fraction": ([HEADER, *edited(7, 0, "3.5")], ("line 9", "pose", "whole")),
    "beyond the limits": ([HEADER, *edited(2, 4, "117")], ("line 4", "q4_deg", "117", "joint 4", "-100 to 100")),
    "missing column": ([HEADER.replace(",q6_deg", ""), "1,1,1,1,1,1,1,1,1"], ("header", "q6_deg", "there are: pose,")),
    "column twice": ([HEADER + ",x_mm", *(r + ",1" for r in ROWS)], ("header", "x_mm", "twice")),
    "fewer poses than parameters": ([HEADER, *ROWS[:12]], ("12 poses", "parameters")),
    "no rows": ([HEADER], ("no rows",)),
    "empty file": ([], ("is empty", "header")),
    "negative load": ([HEADER + ",payload_g", *(r + ",-1" for r in ROWS)], ("line 2", "payload_g", "negative")),
    "repeat of nothing": ([HEADER + ",repeat_of", *(r + ",999" for r in ROWS)], ("line 2", "repeat_of", "999")),
    "not positive sd": ([HEADER + ",sd_mm", *(r + ",0" for r in ROWS)], ("line 2", "sd_mm", "above zero")),
}


@pytest.mark.parametrize("name", BAD_DATA)
def test_measurements(tmp_path: Path, name: str) -> None:
    lines, words = BAD_DATA[name]
    data = tmp_path / "data.csv"
    data.write_text("\n".join(lines) + "\n")
    output, json = tmp_path / "model.toml", tmp_path / "out.json"
    stderr = stderr_of("fit", data, "--arm", "lrm-lab", "--parameters", "option1", "-o", output, "--json", json)
    assert_names(stderr, *words)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["data.csv"]


@pytest.mark.parametrize(
    "cell", ["n/a", "--", "12,5", "1O", "true", "'7'", "1.2.3", "#REF!", "1e999", "-inf", "1 2", "0x10"]
)
@pytest.mark.parametrize("place", [3, 8])
def test_a_cell_that_is_no_number_is_named_by_its_line(cell: str, place: int, lab: Arm, tmp_path: Path) -> None:
    data = tmp_path / "data.csv"
    data.write_text("\n".join([HEADER, *edited(4, place, cell)]) + "\n")
    with pytest.raises(FileError, match="line 6"):
        load_measurements(data, lab)


BAD_ARM: dict[str, tuple[Callable[[str], str], tuple[str, ...]]] = {
    "unknown key": (lambda t: t.replace("d_mm = 46.905", "d_cm = 4.69", 1), ("joint 1", "d_cm", "d_mm")),
    "a text": (lambda t: t.replace("a_mm = 0.0", 'a_mm = "none"', 1), ("joint 1", "a_mm", "number")),
    "servo table": (lambda t: t.replace("[620.0, 1540.0, 2460.0]", "[620.0, 1540.0, 1000.0]"), ("joint 1", "pulses")),
    "ms for us": (lambda t: t.replace("[620.0, 1540.0, 2460.0]", "[0.62, 1.54, 2.46]"), ("joint 1", "pulse_us", "100")),
    "follows with a servo": (
        lambda t: t.replace("[[joint]]", '[[joint]]\nfollow = {joint = "joint2"}', 1),
        ("joint 1", "no servo"),
    ),
    "other schema": (lambda t: t.replace("lrm/arm/1", "lrm/arm/9"), ("schema", "lrm/arm/1")),
    "not TOML": (lambda t: t + "\n]", ("not valid TOML",)),
}


def test_all_faults_of_an_arm_are_said_at_once(tmp_path: Path) -> None:
    changes = [
        ("d_mm = 46.905\n", "", ("joint 1", "missing key d_mm")),
        ("[-100.0, 100.0]", "[100.0, -100.0]", ("joint 1", "limits_deg", "lower")),
        ("beta_deg", "beta_rad", ("base", "beta_rad", "beta_deg")),
        ("mass_g = 177.0", "mass_g = nan", ("body 2", "mass_g", "finite")),
        ('frame = "joint4"', 'frame = "joint9"', ("link 4", "joint9", "joint4")),
        ("loads_joint = 5", "loads_joint = 2", ("link 5", "loads_joint is 2")),
        ("[tool]", "[tooool]", ("unknown key tooool", "tool")),
    ]
    text = LAB
    for before, after, _ in changes:
        text = text.replace(before, after, 1)
    arm, data = tmp_path / "arm.toml", tmp_path / "data.csv"
    arm.write_text(text)
    data.write_text("\n".join([HEADER, *ROWS]) + "\n")
    code, _, stderr = run_command("fit", data, "--arm", arm)
    assert code == 2
    first, *faults = stderr.splitlines()
    assert f"{len(faults)} faults" in first
    for _, _, words in changes:
        assert any(all(word in fault for word in words) for fault in faults), f"{words} not in\n{stderr}"


def test_a_missing_joint_is_said_of_every_body_that_needs_it(tmp_path: Path) -> None:
    arm = tmp_path / "arm.toml"
    arm.write_text(LAB.replace(LAB[LAB.rindex("[[joint]]") : LAB.index("[tool]")], ""))
    with pytest.raises(FileError) as caught:
        load_arm(str(arm))
    assert_names(str(caught.value), "link 6", "target", "load screw", "loads_joint is 6")


@pytest.mark.parametrize("name", BAD_ARM)
def test_arms(tmp_path: Path, name: str) -> None:
    change, words = BAD_ARM[name]
    arm, data = tmp_path / "arm.toml", tmp_path / "data.csv"
    arm.write_text(change(LAB))
    data.write_text("\n".join([HEADER, *ROWS]) + "\n")
    output = tmp_path / "model.toml"
    code, _, stderr = run_command("fit", data, "--arm", arm, "-o", output)
    assert code == 2
    assert stderr.startswith("error: ")
    assert_names(stderr, "arm.toml", *words)
    assert not output.exists()


MODEL = 'schema = "lrm/model/1"\narm = "lrm-lab"\neffects = ["offsets", "compliance"]\n'
BAD_MODEL: dict[str, tuple[str, tuple[str, ...]]] = {
    "unknown parameter": (
        MODEL + '[parameters]\n"offsets.joint2.alhpa_rad" = 0.1\n',
        ("parameters", "alhpa", "offsets.joint2.alpha_rad"),
    ),
    "unknown effect": (MODEL.replace("compliance", "complience"), ("effects", "complience", "compliance")),
    "unknown place": (MODEL.replace("compliance", "backlash@joint9"), ("effects", "joint9", "joint6")),
    "effect twice": (
        MODEL.replace('"compliance"', '"compliance", "compliance@joint2"'),
        ("compliance.joint2", "twice"),
    ),
    "unknown arm": (MODEL.replace("lrm-lab", "lrm-lub"), ("arm", "lrm-lub", "lrm-lab")),
    "unknown key": (MODEL + "[parametres]\n", ("parametres", "parameters")),
    "not a number": (MODEL + '[parameters]\n"offsets.base.x_mm" = nan\n', ("offsets.base.x_mm", "finite")),
    "does not settle": (
        MODEL + '[parameters]\n"compliance.joint2.k_rad_per_Nm" = 5.0\n',
        ("pose", "does not settle", "rad/Nm"),
    ),
}


@pytest.mark.long
@pytest.mark.parametrize("name", BAD_MODEL)
@pytest.mark.parametrize("command", ["compare", "predict"])
def test_models(tmp_path: Path, name: str, command: str) -> None:
    text, words = BAD_MODEL[name]
    model, data = tmp_path / "model.toml", tmp_path / "data.csv"
    model.write_text(text)
    data.write_text("\n".join([HEADER, *ROWS]) + "\n")
    output = tmp_path / "out"
    assert_names(stderr_of(command, model, data, "--json" if command == "compare" else "-o", output), *words)
    assert not output.exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["fit", "nothing.csv", "--arm", "lrm-lab"], "no such file"),
        (["fit", "{data}"], "no arm given"),
        (["fit", "{data}", "--arm", "lrm-leb"], "no such arm"),
        (["fit", "{data}", "--arm", "lrm-lab", "--effects", "offsetts"], "offsets"),
        (["fit", "{data}", "--arm", "lrm-lab", "--parameters", "offsets.joint7.*"], "unknown parameter"),
        (["fit", "{data}", "--arm", "lrm-lab", "--loss", "hubber"], "huber"),
        (
            ["fit", "{data}", "--arm", "lrm-lab", "--parameters", "option3", "-o", "{data}/no/model.toml"],
            "cannot be written",
        ),
        (["compare", "nothing.toml", "{data}"], "no such file"),
    ],
)
def test_command_lines(tmp_path: Path, words: list[str], said: str) -> None:
    data = tmp_path / "data.csv"
    data.write_text("\n".join([HEADER, *ROWS]) + "\n")
    assert_names(stderr_of(*(word.format(data=data) for word in words)), said)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["data.csv"]


def test_metadata(tmp_path: Path) -> None:
    data = tmp_path / "data.csv"
    data.write_text("\n".join([HEADER, *ROWS]) + "\n")
    beside = tmp_path / "data.toml"
    for text, words in [
        ('schema = "lrm/measurements/1"\narm = "lrm-lab"\nnoise_mm = 1.0\n', ("data.toml", "noise_mm", "noise_sd_mm")),
        ('schema = "lrm/measurements/1"\narm = "lrm-lab"\nstart_q_deg = [0, 0]\n', ("data.toml", "start_q_deg", "6")),
    ]:
        beside.write_text(text)
        assert_names(stderr_of("fit", data), *words)


@pytest.mark.parametrize("name", sorted(shipped_arms()))
@pytest.mark.parametrize(
    ("key", "factor", "said"),
    [
        (r"\w+_mm", 1e-3, "lengths look like metres"),
        (r"\w+_mm", 1e3, "_mm = .* should be|lengths look like micrometres"),
        ("mass_g", 1e-3, "masses look like kilograms"),
        ("mass_g", 1e3, "mass_g = .* should be|weigh|masses look like"),
        ("limits_deg", np.pi / 180, "limits_deg looks like radians"),
        ("(?:theta|alpha)_deg", np.pi / 180, "looks like radians"),
        ("gravity_m_per_s2", 1e3, "mm/s2"),
    ],
)
def test_an_arm_in_other_units(name: str, key: str, factor: float, said: str, tmp_path: Path) -> None:
    path = tmp_path / "arm.toml"
    path.write_text(scaled_arm(shipped_arms()[name].read_text(), key, factor))
    with pytest.raises(FileError, match=said):
        load_arm(path)


@pytest.mark.parametrize("name", sorted(shipped_arms()))
def test_shipped_arms_are_plausible(name: str) -> None:
    assert list(implausible(load_arm(name))) == []


def test_the_arm_is_said_not_the_positions(tmp_path: Path) -> None:
    arm = tmp_path / "arm.toml"
    arm.write_text(scaled_arm(shipped_arms()["lrm-lab"].read_text(), r"\w+_mm", 1e-3))
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
    notices = load_measurements(path, lab).source.notices
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


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("predict", "MODEL", "DATA", "-o", "new.toml"), "new.toml: -o writes no .toml file; name it .csv"),
        (("predict", "MODEL", "DATA", "-o", "new.xlsx"), "new.xlsx: -o writes no .xlsx file; name it .csv"),
        (("fit", "DATA", "-o", "new.csv"), "new.csv: -o writes no .csv file; name it .toml"),
        (("compare", "MODEL", "DATA", "--json", "new.toml"), "new.toml: --json writes no .toml file; name it .json"),
        (("camera", "board", "-o", "new.txt"), "new.txt: -o writes no .txt file; name it .pdf"),
        (("diagnose", "MODEL", "DATA", "--effects-file", "DATA"), "is no Python file"),
    ],
)
def test_an_output_has_the_ending_of_its_kind(words: Sequence[str], said: str, tmp_path: Path) -> None:
    """Before: `predict -o data.toml` wrote a table that was read as the metadata of data.csv from then on."""
    named = {"MODEL": ROOT / "tests" / "models" / "thesis-table-b2-option-1.toml", "DATA": EXAMPLE}
    called = [named.get(word, tmp_path / word if word.startswith("new.") else word) for word in words]
    assert said in stderr_of(*called)
    assert not [*tmp_path.iterdir()]
