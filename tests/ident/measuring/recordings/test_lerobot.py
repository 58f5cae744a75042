"""LeRobot: rests of a v3 dataset with joint feedback, and the action step that commands a calibrated arm."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from lrm_ident.data.measurement_file.load import load_poses
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import equilibrium
from lrm_math.model.model import model_of
from tests.conftest import ROOT
from tests.support.commands import stderr_of, stdout_of

sys.path.insert(0, str(ROOT / "lerobot_processor_lrm" / "src"))

from lerobot_processor_lrm import Compensation

FPS, REST_S, MOVE_S = 30, 2.0, 1.0


@pytest.fixture(scope="module")
def so101() -> Arm:
    return load_arm("so101")


def written(folder: Path, arm: Arm, poses: Array, droop_deg: Array) -> Path:
    """Two episodes in which the arm rests at every pose (R, n) in deg, its servos `droop_deg` (R, n) off."""
    pyarrow = pytest.importorskip("pyarrow", reason="pyarrow is not installed (extra 'lerobot')")
    parquet = pytest.importorskip("pyarrow.parquet")
    rng = np.random.default_rng(0)
    names = [*(f"{joint.name}.pos" for joint in arm.joints), "gripper.pos"]
    rows: list[dict[str, object]] = []
    for episode, half in enumerate(np.array_split(np.arange(len(poses)), 2)):
        frame = 0
        for before, pose in zip([half[0], *half[:-1]], half, strict=True):
            for step in range(int(FPS * MOVE_S)):
                share = (step + 1) / (FPS * MOVE_S)
                q = poses[before] + share * (poses[pose] - poses[before])
                rows.append(row_of(q, q + droop_deg[pose], frame, episode))
                frame += 1
            for _ in range(int(FPS * REST_S)):
                read = poses[pose] + droop_deg[pose] + rng.normal(0, 0.05, poses.shape[1])
                rows.append(row_of(poses[pose], read, frame, episode))
                frame += 1
    (folder / "meta").mkdir(parents=True)
    features = {name: {"dtype": "float32", "shape": [6], "names": names} for name in ("action", "observation.state")}
    info = {"codebase_version": "v3.0", "fps": FPS, "robot_type": "so101_follower", "features": features}
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    (folder / "data" / "chunk-000").mkdir(parents=True)
    half = len(rows) // 2
    for number, part in enumerate((rows[:half], rows[half:])):
        table = pyarrow.Table.from_pylist(part)
        parquet.write_table(table, folder / "data" / "chunk-000" / f"file-{number:03d}.parquet")
    return folder


def row_of(command: Array, read: Array, frame: int, episode: int) -> dict[str, object]:
    return {
        "action": [*command.tolist(), 10.0],
        "observation.state": [*read.tolist(), 11.0],
        "timestamp": frame / FPS,
        "episode_index": episode,
    }


def test_rests_are_found_with_their_feedback(so101: Arm, tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    poses, droop = rng.uniform(-60, 60, (12, 5)), rng.normal(0, 1.0, (12, 5))
    folder = written(tmp_path / "dataset", so101, poses, droop)
    out = tmp_path / "poses.csv"
    said = stdout_of("import", "lerobot", folder, "--arm", "so101", "-o", out)
    assert "12 rests of 2 episodes" in said
    read = load_poses(out, so101)
    np.testing.assert_allclose(np.degrees(read.q), poses, atol=0.02)
    assert read.session is not None
    table = np.genfromtxt(out, delimiter=",", names=True)
    feedback = np.stack([table[f"q{i}_meas_deg"] for i in range(1, 6)], axis=1)
    np.testing.assert_allclose(feedback, poses + droop, atol=0.05)
    assert "feedback_sd_deg = 0.0" in out.with_suffix(".toml").read_text()


def test_what_is_no_such_dataset(so101: Arm, tmp_path: Path) -> None:
    folder = written(tmp_path / "dataset", so101, np.zeros((2, 5)), np.zeros((2, 5)))
    out = tmp_path / "poses.csv"
    assert "no joint 'joint1'" in stderr_of("import", "lerobot", folder, "--arm", "ur5", "-o", out)
    assert "never rests for 60 s" in stderr_of("import", "lerobot", folder, "--dwell", "60", "-o", out)
    info = folder / "meta" / "info.json"
    info.write_text(info.read_text().replace("v3.0", "v2.1"))
    assert "v2.1; v3.0" in stderr_of("import", "lerobot", folder, "-o", out)
    assert "no such file" in stderr_of("import", "lerobot", tmp_path / "none", "-o", out)
    assert not out.exists()


def calibrated(arm: Arm) -> Compensation:
    effects = [effect for name in ("offsets", "compliance") for effect in effects_at(arm, name)]
    values = {"offsets.joint2.theta_rad": 0.03, "offsets.joint3.a_mm": 0.002, "compliance.joint2.k_rad_per_Nm": 0.05}
    return Compensation(model_of(arm, effects, values))


def test_the_tip_arrives_where_that_of_the_arm_as_drawn_would(so101: Arm) -> None:
    step, drawn = calibrated(so101), model_of(so101, ())
    for q in np.random.default_rng(0).uniform(-0.9, 0.9, (20, 5)):
        command = step.command(q)
        goal = equilibrium(drawn, poses_of(q)).tcp
        before = np.linalg.norm(equilibrium(step.model, poses_of(q)).tcp - goal)
        after = np.linalg.norm(equilibrium(step.model, poses_of(command)).tcp - goal)
        assert before > 2e-3
        assert after < 2e-5
        assert np.abs(command - q).max() < 0.2


def test_limits_hold(so101: Arm) -> None:
    step = calibrated(so101)
    limits = np.array([(joint.lower, joint.upper) for joint in so101.joints])
    for side in (0, 1):
        command = step.command(limits[:, side] * 1.2)
        assert (command >= limits[:, 0]).all()
        assert (command <= limits[:, 1]).all()


def test_the_registered_step_in_a_real_pipeline(so101: Arm, tmp_path: Path) -> None:
    pytest.importorskip("lerobot", reason="LeRobot is not installed (it needs torch, and Python 3.12 from 0.5 on)")
    from lerobot.processor import ProcessorStepRegistry, TransitionKey

    from lerobot_processor_lrm import CalibratedActionStep

    path = tmp_path / "model.toml"
    path.write_text(
        'schema = "lrm/model/1"\narm = "so101"\neffects = ["offsets", "compliance"]\n'
        '[parameters]\n"offsets.joint2.theta_rad" = 0.03\n"compliance.joint2.k_rad_per_Nm" = 0.05\n'
    )
    assert ProcessorStepRegistry.get("lrm_calibrated_action") is CalibratedActionStep
    step = CalibratedActionStep(model=str(path))
    action = {f"{joint.name}.pos": 10.0 for joint in so101.joints} | {"gripper.pos": 42.0}
    out = step({TransitionKey.ACTION: action})[TransitionKey.ACTION]
    expected = Compensation.of_file(path).command(np.radians([10.0] * 5))
    np.testing.assert_allclose([out[f"{joint.name}.pos"] for joint in so101.joints], np.degrees(expected), atol=1e-9)
    assert out["gripper.pos"] == 42.0
    assert CalibratedActionStep(**step.get_config()).model == str(path)
    with pytest.raises(ValueError, match="has no 'elbow_flex"):
        step({TransitionKey.ACTION: {key: value for key, value in action.items() if "elbow" not in key}})
