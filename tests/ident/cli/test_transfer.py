"""`lrm-ident transfer` and `design --installation`, from files to files, and by the API."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import lrm_ident as lrm
from lrm_math.arm.arm_file import shipped_arms
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model_file import load_covariance, load_model
from tests.support.commands import part_of_example, stderr_of, stdout_of

pytestmark = [pytest.mark.usefixtures("one_step_folds"), pytest.mark.long]


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model of the rig, with standard errors and a history."""
    folder = tmp_path_factory.mktemp("bench")
    stdout_of("fit", part_of_example(folder, 80), "-o", folder / "lab.toml")
    return folder / "lab.toml"


def test_from_the_bench_to_the_rover(bench: Path, tmp_path: Path) -> None:
    """Six designed poses of a rover whose base stands elsewhere, with another tool."""
    six, few, rover = tmp_path / "6.csv", tmp_path / "few.csv", tmp_path / "rover.toml"
    stdout_of("design", "lrm-rover", "--model", bench, "--installation", "--levels", "3", "-o", six)
    poses = lrm.load_poses(six, "lrm-rover")
    assert len(poses) == 6
    nominal = lrm.transfer(bench, "lrm-rover")
    there = {"offsets.base.x_mm": 0.012, "offsets.base.beta_rad": 0.05, "offsets.tool.z_mm": -0.006}
    truth = nominal.start.model.with_values_of([*there], [*there.values()])
    tcp = lrm.predict(truth, poses_of(poses.q)) * 1e3
    header = ",".join([*(f"q{i}_deg" for i in range(1, 7)), "x_mm", "y_mm", "z_mm"])
    np.savetxt(few, np.column_stack([np.degrees(poses.q), tcp]), "%.6f", ",", header=header, comments="")
    report = tmp_path / "report.json"
    said = stdout_of("transfer", bench, few, "--to", "lrm-rover", "-o", rover, "--json", report)
    assert "lrm-lab -> lrm-rover" in said
    told = json.loads(report.read_text("utf-8"))
    assert [*told["expected_rms_mm"]] == ["0", "3", "6", "12"]
    assert told["identified_rms_mm"] < 0.1 * told["expected_rms_mm"]["0"]
    found, known = load_model(rover), load_covariance(rover)
    assert known is not None
    assert found.arm.name == "lrm-rover"
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (50, 6))
    apart = solve_equilibrium(found, poses_of(q)).tcp - solve_equilibrium(truth, poses_of(q)).tcp
    assert np.sqrt((apart**2).sum(axis=1).mean()) * 1e3 < told["identified_rms_mm"]
    by_api = lrm.transfer(bench, "lrm-rover", lrm.load(few, "lrm-rover"))
    np.testing.assert_allclose(by_api.model.values, found.values, atol=1e-9)


def test_without_poses_it_is_mounted_as_its_file_says(bench: Path, tmp_path: Path) -> None:
    said = stdout_of("transfer", bench, "--to", "lrm-rover", "-o", tmp_path / "rover.toml")
    assert "--installation" in said
    before, after = load_model(bench), load_model(tmp_path / "rover.toml")
    assert after.value("offsets.joint2.theta_rad") == pytest.approx(before.value("offsets.joint2.theta_rad"))
    assert after.value("offsets.base.x_mm") == 0.0
    assert not after.state


def test_what_cannot_be_transferred_is_said_in_one_line(bench: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.toml"
    text = shipped_arms()["lrm-rover"].read_text("utf-8")
    other.write_text(text.replace("d_mm = 43.25", "d_mm = 53.25").replace('"lrm-rover"', '"longer"'), "utf-8")
    assert "joint 5: d is 43.25 mm in lrm-lab, 53.25 mm in longer" in stderr_of("transfer", bench, "--to", other)
    assert "--to ARM" in stderr_of("transfer", bench)
    head = bench.read_text("utf-8").partition("[covariance]")[0]
    bare = tmp_path / "bare.toml"
    bare.write_text(head.partition("[sigma]")[0], "utf-8")
    assert "no [covariance]" in stderr_of("transfer", bare, "--to", "lrm-rover")
    old = tmp_path / "old.toml"
    old.write_text(bench.read_text("utf-8").replace("effects = [", 'effects = [\n    "drift@joint2",', 1), "utf-8")
    assert "drift@joint2 explain a session" in stderr_of("transfer", old, "--to", "lrm-rover")
    words = stderr_of("design", "lrm-rover", "--model", bench, "--installation", "--parameters", "option1")
    assert "--parameters" in words
