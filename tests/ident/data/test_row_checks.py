"""Lost positions, gaps and other orders of the rows, joint names of the arm, orientations in other orders."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from lrm_ident.data.measurement_file.commanded_poses import after_gap, directions
from lrm_ident.data.measurement_file.load import load_measurements, load_pose_table, pose_doubts
from lrm_ident.data.measurement_file.write import csv_text, measurements_csv
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.observations.encoder_readings import EncoderReadings
from lrm_ident.data.observations.orientations import Orientations
from lrm_ident.data.observations.positions import Positions, rounding_step
from lrm_ident.data.observations.touched_points import TouchedPoints
from lrm_ident.data.registration.checked import check_orientations, load_checked
from lrm_ident.data.rigid_motion import quaternions
from lrm_ident.data.source import Source
from lrm_ident.data.weights.model_error import additional_sd, with_model_error
from lrm_ident.fitting.cross_validation import cross_validated_residual
from lrm_ident.fitting.loss import SQUARED
from lrm_ident.fitting.model_fit import fit_model, nominal_model
from lrm_ident.fitting.typical_prior import TYPICAL
from lrm_ident.residual.error_breakdown import HeldOutResidual
from lrm_ident.study.inputs import effective_parameters
from lrm_ident.study.model_history import model_file
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import MM, load_arm
from lrm_math.effects import CATALOGUE, effects_at
from lrm_math.errors import FileError
from lrm_math.kinematics.motion import recorded
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from lrm_math.model.reading import Reading
from lrm_math.model.sensed import tool_rotation
from lrm_math.model.step_name import FIT, StepName
from tests.conftest import EXAMPLE
from tests.support.commands import run_command, stderr_of, stdout_of
from tests.support.sweep import seeds

HEADER = EXAMPLE.read_text(encoding="utf-8").splitlines()[0].split(",")


def example(folder: Path, rows: list[list[str]], header: list[str] | None = None) -> Path:
    """A file of rows of the shipped data set."""
    path = folder / "data.csv"
    names = header or EXAMPLE.read_text().splitlines()[0].split(",")
    path.write_text("\n".join(",".join(row) for row in [names, *rows]) + "\n")
    shutil.copy(EXAMPLE.with_suffix(".toml"), path.with_suffix(".toml"))
    return path


def rows_of(count: int) -> list[list[str]]:
    return [line.split(",") for line in EXAMPLE.read_text().splitlines()[1 : count + 1]]


@pytest.mark.long
def test_zeros_of_a_lost_tracker_are_left_out_and_said(lab: Arm, tmp_path: Path) -> None:
    rows, healthy = rows_of(80), rows_of(80)
    for lost in (3, 40, 41):
        rows[lost][-3:] = ["0.0", "0", "-0.000"]
    data = load_checked(example(tmp_path, rows), lab)
    assert data.source.left_out == (4, 41, 42)
    assert any("exactly 0, 0, 0" in words and "4, 41, 42" in words for words in data.source.notices)
    whole = load_checked(example(tmp_path, healthy), lab).without([4, 41, 42])
    np.testing.assert_array_equal(data.tcp, whole.tcp)
    np.testing.assert_array_equal(data.poses.direction, whole.poses.direction)  # the arm was there all the same


def test_a_frozen_tracker_is_left_out_and_said(lab: Arm, tmp_path: Path) -> None:
    rows = rows_of(80)
    for stale in (10, 11):
        rows[stale][-3:] = rows[9][-3:]
    data = load_checked(example(tmp_path, rows), lab)
    assert data.source.left_out == (11, 12)
    assert any("stands still" in words and "11, 12" in words for words in data.source.notices)


def test_rows_that_are_copies_are_left_out_and_said(lab: Arm, tmp_path: Path) -> None:
    """A table that was pasted twice: its copies counted as poses, and narrowed every interval."""
    rows = rows_of(80)
    copies = [[str(81 + number), *row[1:]] for number, row in enumerate(rows[:40])]
    data = load_checked(example(tmp_path, [*rows, *copies]), lab)
    assert data.source.left_out == tuple(range(81, 121))
    assert any("left out as copies" in words and "81, 82" in words for words in data.source.notices)
    np.testing.assert_array_equal(data.tcp, load_checked(example(tmp_path, rows), lab).tcp)


def test_a_repetition_that_reads_the_same_is_no_copy(lab: Arm, tmp_path: Path) -> None:
    names = ["repeat_of", *EXAMPLE.read_text().splitlines()[0].split(",")]
    rows = [["", *row] for row in rows_of(40)]
    data = load_checked(example(tmp_path, [*rows, ["40", "41", *rows[-1][2:]]], names), lab)
    assert len(data) == 41


def test_nothing_but_zeros(lab: Arm, tmp_path: Path) -> None:
    with pytest.raises(FileError, match="every position is 0, 0, 0"):
        load_measurements(example(tmp_path, [[*row[:-3], "0", "0", "0"] for row in rows_of(20)]), lab)


def test_a_position_that_no_tip_can_have_is_an_error_unless_its_pose_is_left_out(lab: Arm, tmp_path: Path) -> None:
    """A decimal comma that was forgotten: the fit ran, and its error was 1.4 m."""
    rows = rows_of(80)
    rows[20][-3] = rows[20][-3].replace(".", "")
    path = example(tmp_path, rows)
    with pytest.raises(FileError, match=r"line 22, column x_mm: .* mm from the others.* --leave-out 21"):
        load_checked(path, lab)
    assert len(load_checked(path, lab, part=lambda data: data.without([21]))) == 79


def test_all_positions_that_no_tip_can_have_are_named_at_once(lab: Arm, tmp_path: Path) -> None:
    """A tracker that writes -9999 while it sees nothing. Before: one pose at a time."""
    rows = [[*row[:-3], *(["-9999"] * 3 if k in (7, 30) else row[-3:])] for k, row in enumerate(rows_of(80))]
    path = example(tmp_path, rows)
    with pytest.raises(FileError, match=r"line 9, .*leave all 2 such poses out with --leave-out 8,31"):
        load_checked(path, lab)
    assert len(load_checked(path, lab, part=lambda data: data.without([8, 31]))) == 78


SUMMARIES = {
    "mean": lambda column: np.mean(column),
    "std": lambda column: np.std(column, ddof=1),
    "max": max,
    "Summe": sum,
}


@pytest.mark.parametrize("digits", [4, 2])
@pytest.mark.parametrize("labels", [["mean", "std"], ["max"], ["Summe", "mean"]])
@pytest.mark.parametrize("place", ["of the number", "of a column of its own", "nowhere"])
def test_rows_that_sum_the_table_up_are_no_poses(
    lab: Arm, tmp_path: Path, place: str, labels: list[str], digits: int
) -> None:
    """Before: without a label in the column pose they were poses, and the error of the fit 15 mm in place of 3."""
    rows, first = rows_of(80), HEADER.index("q1_deg")
    columns = [[float(row[j]) for row in rows] for j in range(first, len(HEADER))]
    body = [[row[0], *row[first:], "ok"] for row in rows]
    for label in labels:
        numbers = [f"{SUMMARIES[label](column):.{digits}f}" for column in columns]
        number = label if place == "of the number" else str(len(body) + 1)
        body.append([number, *numbers, label if place == "of a column of its own" else ""])
    names, unnamed = ["pose", *HEADER[first:], "note"], 1 if place == "nowhere" else 0
    names, body = names[unnamed:], [row[unnamed:] for row in body]
    path = tmp_path / "data.csv"
    path.write_text("\n".join(",".join(row) for row in [names, *body]) + "\n")
    data = load_measurements(path, lab)
    assert len(data) == 80
    assert any("of the rows above, left out" in words for words in data.source.notices)


def test_a_last_row_like_any_other_is_a_pose(lab: Arm, tmp_path: Path) -> None:
    """Though its joints stand at the mean of the others', or at their ends, as the last row of a grid."""
    rows = rows_of(81)
    for row, angle in zip(rows, [*(sign * 40.0 for sign in (-1, 1) for _ in range(40)), 0.0], strict=True):
        row[HEADER.index("q1_deg") : HEADER.index("q1_deg") + 6] = [f"{angle}"] * 6
    assert len(load_measurements(example(tmp_path, rows), lab)) == 81


def test_a_pose_that_is_measured_again_after_a_sweep_is_no_median(lab: Arm, tmp_path: Path) -> None:
    """Every joint runs one way, so the pose in the middle is the median of every column. Before: it was left out."""
    first, rows = HEADER.index("q1_deg"), rows_of(22)
    for number, row in enumerate(rows):
        step = number if number < 21 else 10
        row[first : first + 6] = [f"{-30 + 3 * step}"] * 6
        row[-3:] = [
            f"{200 + 2 * step + 0.1 * step**2:.1f}",
            f"{-50 + 5 * step - 0.1 * step**2:.1f}",
            f"{120 + 4.5 * step:.1f}",
        ]
    assert len(load_measurements(example(tmp_path, rows), lab)) == 22


def test_a_pose_between_the_middle_ones_of_a_sweep_is_no_median(lab: Arm, tmp_path: Path) -> None:
    """Of an even number of poses the median is no row of the table. Before: it was left out."""
    first, rows = HEADER.index("q1_deg"), rows_of(21)
    for number, row in enumerate(rows):
        step = number if number < 20 else 9.5
        row[first : first + 6] = [f"{-30 + 3 * step}"] * 6
        row[-3:] = [f"{200 + 2 * step:.1f}", f"{-50 + 5 * step:.1f}", f"{120 + step + 0.3 * abs(step - 9.5):.1f}"]
        if number == 20:
            row[-1] = f"{np.median([float(each[-1]) for each in rows[:20]]):.1f}"
    assert len(load_measurements(example(tmp_path, rows), lab)) == 21


def test_poses_are_read_without_the_mean_below_them(lab: Arm, tmp_path: Path) -> None:
    """Before: `predict` took the mean row of a table of measurements for a pose."""
    rows = rows_of(30)
    columns = list(zip(*([float(cell) for cell in row] for row in rows), strict=True))
    rows.append([f"{np.mean(column):.4f}" if k else "31" for k, column in enumerate(columns)])
    poses, table = load_pose_table(example(tmp_path, rows), lab)
    assert len(poses) == 30
    assert "line 32: mean of the rows above, left out" in pose_doubts(table, lab)


def test_rows_sorted_by_a_position_are_told(lab: Arm, tmp_path: Path) -> None:
    at = HEADER.index("x_mm")
    rows = sorted(([str(k), *row[1:]] for k, row in enumerate(rows_of(60))), key=lambda row: float(row[at]))
    rows = [[str(number), *row[1:]] for number, row in enumerate(rows, start=1)]
    said = load_measurements(example(tmp_path, rows), lab).source.notices
    assert any("the rows are sorted by x" in words for words in said)
    time = HEADER.index("t_s")
    timed = [[*row[:time], f"{20 * number}", *row[time + 1 :]] for number, row in enumerate(rows)]
    for others in (rows_of(60), timed):
        notices = load_measurements(example(tmp_path, others), lab).source.notices
        assert not any("are sorted" in words for words in notices), "by time, as they were measured"


def test_an_arm_without_masses_is_said_with_its_measurements(lab: Arm, tmp_path: Path) -> None:
    """The diagnosis of such an arm names cables for its sag, and nothing told that masses were missing."""
    rows, bare = rows_of(80), replace(lab, bodies=())
    poses = load_measurements(example(tmp_path, rows), lab).poses
    for row, tcp in zip(rows, solve_equilibrium(model_of(bare, ()), poses).tcp, strict=True):
        row[-3:] = [f"{value / MM:.4f}" for value in tcp]
    path = example(tmp_path, rows)
    assert not any("no masses" in words for words in load_checked(path, lab).source.notices)
    assert any("no masses" in words for words in load_checked(path, bare).source.notices)


@pytest.mark.long
def test_a_fit_with_a_few_wrong_rows_says_how_to_leave_them_out(tmp_path: Path) -> None:
    rows = rows_of(120)
    for wrong in (10, 50, 90):
        rows[wrong][-1] = str(float(rows[wrong][-1]) + 150.0)
    path = example(tmp_path, rows)
    out = stdout_of("fit", path, "--all")
    assert "add --leave-out 11,51,91. To weigh them less: --loss huber" in out
    without = stdout_of("fit", path, "--leave-out", "11,51,91")
    assert "Outliers: " in without
    assert "--leave-out" not in without, "the poses that a hidden play throws far off are no wrong measurements"


def test_a_fit_that_loses_all_parameters_to_a_few_rows_says_which(tmp_path: Path) -> None:
    rows = rows_of(60)
    rows[20][-1] = "90000"
    path = example(tmp_path, rows)
    assert "--leave-out 21" in stderr_of("fit", path)


@given(st.lists(st.booleans(), min_size=2, max_size=25), st.integers(0, 100))
def test_after_a_split_directions_are_right_or_unknown(kept: list[bool], seed: int) -> None:
    n = len(kept)
    q = np.random.default_rng(seed).integers(-2, 3, (n, 3)) * 0.1
    rows = np.flatnonzero(kept)
    if len(rows) < 2:
        return
    whole, number = directions(q, None), np.arange(1, n + 1)
    gap = after_gap(number[rows])
    part = directions(q[rows], None, gap)
    if np.gcd.reduce(np.diff(rows)) == 1:
        known = part != 0.0
        np.testing.assert_array_equal(part[known], whole[rows][known])
    _, states = recorded(q[rows], None, gap)
    assert (states[part == 0.0] == 0.0).all()


def test_a_gap_in_the_pose_numbers_is_said(lab: Arm, tmp_path: Path) -> None:
    rows = [row for number, row in enumerate(rows_of(80), start=1) if number not in (20, 21, 50)]
    data = load_measurements(example(tmp_path, rows), lab)
    assert any("before pose 22, 51 the file lacks a pose" in words for words in data.source.notices)
    assert (data.poses.direction[[19, 47]] == 0.0).all()
    again = tmp_path / "again.csv"
    again.write_text(measurements_csv(data))
    np.testing.assert_array_equal(load_measurements(again, lab).poses.direction, data.poses.direction)


def test_other_orders_of_the_rows_are_said(lab: Arm, tmp_path: Path) -> None:
    rows = rows_of(60)
    data = load_measurements(example(tmp_path, [*rows[30:], *rows[:30]]), lab)
    assert any("do not ascend" in words for words in data.source.notices)
    assert any("t_s runs backwards" in words for words in data.source.notices)
    assert data.poses.t is None


@pytest.mark.parametrize(
    ("step", "axes", "stated", "said"),
    [
        (5.0, "xyz", 0.3, "x_mm, y_mm, z_mm are in steps of 5 mm; rounding errs by 1.4 mm (SD), more than the noise"),
        (5.0, "y", None, "y_mm are in steps of 5 mm; rounding errs by 1.4 mm (SD), more than the noise that a tracker"),
        (5.0, "xyz", 1.5, ""),
        (1.0, "xyz", 0.3, ""),
        (0.0, "xyz", 0.01, ""),
    ],
)
def test_positions_that_were_rounded_are_said(step: float, axes: str, stated: float | None, said: str) -> None:
    rng, noise = np.random.default_rng(0), None if stated is None else stated * MM
    values = rng.uniform(-0.4, 0.4, (60, 3))
    for axis in axes if step else "":
        column = values[:, "xyz".index(axis)]
        column[:] = np.round(column / (step * MM)) * step * MM
    words = [*Positions(values, noise_sd=noise).doubts(load_arm("lrm-lab"))]
    assert len(words) == bool(said)
    assert all(said in one for one in words)


def test_points_of_a_drilled_grid_are_drawn_not_rounded() -> None:
    """Before: "write more digits" of places that nobody read."""
    grid = 0.02 * np.stack(np.meshgrid(*[np.arange(12.0)] * 2, [0.0]), axis=-1).reshape(-1, 3)
    assert [*TouchedPoints(grid).doubts(load_arm("lrm-lab"))] == []
    assert len([*Positions(grid).doubts(load_arm("lrm-lab"))]) == 1


def test_few_readings_show_no_step_and_a_step_may_begin_anywhere() -> None:
    grid = 0.005 * np.arange(20) + 0.00123
    assert rounding_step(grid) == pytest.approx(0.005)
    assert rounding_step(grid[:8]) == rounding_step(np.full(20, 0.25)) == rounding_step(np.empty(0)) == 0.0


def test_times_of_a_clock_that_was_set_are_not_used_and_said(lab: Arm, tmp_path: Path) -> None:
    """Before: a drift was fitted to the jump, and a shift and creep were named in its place."""
    at, rows = EXAMPLE.read_text().splitlines()[0].split(",").index("t_s"), rows_of(40)
    late = [[*row[:at], str(float(row[at]) + 1.7e9), *row[at + 1 :]] for row in rows[:20]]
    data = load_measurements(example(tmp_path, [*late, *rows[20:]]), lab)
    assert any("t_s runs backwards at pose 21, so no times are used" in words for words in data.source.notices)
    assert data.poses.t is None
    assert data.poses.running is None
    assert data.poses.history is not None


def test_times_that_are_rather_milliseconds_are_said(lab: Arm, tmp_path: Path) -> None:
    names, rows = EXAMPLE.read_text().splitlines()[0].split(","), rows_of(30)
    slow = [[row[0], str(1000 * int(row[1])), *row[2:]] for row in rows]
    said = load_measurements(example(tmp_path, slow), lab)
    assert any(
        "4.17 h or more apart; if t_s is in milliseconds: rename it t_ms" in words for words in said.source.notices
    )
    renamed = load_measurements(example(tmp_path, slow, [name.replace("t_s", "t_ms") for name in names]), lab)
    as_it_is = load_measurements(example(tmp_path, rows), lab)
    assert not any("apart" in words for words in (*renamed.source.notices, *as_it_is.source.notices))
    np.testing.assert_allclose(renamed.poses.t, as_it_is.poses.t)


def test_sessions_that_number_their_own_poses_are_numbered_through(lab: Arm, tmp_path: Path) -> None:
    rows, at = rows_of(40), EXAMPLE.read_text().splitlines()[0].split(",").index("session")
    second = [[str(number), *row[1:at], "2", *row[at + 1 :]] for number, row in enumerate(rows[20:], start=1)]
    data = load_measurements(example(tmp_path, [*rows[:20], *second]), lab)
    np.testing.assert_array_equal(data.pose, np.arange(1, 41))
    assert any("each session has its own pose numbers" in words for words in data.source.notices)
    with pytest.raises(FileError, match="pose 5 stands in line 6 already"):
        load_measurements(example(tmp_path, [*rows[:20], [*rows[4][:-1], "300.5"], *second]), lab)


def test_a_repetition_elsewhere_is_said(lab: Arm, tmp_path: Path) -> None:
    names = [*EXAMPLE.read_text().splitlines()[0].split(","), "repeat_of"]
    rows = [[*row, "1" if row[0] == "9" else ""] for row in rows_of(20)]
    assert any(
        "repeat_of: pose 9" in words for words in load_measurements(example(tmp_path, rows, names), lab).source.notices
    )


def so101_data(count: int, seed: int, hidden: str = "") -> Measurements:
    """An SO-101 with errors of assembly and springs, perhaps a hidden effect, measured to 0.1 mm."""
    arm, rng = load_arm("so101"), np.random.default_rng(seed)
    names = ("offsets", "compliance", *([hidden] if hidden else []))
    model = model_of(arm, [effect for name in names for effect in effects_at(arm, name)])
    sizes = {k: 0.3 * float(rng.normal()) * p.typical for k, p in zip(model.keys, model.parameters, strict=True)}
    sizes = {k: abs(v) if k.startswith(("compliance", "backlash")) else v for k, v in sizes.items() if "tau0" not in k}
    sizes |= {k: 0.05 for k in model.keys if k.startswith("backlash") and k.endswith("_rad")}
    limits = 0.8 * np.array([(joint.lower, joint.upper) for joint in arm.joints])
    q = rng.uniform(*limits.T, (count, arm.dof))
    poses = replace(poses_of(q), direction=directions(q, None))
    equilibrium = solve_equilibrium(model_of(arm, model.effects, sizes), poses)
    tcp = equilibrium.tcp + rng.normal(0, 1e-4, (count, 3))
    return Measurements.of_tcp(poses, tcp, source=Source(arm=arm)).beside(Orientations(tool_rotation(equilibrium)))


def as_file(folder: Path, data: Measurements, quaternion: list[str], joints: list[str], **units: float) -> Path:
    columns = [
        (name, np.degrees(angles) * units.get("angle", 1.0), 9)
        for name, angles in zip(joints, data.poses.q.T, strict=True)
    ]
    columns += [(f"{axis}_mm", data.tcp[:, i] / MM, 6) for i, axis in enumerate("xyz")]
    if quaternion:
        (seen,) = data.of(Orientations)
        columns += [(name, part, 9) for name, part in zip(quaternion, quaternions(seen.values).T, strict=True)]
        columns += [("sd_mm", np.full(len(data), 0.1), 3), ("srot_deg", np.full(len(data), 0.1), 3)]
    path = folder / "made.csv"
    path.write_text(csv_text(columns))
    return path


QUATERNION = ["qw", "qx", "qy", "qz"]
JOINTS = ["shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll"]


@pytest.mark.long
@pytest.mark.parametrize(
    ("quaternion", "said"),
    [
        (["qx", "qy", "qz", "qw"], "look like"),
        (["qw", "qy", "qx", "qz"], "look like"),
    ],
)
def test_an_orientation_in_another_order(quaternion: list[str], said: str, tmp_path: Path) -> None:
    path = as_file(tmp_path, so101_data(60, 1), quaternion, JOINTS)
    with pytest.raises(FileError, match=said) as refused:
        load_checked(path, load_arm("so101"))
    assert "the orientations miss those of so101" in str(refused.value)


def test_an_inverse_orientation(tmp_path: Path) -> None:
    data = so101_data(60, 1)
    positions, seen = data.observations
    inverse = replace(data, observations=(positions, Orientations(seen.values.transpose(0, 2, 1))))
    path = as_file(tmp_path, inverse, ["qw", "qx", "qy", "qz"], JOINTS)
    with pytest.raises(FileError, match="negate qx, qy and qz"):
        load_checked(path, load_arm("so101"))


def test_a_turned_tool_is_said_unless_assembly_explains_it() -> None:
    arm, data = load_arm("so101"), so101_data(60, 1)
    (seen,) = data.of(Orientations)
    turned = [Orientations(seen.values @ Rotation.from_euler("x", by, degrees=True).as_matrix()) for by in (8.0, 22.0)]
    check_orientations(arm, data, turned[0])
    with pytest.raises(FileError, match=r"frame of the tool looks turned by \(2[0-4], "):
        check_orientations(arm, data, turned[1])


@pytest.mark.long
def test_the_error_of_orientations_stands_in_the_tables(tmp_path: Path) -> None:
    path = as_file(tmp_path, so101_data(60, 1), ["qw", "qx", "qy", "qz"], JOINTS)
    out = stdout_of("fit", path, "--arm", "so101", "-o", tmp_path / "model.toml", "--json", tmp_path / "fit.json")
    assert "orientation RMS, deg" in " ".join(out.split())
    assert '"turn_rms_deg"' in (tmp_path / "fit.json").read_text()
    assert "orientation RMS, deg" in " ".join(stdout_of("compare", tmp_path / "model.toml", path).split())


@pytest.mark.long
def test_compare_prints_by_how_much_tools_are_turned_that_the_model_does_not_explain(tmp_path: Path) -> None:
    """Fresh orientations turned by 2 degrees, each about an axis of its own."""
    made, fresh = so101_data(60, 1), so101_data(60, 1)
    stdout_of("fit", as_file(tmp_path, made, QUATERNION, JOINTS), "--arm", "so101", "-o", tmp_path / "model.toml")
    positions, seen = fresh.observations
    axes = np.random.default_rng(7).normal(size=(60, 3))
    turn = Rotation.from_rotvec(np.radians(2.0) * axes / np.linalg.norm(axes, axis=1, keepdims=True)).as_matrix()
    turned = replace(fresh, observations=(positions, Orientations(turn @ seen.values)))
    path = as_file(tmp_path, turned, QUATERNION, JOINTS)
    out = stdout_of("compare", tmp_path / "model.toml", path)
    row = next(line for line in out.splitlines() if line.strip().startswith("model"))
    assert float(row.split()[-1]) == pytest.approx(2.0, abs=0.05), out


def test_the_joints_own_names_are_columns(tmp_path: Path) -> None:
    made = so101_data(60, 2)
    path = as_file(tmp_path, made, [], [f"{name}_rad" for name in JOINTS], angle=np.pi / 180)
    data = load_checked(path, load_arm("so101"))
    np.testing.assert_allclose(data.poses.q, made.poses.q, atol=1e-9)
    assert any("q1_deg = 'shoulder_pan_rad' times 57.2958" in words for words in data.source.notices)


@pytest.mark.parametrize(
    ("command", "feedback"),
    [
        ("action.{}.pos", "observation.state.{}.pos"),
        ("action_{}", "observation_{}"),
        ("{}.pos", "observation.{}.pos"),
        ("action/{}", "observation/state/{}"),
    ],
)
@pytest.mark.parametrize("unit", [None, "rad"])
def test_columns_of_lerobot_are_read(command: str, feedback: str, unit: Literal["rad"] | None, tmp_path: Path) -> None:
    made, scale = so101_data(60, 2), 1.0 if unit is None else np.pi / 180
    path = as_file(tmp_path, made, [], [command.format(name) for name in JOINTS], angle=scale)
    header, *rows = path.read_text().splitlines()
    read = np.degrees(made.poses.q + 0.01) * scale
    rows = [f"{row},{','.join(f'{angle:.12f}' for angle in angles)}" for row, angles in zip(rows, read, strict=True)]
    columns = ",".join(feedback.format(name) for name in JOINTS)
    path.write_text("\n".join([f"{header},{columns}", *rows, ""]))
    path.with_suffix(".toml").write_text(
        'schema = "lrm/measurements/1"\nnoise_sd_mm = 0.1\nfeedback_sd_deg = 0.1\n', encoding="utf-8"
    )
    data = load_measurements(path, load_arm("so101"), Reading(angle_unit=unit))
    np.testing.assert_allclose(data.poses.q, made.poses.q, atol=1e-9)
    (read_back,) = data.of(EncoderReadings)
    np.testing.assert_allclose(read_back.values, made.poses.q + 0.01, atol=1e-9)


def test_what_encoders_read_is_no_command(tmp_path: Path) -> None:
    path = as_file(tmp_path, so101_data(20, 2), [], [f"observation.state.{name}.pos" for name in JOINTS])
    with pytest.raises(FileError, match="missing column q1_deg"):
        load_measurements(path, load_arm("so101"))


def test_pose_is_not_required(tmp_path: Path) -> None:
    path = as_file(tmp_path, so101_data(20, 2), [], ["a", "b", "c", "d", "e"])
    with pytest.raises(FileError, match="required: q1_deg"):
        load_measurements(path, load_arm("so101"))


def test_additional_variance_of_a_known_sample() -> None:
    rng = np.random.default_rng(0)
    sd = np.where(np.arange(4000) % 2, 1e-5, 3e-4)
    residual = rng.normal(0, np.hypot(sd, 5e-4)[:, None], (4000, 3))
    assert additional_sd(residual, sd, 12000) == pytest.approx(5e-4, rel=0.03)
    assert additional_sd(rng.normal(0, 0.9 * sd[:, None], (4000, 3)), sd, 12000) == 0.0


@pytest.mark.parametrize("seed", [2, 3])
def test_what_a_prior_decides_is_no_error_of_the_model(seed: int) -> None:
    made = so101_data(24, 30 + seed)
    made = replace(made, observations=(made.positions,))
    rng, arm = np.random.default_rng(seed), load_arm("so101")
    sd = np.where(rng.random(24) < 0.5, 2e-4, 4e-4)
    known = fit_model(nominal_model(arm), made, "identifiable", SQUARED).fit
    tcp = known.equilibrium.tcp + rng.normal(0.0, sd[:, None], (24, 3))
    found = fit_model(
        nominal_model(arm), made.with_positions(replace(made.positions, values=tcp, sd=sd)), "identifiable", SQUARED
    )
    assert found.fit.effective_parameters < 0.8 * len(found.fit.model.free)
    assert found.data.positions.model_sd < 1e-4
    file = model_file(found.fit, found.data, HeldOutResidual(None), "so101", StepName(FIT), prior=TYPICAL)
    decided = effective_parameters(file, found.fit.model, CATALOGUE)
    assert decided == pytest.approx(found.fit.effective_parameters, abs=0.1)


@pytest.mark.long
@pytest.mark.parametrize("seed", seeds(1, 3))
def test_better_stated_noise_does_not_make_the_held_out_error_worse(seed: int) -> None:
    made = so101_data(90, 10 + seed, "backlash@joint2")
    made = replace(made, observations=(made.positions,))
    arm = load_arm("so101")
    sd = np.where(np.random.default_rng(seed).random(90) < 0.2, 1e-5, 3e-4)
    plain, stated = made, made.with_positions(replace(made.positions, sd=sd))
    errors = []
    for data in (plain, stated):
        found = fit_model(nominal_model(arm), data, "identifiable", SQUARED)
        left = cross_validated_residual(found.fit.model, found.data)
        errors.append(float(np.sqrt((left**2).sum(axis=1).mean())))
    assert errors[1] <= 1.1 * errors[0], errors
    blind = fit_model(nominal_model(arm), plain, "identifiable", SQUARED).fit
    assert with_model_error(stated, blind.equilibrium, blind.effective_parameters).positions.model_sd > 2e-4


@pytest.mark.long
def test_a_choice_of_few_parameters_is_no_bad_fit() -> None:
    assert run_command("fit", EXAMPLE, "--parameters", "option3")[0] == 0
