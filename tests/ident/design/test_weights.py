"""Poses are chosen by what will be measured of them: scatter, orientation, joint feedback, distances."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from lrm_ident.cli.app import app
from lrm_ident.data.measurement_file.pose_quantity import POSITION
from lrm_ident.data.measurement_file.write import measurements_csv
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.observations.encoder_readings import EncoderAngles
from lrm_ident.data.observations.orientations import POSE, Orientations
from lrm_ident.data.source import Source
from lrm_ident.data.weights.whitening import Whitening, measured_alike, root_of
from lrm_ident.design.fisher_information import fisher_information, whiten
from lrm_ident.design.pose_design import DesignProblem, design
from lrm_ident.fitting.model_fit import nominal_model
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.sensed import Sensed, TcpPosition, tool_rotation


def some_poses(arm: str, count: int, seed: int) -> Poses:
    rng, joints = np.random.default_rng(seed), load_arm(arm).joints
    return poses_of(rng.uniform(*np.array([(j.lower, j.upper) for j in joints]).T * 0.7, (count, len(joints))))


@pytest.mark.parametrize("rows", [1, 2, 3, 6])
def test_information_is_updated_for_any_number_of_rows(rows: int) -> None:
    candidates = whiten(np.random.default_rng(rows).normal(size=(30, rows, 5)))
    now = fisher_information(candidates, np.arange(12))
    plus, minus = now.log_dets(1, np.array([20])), now.log_dets(-1, np.array([3]))
    for row, sign, promised, then in (
        (20, 1, plus, [*range(12), 20]),
        (3, -1, minus, [i for i in range(12) if i != 3]),
    ):
        updated, direct = now.updated(row, sign), fisher_information(candidates, np.array(then))
        assert promised[0] == pytest.approx(direct.log_det, abs=1e-9)
        assert updated.log_det == pytest.approx(direct.log_det, abs=1e-9)
        np.testing.assert_allclose(updated.tcp_covariance, direct.tcp_covariance, atol=1e-9)


def whole_poses(count: int, turn: float) -> Whitening:
    C = np.broadcast_to(np.diag([3e-4] * 3 + [turn] * 3) ** 2, (count, 6, 6))
    return Whitening(np.full(count, 3e-4), root_of(C), POSE)


def problem(weights: Whitening | None, rivals: tuple[str, ...] = ()) -> DesignProblem:
    arm = load_arm("so101")
    effects = tuple(effect for name in rivals for effect in effects_at(arm, name))
    task = DesignProblem(nominal_model(arm), None, effects, 25, "O1", 3e-4, None, 0, 1, 0)
    return task if weights is None else replace(task, weights=measured_alike(weights))


@pytest.mark.slow
def test_more_that_is_measured_makes_the_tip_better_known() -> None:
    offered = some_poses("so101", 80, 1)
    keys = design(problem(None), offered).keys
    tips = [
        design(replace(problem(weights), keys=keys), offered).after.tcp
        for weights in (None, whole_poses(3, 0.2), whole_poses(3, 1e-3))
    ]
    assert tips[1] == pytest.approx(tips[0], rel=0.1)  # an orientation known to 11 deg tells next to nothing
    assert tips[2] < 0.8 * tips[0]


def test_poses_measured_already_count_by_their_own_noise() -> None:
    offered, had = some_poses("so101", 80, 1), some_poses("so101", 40, 2)
    task = replace(problem(None), measured=had, noise=3e-4)
    good, bad = (replace(task, measured_weights=Whitening(np.full(40, sd))) for sd in (3e-5, 3e-2))
    good, bad = (replace(each, weights=measured_alike(Whitening(np.full(3, 3e-4)))) for each in (good, bad))
    assert design(good, offered).after.tcp < 0.6 * design(bad, offered).after.tcp


@pytest.mark.long
def test_droop_and_flex_can_be_told_apart_by_feedback_that_is_planned() -> None:
    sensed = Sensed((TcpPosition(), EncoderAngles()))
    root = np.broadcast_to(np.diag([1 / 3e-4] * 3 + [1 / 5e-4] * 5), (4, 8, 8))
    planned = problem(Whitening(np.full(4, 3e-4), root, sensed), ("servo_droop@joint2",))
    found = design(planned, some_poses("so101", 80, 1))
    assert found.after.discrimination.rivals[0].power > 0.9
    with pytest.raises(Exception, match="joint feedback"):
        design(problem(None, ("servo_droop@joint2",)), some_poses("so101", 80, 1))


def test_alike_is_as_much_information_on_average() -> None:
    root = root_of(np.stack([np.diag([1.0, 4.0, np.nan]), np.diag([1.0, 1.0, 9.0])]))
    found = measured_alike(Whitening(np.ones(2), root))(some_poses("so101", 5, 0))
    np.testing.assert_allclose(found.root[0] @ found.root[0], np.diag([1.0, 0.625, 1 / 18]), atol=1e-12)


def written(path: Path, arm: str, count: int) -> Path:
    """Whole poses of the nominal arm with noise, as a file with its metadata."""
    model, rng = nominal_model(load_arm(arm)), np.random.default_rng(0)
    equilibrium = solve_equilibrium(model, some_poses(arm, count, 3))
    tcp: Array = equilibrium.tcp + rng.normal(0, 3e-4, (count, 3))
    plain = Measurements.of_tcp(equilibrium.poses, tcp, sd=np.full(count, 3e-4), source=Source(path))
    data = plain.beside(Orientations(tool_rotation(equilibrium), np.full(count, 1e-3)))
    path.write_text(measurements_csv(data))
    path.with_suffix(".toml").write_text(f'schema = "lrm/measurements/1"\narm = "{arm}"\n')
    return path


@pytest.mark.slow
@pytest.mark.parametrize("arm", ["so101", "two-joint"])
def test_choose_poses_needs_no_six_joints(arm: str, tmp_path: Path) -> None:
    data = written(tmp_path / "data.csv", arm, 60)
    done = CliRunner().invoke(app, ["choose-poses", str(data), "-n", "30"])
    assert done.exit_code == 0, done.output
    assert "30 of 60 poses" in done.output


@pytest.mark.slow
def test_design_command_weighs_as_the_file_it_has(tmp_path: Path) -> None:
    data = written(tmp_path / "data.csv", "so101", 40)
    poses = tmp_path / "offer.csv"
    q = np.degrees(some_poses("so101", 60, 8).q)
    poses.write_text("q1_deg,q2_deg,q3_deg,q4_deg,q5_deg\n" + "\n".join(",".join(f"{a:.3f}" for a in row) for row in q))
    common = ["design", "so101", "--poses", str(poses), "-n", "8", "--repeats", "0"]
    tips = {}
    for name, options in {"have": ["--have", str(data)], "like": ["--like", str(data)], "plain": []}.items():
        out = tmp_path / f"{name}.json"
        done = CliRunner().invoke(app, [*common, *options, "-n", "12", "--json", str(out)])
        assert done.exit_code == 0, done.output
        tips[name] = float(out.read_text().split('"tcp_rms_mm":')[2 if name == "have" else 1].split(",")[0])
    assert tips["have"] < tips["like"] < tips["plain"]


def test_a_lost_position_does_not_count_among_those_measured(tmp_path: Path) -> None:
    data, out = written(tmp_path / "data.csv", "two-joint", 20), tmp_path / "next.csv"
    *before, last = data.read_text().splitlines()
    columns = before[0].split(",")
    cells = ["0" if name in POSITION else cell for name, cell in zip(columns, last.split(","), strict=True)]
    data.write_text("\n".join([*before, ",".join(cells)]) + "\n")
    words = ["design", "two-joint", "--have", str(data), "-n", "2", "--repeats", "0", "--levels", "5", "-o", str(out)]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    assert [line.split(",")[0] for line in out.read_text().splitlines()[1:]] == ["21", "22"]
