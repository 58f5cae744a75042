"""The parts of `make demo ARM=so101`: what its camera sees, the goals that it chooses, its last screen."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("cv2", reason="OpenCV is not installed (extra 'camera')")

from examples.demo.conclusion import DemoTruth, conclude
from examples.demo.steps import NamedEffect
from examples.so101 import camera
from examples.so101.camera import ARM, DRAWN, jpeg, poses_for_photos
from examples.so101.demo import HIDDEN as SHOWN
from examples.so101.demo import camera_noise_mm, goals_in_view, main, table
from examples.so101.hidden_arm import ARM_FILE, HIDDEN, NAMED, SIMPLER, HiddenSo101, hidden_truth
from examples.so101.true_tool import tools_after
from lrm_ident.data.measurement_file.load import load_poses
from lrm_ident.measuring.camera.board import Corners, find_corners
from lrm_ident.measuring.camera.opencv import opencv
from lrm_ident.measuring.camera.session import tool_poses
from lrm_math.effects import ALL_EFFECTS
from lrm_math.kinematics.poses import poses_of
from validation.camera.rendered_photos import WEBCAM
from validation.camera.scene import BOARD
from validation.synthetic import GroundTruth, load_arm


def test_the_true_tool_is_the_drawn_one_where_nothing_is_hidden() -> None:
    q, arm = np.random.default_rng(0).uniform(-1.0, 1.0, (5, ARM.dof)), load_arm(ARM_FILE)
    np.testing.assert_allclose(tools_after(arm, GroundTruth.nominal(arm), q), tool_poses(ARM, poses_of(q)), atol=1e-9)


@pytest.mark.long
def test_the_camera_shows_where_the_tool_truly_is() -> None:
    arm = HiddenSo101(hidden_truth(load_arm(ARM_FILE), "friction", 1))
    angles = poses_for_photos(2, 1)[1]
    for servo, angle in zip(arm.servos, angles, strict=False):
        servo.angle = float(angle)
    np.testing.assert_allclose(arm.tool()[:3, 3], arm.tip(), atol=1e-9)
    picture = opencv().imdecode(np.frombuffer(jpeg(arm.tool(), 3), dtype=np.uint8), 0)
    found = find_corners(picture, BOARD)
    assert isinstance(found, Corners)
    seen = np.linalg.inv(DRAWN.camera) @ arm.tool() @ DRAWN.mount
    corners = BOARD.corners[found.numbers] @ seen[:3, :3].T + seen[:3, 3]
    off = found.pixels - WEBCAM.project(corners)[0]
    assert np.abs(off - off.mean(axis=0)).max() < 0.5


@pytest.mark.long
def test_the_camera_sees_the_poses_and_the_goals() -> None:
    poses = poses_for_photos(20, 4)
    assert DRAWN.shows(poses).all()
    assert np.degrees(np.abs(poses[1::2] - poses[::2])).max() < 12.1
    goals = goals_in_view(poses, 3, 4)
    assert goals.shape == (3, 3)
    assert table("xyz", 1e3 * goals).splitlines()[0] == "x_mm,y_mm,z_mm"
    assert table("q{}_deg", poses).splitlines()[0] == "pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg"


def test_the_last_screen_names_the_truth_beside_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    results = {
        name: {
            "error": {"mean_mm": mm, "rms_mm": mm, "max_mm": mm}, "rounding_rms_mm": 0.2, "model_sha256": "",
            "goals": [{"measured_sd_mm": 0.1}],
        }
        for name, mm in (("none, the arm as drawn", 9.0), ("fitted", 3.0), ("with the effect", 0.5))
    }  # fmt: skip
    noise = camera_noise_mm(results.values())
    assert noise == pytest.approx(0.1 * np.sqrt(3.0))
    truth = DemoTruth(2, *NAMED["friction"], SIMPLER["friction"])
    for name, words, right in (
        ("friction_curve@joint2", "right", True),
        ("hysteresis@joint2", "the same cause in a simpler form", False),
        ("backlash@joint2", "NOT what was hidden", False),
    ):
        conclude(
            tmp_path, truth, NamedEffect("effect_missing", name, (), 0.1), results, "corrected by", noise, 1.0, "all"
        )
        assert f"{name}: {words}." in capsys.readouterr().out
        found = json.loads((tmp_path / "demo.json").read_text())
        assert found["right"] is right
        assert list(found["rms_mm"].values()) == [9.0, 3.0, 0.5]


def test_every_hidden_effect_has_a_name_of_the_catalogue() -> None:
    assert set(NAMED) == set(HIDDEN)
    assert set(SHOWN) <= set(HIDDEN)
    assert {name.partition("@")[0] for name, _ in NAMED.values()} <= {effect.id for effect in ALL_EFFECTS}


def test_a_folder_that_cannot_be_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("")
    assert main(["--out", str(tmp_path / "file" / "out"), "--seed", "1"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_a_typed_camera_leaves_photos_for_lens_and_poses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(camera, "LENS_PHOTOS", 1)
    monkeypatch.setattr(camera, "POSES", 2)
    camera.write_files(tmp_path)
    assert [path.name for path in (tmp_path / "lens-photos").iterdir()] == ["lens0.png"]
    assert DRAWN.shows(load_poses(tmp_path / "poses.csv", ARM).q).all()
