"""docs/your-arm.md: every command of it, in order, on an SO-101 with a hidden effect before a simulated camera."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from lrm_math.arm.arm_file import load_arm
from lrm_math.model.equilibrium import solve_equilibrium
from tests.conftest import ROOT
from tests.support.commands import run_command
from tests.support.page_commands import commands_of

pytest.importorskip("cv2", reason="OpenCV is not installed (extra 'camera')")

from lrm_ident.cli.groups import camera as commands
from lrm_ident.data.robot_files.urdf import read_urdf
from lrm_ident.data.robot_files.urdf_export import bare_urdf
from lrm_ident.fitting import cross_validation
from lrm_ident.measuring.camera.board import Corners
from lrm_ident.measuring.camera.board_pose import BoardPose, board_pose
from lrm_ident.measuring.camera.lens import Lens
from lrm_ident.measuring.camera.session import PhotoSet
from validation.camera.rendered_photos import WEBCAM, PhotoScene
from validation.camera.scene import HIDDEN, poses_in_view, rig, write_lens_photos, write_poses

PHOTOS, NOISE = 60, 0.1


@pytest.mark.slow
def test_every_command_of_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The photos of the arm are corners with noise; those of the lens are rendered (test_camera renders both).

    Held-out errors are one step from the fit, as of many poses: a refit of every fold is half of the time.
    """
    from xml.etree import ElementTree

    true = rig(1, HIDDEN)
    poses = poses_in_view(true, PHOTOS, 1)
    boards, rng = true.boards(solve_equilibrium(true.model, poses)), np.random.default_rng(0)

    def seen(files: Sequence[Path], lens: Lens) -> PhotoSet:
        points = [lens.board.corners @ pose[:3, :3].T + pose[:3, 3] for pose in boards]
        found = [
            board_pose(Corners(np.arange(len(p)), WEBCAM.project(p)[0] + 0.5 + rng.normal(0, NOISE, (len(p), 2))), lens)
            for p in points
        ]
        assert all(isinstance(one, BoardPose) for one in found)
        return PhotoSet(tuple(range(len(files))), tuple(one for one in found if isinstance(one, BoardPose)), ())

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(commands, "read_photos", seen)
    monkeypatch.setattr(cross_validation, "MOST_REFITTED", PHOTOS - 1)
    urdf = bare_urdf(load_arm("so101"))
    text = ElementTree.tostring(urdf.tree, encoding="unicode").replace('"tcp"', '"gripper_frame_link"')
    (tmp_path / "robot.urdf").write_text(text)
    write_lens_photos(tmp_path / "lens-photos", PhotoScene(), 9)
    write_poses(tmp_path / "poses.csv", poses)
    (tmp_path / "arm-photos").mkdir()
    for number in range(PHOTOS):
        (tmp_path / "arm-photos" / f"{number}.png").touch()
    said = {}
    for words in commands_of(ROOT / "docs" / "your-arm.md"):
        elsewhere = words[0] in ("checkup", "measure", "verify", "transfer") or words[:2] == ["design", "so101"]
        if elsewhere or "--robot" in words or "--installation" in words:
            continue  # with the servos: tests/ident/measuring/recordings, tests/examples/so101, tests/lerobot
        code, stdout, stderr = run_command(*words)
        assert code == 0, (words, stderr)
        said[" ".join(words[:2])] = stdout
    assert len(said) == 11
    assert "servo_gain@joint3" in said["diagnose model.toml"]
    assert "servo_gain@joint3" in said["arm export"]
    assert read_urdf(tmp_path / "corrected.urdf").tips == ["gripper_frame_link"]
    assert (tmp_path / "next.csv").read_text().count("\n") == 21
