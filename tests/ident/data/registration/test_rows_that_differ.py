"""Files of which some rows differ from the rest: another frame, positions a row off, a number typed wrongly."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import lrm_ident as lrm
from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.data.measurement_file.write import measurements_csv
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.registration.checked import Misread, _check, load_checked
from lrm_ident.data.registration.moved_frame import moved_frame
from lrm_math.arm.arm_file import load_arm
from lrm_math.errors import FileError
from tests.conftest import EXAMPLE
from tests.support.commands import stderr_of, stdout_of
from tests.support.misreadings import random_arm_data

ARM = load_arm("lrm-lab")


@pytest.fixture(scope="module")
def measured() -> Measurements:
    return load_measurements(EXAMPLE, ARM)


def typed_wrongly(folder: Path, pose: int, column: int, text: str) -> Path:
    """The example with another text in one cell, without a file beside it that names the arm."""
    lines = EXAMPLE.read_text(encoding="utf-8").splitlines()
    cells = lines[pose].split(",")
    cells[column] = text
    lines[pose] = ",".join(cells)
    path = folder / "typed.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.mark.long
@pytest.mark.parametrize(("first", "seed"), [(60, 1), (150, 2), (241, 3)])
def test_the_pose_from_which_the_frame_was_moved_is_found(measured: Measurements, first: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    turn = Rotation.from_rotvec(np.radians(random.uniform(8.0, 40.0)) * np.array([0.0, 0.6, 0.8])).as_matrix()
    shift = random.uniform(-0.3, 0.3, 3)
    tcp = measured.tcp.copy()
    tcp[first:] = (tcp[first:] - shift) @ turn
    found = moved_frame(ARM, measured.with_tcp(tcp))
    assert found.first == measured.pose[first]
    assert found.last == measured.pose[-1]
    assert found.angle == pytest.approx(np.arccos((np.trace(turn) - 1.0) / 2.0), abs=np.radians(1.0))
    assert found.distance == pytest.approx(np.linalg.norm((measured.tcp[first:] - tcp[first:]).mean(axis=0)), abs=0.005)
    assert found.score < 0.01


@pytest.mark.long
def test_a_moved_tracker_is_said_with_a_remedy_that_works(measured: Measurements, tmp_path: Path) -> None:
    tcp = measured.tcp.copy()
    tcp[150:] = tcp[150:] @ Rotation.from_euler("z", 20.0, degrees=True).as_matrix().T + [0.3, -0.2, 0.1]
    path = tmp_path / "moved.csv"
    path.write_text(measurements_csv(measured.with_tcp(tcp)), encoding="utf-8")
    with pytest.raises(Misread, match=r"from pose 151 on .* turned by 20\.\d deg .*--leave-out 151-300 "):
        load_checked(path, ARM)
    model = str(tmp_path / "model.toml")
    fitted = stdout_of("fit", str(path), "--arm", "lrm-lab", "--leave-out", "151-300", "-o", model)
    assert "150 poses, 45 parameters; 150 poses left out: 151" in fitted
    assert "backlash@joint2" in stdout_of("diagnose", model, str(path)).splitlines()[0]


@pytest.mark.long
@pytest.mark.parametrize(("by", "which"), [(1, "after"), (-1, "before")])
def test_positions_of_the_next_row_are_said(measured: Measurements, tmp_path: Path, by: int, which: str) -> None:
    path = tmp_path / "shifted.csv"
    path.write_text(measurements_csv(measured.with_tcp(np.roll(measured.tcp, -by, axis=0))), encoding="utf-8")
    with pytest.raises(Misread, match=f"belongs to the joint angles of the row {which}; .*shift the columns"):
        load_checked(path, ARM)


@pytest.mark.long
def test_a_row_that_is_left_out_is_not_tested(tmp_path: Path) -> None:
    path, model = typed_wrongly(tmp_path, 40, 5, "-705.3"), tmp_path / "model.toml"
    fit = ["fit", str(path), "--arm", "lrm-lab", "--force", "-o", str(model)]
    assert "line 41, column q2_deg: -705.3 deg is beyond the limits of joint 2" in stderr_of(*fit)
    assert "line 41, column q2_deg" in stderr_of(*fit, "--leave-out", "41")
    assert "299 poses, 45 parameters; 1 pose left out: 40" in stdout_of(*fit, "--leave-out", "40")
    assert "(backlash@joint2)" in stdout_of("diagnose", str(model), str(path)).splitlines()[0]
    with pytest.raises(FileError, match="line 41, column q2_deg"):
        lrm.load(path, "lrm-lab")
    assert 40 not in lrm.load(path, "lrm-lab", leave_out=[40]).pose


@pytest.mark.long
def test_only_the_pose_that_tore_the_fit_is_proposed_to_be_left_out(tmp_path: Path) -> None:
    path = typed_wrongly(tmp_path, 40, 10, "754.0")
    assert "add --leave-out 40. To" in stdout_of("fit", str(path), "--arm", "lrm-lab")


@pytest.mark.long
@pytest.mark.parametrize("first", [200, 260])
def test_a_session_whose_axes_were_swapped_is_named(measured: Measurements, first: int) -> None:
    """Half of the rows were taken for an error of joint 1, a fifth for wrong measurements."""
    tcp, session = measured.tcp.copy(), np.ones(len(measured))
    tcp[first:], session[first:] = tcp[first:][:, [1, 0, 2]], 2.0
    data = replace(measured.with_tcp(tcp), poses=replace(measured.poses, session=session))
    with pytest.raises(Misread, match=r"session 2: x and y look swapped.*--axes y,x,z.*--leave-out \d+-\d+") as fault:
        _check(ARM, data)
    assert str(data.pose[first]) in str(fault.value)
    assert _check(ARM, replace(measured, poses=replace(measured.poses, session=session))) == ()


@pytest.mark.long
def test_a_column_that_is_not_used_is_said_where_nothing_fits(tmp_path: Path) -> None:
    """A rail below the arm: y was said not to belong to these angles, and nothing told that a column was left out."""
    header, *rows = EXAMPLE.read_text(encoding="utf-8").splitlines()[:91]
    random, y = np.random.default_rng(4), header.split(",").index("y_mm")
    lines = [f"rail_mm,{header}"]
    for row in rows:
        cells, rail = row.split(","), float(random.choice([0.0, 150.0, 300.0, 450.0]))
        cells[y] = f"{float(cells[y]) + rail:.3f}"
        lines.append(f"{rail:g},{','.join(cells)}")
    path = tmp_path / "rail.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    with pytest.raises(Misread, match="not used, though it may move the tip: rail_mm"):
        load_checked(path, ARM)


@pytest.mark.long
@pytest.mark.parametrize(("arm", "seed"), [("lrm-lab", 1), ("so101", 2)])
@pytest.mark.parametrize(("lost", "which"), [("position", "after"), ("angles", "before")])
def test_a_row_that_one_half_of_the_file_lost_is_named(arm: str, seed: int, lost: str, which: str) -> None:
    """Before: no reading explained them, and the message asked whether it is another arm."""
    data, first = random_arm_data(arm, seed, poses=120), 30 + 30 * seed
    kept = np.arange(119)
    after = kept + (kept >= first)
    rows, tips = (kept, after) if lost == "position" else (after, kept)
    torn = data.take(kept).with_tcp(data.tcp[tips])
    torn = replace(torn, poses=replace(torn.poses, q=data.poses.q[rows]))
    named = f"({torn.pose[first]}|{torn.pose[first + 1]})"  # the position at the lost angles belongs to no row
    with pytest.raises(Misread, match=f"from pose {named} on each position .* row {which}; ") as fault:
        _check(load_arm(arm), torn)
    assert f"a {'position' if lost == 'position' else 'row of angles'} is missing there" in str(fault.value)


@pytest.mark.long
@pytest.mark.parametrize("arm", ["lrm-lab", "so101"])
def test_a_column_that_stands_still_while_its_joint_moves_is_named(arm: str) -> None:
    """Before: of an arm with a narrow range every constant counted as like its angles, and another joint was named."""
    data = random_arm_data(arm, 5, poses=120)
    for joint in range(1, 4):
        q = data.poses.q.copy()
        q[:, joint] = q[:, joint].mean()
        with pytest.raises(Misread, match=f"the angles of joint {joint + 1} do not belong"):
            _check(load_arm(arm), replace(data, poses=replace(data.poses, q=q)))


@pytest.mark.long
@pytest.mark.parametrize("arm", ["lrm-lab", "so101"])
def test_an_arm_that_was_moved_along_an_axis_is_no_wrong_column(arm: str) -> None:
    """Before: y alone looked wrong, and the message sent the user to its column."""
    data = random_arm_data(arm, 6, poses=120)
    tcp = data.tcp + np.outer(np.arange(120) >= 60, [0.0, 0.4, 0.0])
    with pytest.raises(Misread, match=r"from pose 61 on the positions are in another frame.*moved by 4\d\d mm"):
        _check(load_arm(arm), data.with_tcp(tcp))
