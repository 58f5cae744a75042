"""A checkup with a board in the video: frames at the rests are photos, and the dataset stays as it is."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import tomli_w

pytest.importorskip("av", reason="PyAV is not installed (extra 'video')")
pytest.importorskip("cv2", reason="OpenCV is not installed (extra 'camera')")
pytest.importorskip("pyarrow", reason="pyarrow is not installed (extra 'lerobot')")

from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.measuring.camera.board_pose import BoardPose
from lrm_ident.measuring.camera.session import PhotoSet, measure, tool_poses
from lrm_ident.measuring.recordings.lerobot import read_frames
from lrm_ident.measuring.recordings.lerobot_video import rest_pictures
from lrm_math.arm.arm_file import load_arm
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from tests.ident.measuring.camera.test_camera import LENS, corners_of
from tests.support.commands import stderr_of, stdout_of
from tests.support.teleoperated_video import CAMERA as FRONT
from tests.support.teleoperated_video import FilmedStops, write_filmed
from validation.camera.rendered_photos import PhotoScene
from validation.camera.scene import BOARD, CAMERA, CameraRig, board_mount, poses_in_view, rig

pytestmark = pytest.mark.long

STOPS = 42
QUICK = FilmedStops(10, 7, 1, "mpeg4", (("qscale", "1"),), 2)
ARM = load_arm("so101")


@pytest.fixture(scope="module")
def true() -> CameraRig:
    return rig(1, {})


def film(folder: Path, true: CameraRig, stops: int) -> Path:
    """A folder with a dataset of v3, and beside it the lens."""
    poses = poses_in_view(true, stops, 1)
    write_filmed(
        folder / "mine", PhotoScene(), poses.q, true.boards(solve_equilibrium(true.model, poses)), "v3.0", QUICK
    )
    (folder / "lens.toml").write_text(tomli_w.dumps(LENS.model_dump(by_alias=True)))
    return folder


@pytest.mark.soak
@pytest.mark.slow
def test_the_video_is_measured_and_the_dataset_stays_as_it_is(true: CameraRig, tmp_path: Path) -> None:
    filmed = film(tmp_path, true, STOPS)
    dataset, data = filmed / "mine", tmp_path / "data.csv"
    before = {path: path.read_bytes() for path in dataset.rglob("*") if path.is_file()}
    given = ("--video", "front", "--lens", filmed / "lens.toml", "-o", data, "--json", tmp_path / "out.json")
    said = stdout_of("checkup", dataset, *given)
    assert f" of {STOPS} stops; the tip is known to " in said
    assert {path: path.read_bytes() for path in dataset.rglob("*") if path.is_file()} == before
    video = json.loads((tmp_path / "out.json").read_text())["video"]
    drawn, fitted = (row["rms_mm"] for row in video["errors"][:2])
    assert fitted < 0.1 * drawn
    assert video["used"] > 0.9 * STOPS
    measured = load_measurements(data, true.model.arm)
    there = poses_in_view(true, STOPS, 1).q[measured.pose - 1]
    np.testing.assert_allclose(measured.poses.q, there, atol=np.radians(0.1))


def test_both_formats_have_the_same_pictures(true: CameraRig, tmp_path: Path) -> None:
    poses = poses_in_view(true, 2, 2)
    boards, pictures = true.boards(solve_equilibrium(true.model, poses)), []
    for version in ("v2.1", "v3.0"):
        folder = write_filmed(tmp_path / version, PhotoScene(), poses.q, boards, version, QUICK)
        frames = read_frames(folder, ARM)
        rests = list(frames.rests(0.5))
        pictures.append([picture for _, picture in rest_pictures(folder, FRONT, frames, rests)])
        assert len(rests) == 2
    for number, (old, new) in enumerate(zip(*pictures, strict=True)):
        still = PhotoScene().photo(BOARD, boards[number], number)
        assert np.abs(old.astype(float) - still).mean() < 6.0
        assert np.abs(new.astype(float) - old).mean() < 6.0


def test_what_a_video_cannot_give_is_one_line(true: CameraRig, tmp_path: Path) -> None:
    filmed = film(tmp_path, true, 14)
    dataset, lens, out = filmed / "mine", filmed / "lens.toml", tmp_path / "data.csv"
    given = ("--lens", lens, "-o", out)
    assert "wrist" in (said := stderr_of("checkup", dataset, "--video", "wrist", *given))
    assert FRONT in said
    assert "give --lens" in stderr_of("checkup", dataset, "--video", "front")
    assert "go with --video" in stderr_of("checkup", dataset, *given)
    assert "0 rests of 20 s" in stderr_of("checkup", dataset, "--video", "front", *given, "--dwell", "20")
    small = LENS.model_copy(update={"width_px": 640, "height_px": 480})
    (tmp_path / "small.toml").write_text(tomli_w.dumps(small.model_dump(by_alias=True)))
    wrong = ("--lens", tmp_path / "small.toml", "-o", out)
    assert "calibrated for 640 × 480" in stderr_of("checkup", dataset, "--video", "front", *wrong)
    broken = tmp_path / "broken"
    shutil.copytree(dataset, broken)
    (video,) = (broken / "videos").rglob("*.mp4")
    video.write_bytes(b"no video")
    assert "cannot be read as a video" in stderr_of("checkup", broken, "--video", "front", *given)
    video.unlink()
    assert "the video is missing" in stderr_of("checkup", broken, "--video", "front", *given)
    info = broken / "meta" / "info.json"
    info.write_text(info.read_text().replace('"video"', '"image"'))
    assert "the dataset has no videos" in stderr_of("checkup", broken, "--video", "front", *given)
    assert not out.exists()


def test_a_board_that_is_never_seen_is_one_line(true: CameraRig, tmp_path: Path) -> None:
    poses = poses_in_view(true, 12, 3)
    behind = np.tile(np.diag([1.0, 1.0, 1.0, 1.0]), (12, 1, 1))
    behind[:, 2, 3] = -1.0
    dataset = write_filmed(tmp_path / "mine", PhotoScene(), poses.q, behind, "v3.0", QUICK)
    (tmp_path / "lens.toml").write_text(tomli_w.dumps(LENS.model_dump(by_alias=True)))
    given = ("--video", "front", "--lens", tmp_path / "lens.toml", "-o", tmp_path / "data.csv")
    said = stderr_of("checkup", dataset, *given)
    assert "the board is seen at none of the 12 rests; rest 1, episode 0 at" in said
    assert "0 of 20 corners" in said


def test_a_camera_on_the_gripper_measures_a_board_beside_the_arm() -> None:
    """The same poses with the roles changed: a board that stands where the camera stood, a camera on the tool."""
    from lrm_ident.measuring.camera.board_pose import board_pose

    mount = board_mount(ARM)
    poses = poses_in_view(CameraRig(model_of(ARM, ()), CAMERA, mount), 40, 5)
    turned = np.diag([1.0, -1.0, -1.0, 1.0])  # the camera looks out of the board's face, and the board back
    tool = tool_poses(ARM, poses)
    camera, stands = tool @ mount @ turned, CAMERA @ turned
    shift = np.eye(4)
    shift[:3, 3] = -np.array([*BOARD.size, 0.0]) / 2.0
    boards = np.linalg.inv(camera) @ stands @ shift
    rng = np.random.default_rng(1)
    found = [board_pose(corners_of(board, rng), LENS) for board in boards]
    rows = tuple(row for row, one in enumerate(found) if isinstance(one, BoardPose))
    taken = tuple(one for one in found if isinstance(one, BoardPose))
    assert len(rows) > 25
    photos = PhotoSet(rows, taken, ()).from_gripper
    seen = measure(ARM, "so101", poses, photos, LENS, Path("video"))
    off = seen.data.tcp - solve_equilibrium(model_of(ARM, ()), poses_of(seen.data.poses.q)).tcp
    assert np.linalg.norm(off, axis=1).max() < 6e-3
    sd = np.sqrt(np.einsum("nii->ni", seen.data.positions.covariance))
    assert 0.2 < (off / sd).std() < 5.0
