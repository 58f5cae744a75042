"""The camera on rendered photos and simulated corners: poses, covariance, other boards, refusals, what does not fit."""

from __future__ import annotations

import re
import shlex
import zlib
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip("cv2", reason="OpenCV is not installed (extra 'camera')")

from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.data.observations.orientations import Orientations
from lrm_ident.data.rigid_motion import rotation_vectors
from lrm_ident.data.weights.whitening import joint_covariance
from lrm_ident.design.pose_design import DesignProblem, design
from lrm_ident.fitting.loss import SQUARED
from lrm_ident.fitting.model_fit import fit_model, nominal_model
from lrm_ident.measuring.camera.board import (
    DICTIONARIES,
    PIXELS,
    CharucoBoard,
    Corners,
    Dictionary,
    RejectedPhoto,
    board_pdf,
    detected,
    find_corners,
)
from lrm_ident.measuring.camera.board_pose import BoardPose, board_pose
from lrm_ident.measuring.camera.opencv import opencv
from lrm_ident.measuring.camera.session import (
    CameraMeasurements,
    PhotoSet,
    expected_covariance,
    expected_weights,
    measure,
    visible,
)
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.sensed import tool_rotation
from tests.support.commands import stderr_of, stdout_of
from tests.support.sweep import soak
from validation.camera.rendered_photos import WEBCAM, PhotoScene
from validation.camera.scene import BOARD, HIDDEN, poses_in_view, rig, write_arm_photos, write_lens_photos, write_poses

NOISE = 0.2  # px
LENS = WEBCAM.model_copy(update={"noise_px": NOISE})


def held(seed: int) -> Array:
    """(4, 4), a board held before the camera."""
    rng = np.random.default_rng(seed)
    out = np.eye(4)
    out[:3, :3] = Rotation.from_rotvec(rng.uniform(-0.6, 0.6, 3)).as_matrix()
    out[:3, 3] = rng.uniform([-0.12, -0.08, 0.25], [0.06, 0.03, 0.4])
    return out


def corners_of(board: Array, rng: np.random.Generator, scale: float = 1.0) -> Corners:
    points = scale * BOARD.corners @ board[:3, :3].T + board[:3, 3]
    return Corners(np.arange(len(points)), LENS.project(points)[0] + rng.normal(0, NOISE, (len(points), 2)))


def error_of(found: BoardPose, board: Array) -> Array:
    turned = Rotation.from_matrix(found.rotation @ board[:3, :3].T).as_rotvec()
    return np.concatenate([found.position - board[:3, 3], turned])


@pytest.mark.slow
def test_the_detector_finds_the_rendered_board() -> None:
    pixel_errors = []
    for seed in range(3):
        found = find_corners(PhotoScene().photo(BOARD, held(seed), seed), BOARD)
        assert isinstance(found, Corners)
        points = BOARD.corners[found.numbers] @ held(seed)[:3, :3].T + held(seed)[:3, 3]
        pixel_errors.append(found.pixels - LENS.project(points)[0])
    errors = np.concatenate(pixel_errors)
    assert errors.std(axis=0).max() < 0.1  # OpenCV's half pixel, the same everywhere, goes into the lens's centre
    assert np.abs(errors.mean(axis=0)).max() < 0.6


@pytest.mark.long
@pytest.mark.parametrize(
    ("scene", "words"),
    [
        (PhotoScene(blur=6.0), "blurred|corners seen"),
        (PhotoScene(blur=2.0), "blurred"),
        (PhotoScene(mirrored=True), "mirrored"),
        (PhotoScene(gain=0.02), "corners seen|contrast"),
    ],
)
def test_poor_photos_are_refused_with_the_reason(scene: PhotoScene, words: str) -> None:
    found = find_corners(scene.photo(BOARD, held(1), 1), BOARD)
    assert isinstance(found, RejectedPhoto)
    assert re.search(words, found.reason)


def test_a_photo_without_the_board() -> None:
    found = find_corners(np.full((200, 300), 128, dtype=np.uint8), BOARD)
    assert isinstance(found, RejectedPhoto)
    assert "0 of 20 corners" in found.reason


@pytest.mark.long
def test_covariance_of_the_pose_is_that_of_its_errors() -> None:
    rng = np.random.default_rng(0)
    squares = []
    for seed in range(60):
        found = board_pose(corners_of(held(seed), rng), LENS)
        if isinstance(found, BoardPose):
            error = error_of(found, held(seed))
            squares.append(error @ np.linalg.solve(found.covariance, error))
    assert len(squares) > 40
    assert np.mean(squares) == pytest.approx(6.0, abs=4 * np.sqrt(12.0 / len(squares)))


def test_a_small_board_far_away_has_two_poses() -> None:
    far = np.eye(4)
    far[:3, :3] = Rotation.from_rotvec([0.12, 0.0, 0.0]).as_matrix()
    far[:3, 3] = [-0.05, -0.04, 2.0]
    found = board_pose(corners_of(far, np.random.default_rng(2)), LENS)
    assert isinstance(found, RejectedPhoto)
    assert "two poses" in found.reason


def simulated(
    seed: int, scale: float = 1.0, camera: Array | None = None, mount: Array | None = None, late: int = 0
) -> CameraMeasurements:
    """60 photos as corners with noise; camera or mount moved (4, 4) from photo 31 on; all so many poses late."""
    true = rig(seed, HIDDEN)
    poses, rng = poses_in_view(true, 60, seed), np.random.default_rng(seed)
    still = np.eye(4)
    later = replace(
        true,
        camera=true.camera @ (still if camera is None else camera),
        mount=true.mount @ (still if mount is None else mount),
    )
    equilibrium = solve_equilibrium(true.model, poses)
    boards = np.concatenate([true.boards(equilibrium)[:30], later.boards(equilibrium)[30:]])
    boards = np.roll(boards, late, axis=0)
    found = [board_pose(corners_of(board, rng, scale), LENS) for board in boards]
    rows = tuple(row for row, one in enumerate(found) if isinstance(one, BoardPose))
    taken = tuple(one for one in found if isinstance(one, BoardPose))
    return measure(true.model.arm, "so101", poses, PhotoSet(rows, taken, ()), LENS, Path("photos.csv"))


def moved(shift: list[float], turn: list[float]) -> Array:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = Rotation.from_rotvec(turn).as_matrix(), shift
    return out


@pytest.mark.slow
def test_the_tip_is_known_and_the_residual_is_the_noise() -> None:
    true = rig(2, {})
    found = simulated(2)
    fitted = fit_model(nominal_model(true.model.arm), found.data, "identifiable", SQUARED).fit
    assert fitted.sigma > 3 * found.data.whitening.unit  # the hidden gain is not in the model
    assert visible(found.session, true.model.arm, found.data.poses).mean() > 0.9


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"scale": 1.05}, r"squares of 15\.[6-9]"),
        ({"scale": 0.95}, r"squares of 14\.[1-4]"),
        ({"camera": moved([0.004, 0.0, 0.002], [0.0, 0.01, 0.0])}, "camera moved between photos 3[0-2] "),
        ({"camera": moved([0.02, 0.0, 0.0], [0.0, 0.0, 0.6])}, "camera moved between photos 3[0-2] "),
        ({"late": 1}, r"do not fit the poses \(median .*is every photo at the row of its pose"),
        ({"late": -1}, r"do not fit the poses \(median .*is every photo at the row of its pose"),
        ({"mount": moved([0.002, 0.001, 0.0], [0.0, 0.0, 0.02])}, "board slipped on the tool between photos 3[0-2]"),
    ],
)
def test_what_does_not_belong_together_is_said(change: dict[str, object], words: str) -> None:
    with pytest.raises(LrmError, match=words):
        simulated(1, **change)  # type: ignore[arg-type]


@pytest.mark.slow
def test_design_weighs_poses_as_the_camera_measures_them() -> None:
    """Candidates show the board; those chosen with the camera's covariance make the tip better known."""
    found = simulated(2)
    arm = load_arm("so101")
    covariance = expected_covariance(found.session, arm, found.data.poses)
    stated = joint_covariance(found.data.observations)
    ratio = np.trace(covariance, axis1=1, axis2=2) / np.trace(stated, axis1=1, axis2=2)
    assert np.abs(np.log(ratio)).mean() < 0.5
    model = nominal_model(arm)
    task = DesignProblem(model, None, (), 34, "O1", 1e-3, None, 0, 1, 0, partial(expected_weights, found.session, arm))
    some = poses_in_view(rig(2, {}), 120, 7)
    chosen = design(task, some)
    assert chosen.after.tcp < chosen.random_after.tcp


def test_the_page_is_at_true_scale() -> None:
    page = board_pdf(BOARD, "a4")
    assert page.startswith(b"%PDF-1.4")
    unit = float(re.search(rb"([\d.]+) 0 0 [\d.]+ 0 0 cm", page)[1])  # type: ignore[index]
    assert unit == pytest.approx(72.0 / 25.4, abs=1e-5)
    assert b"q 90.0000 0 0 75.0000 " in page
    stream = page.split(b"/FlateDecode")[1].split(b"stream\n", 1)[1]
    bits = np.unpackbits(np.frombuffer(zlib.decompress(stream), dtype=np.uint8)).reshape(PIXELS * 5, PIXELS * 6)
    np.testing.assert_array_equal(bits * 255, BOARD.picture)
    places = [int(place) for place in re.findall(rb"(\d{10}) 00000 n", page)]
    assert all(page[place:].startswith(f"{number} 0 obj".encode()) for number, place in enumerate(places, start=1))


@pytest.mark.slow
def test_commands_from_photos_to_data(tmp_path: Path) -> None:
    scene, true = PhotoScene(), rig(1, {})
    write_lens_photos(tmp_path / "lens", scene, 9)
    poses = poses_in_view(true, 11, 1)
    write_poses(tmp_path / "poses.csv", poses)
    write_arm_photos(tmp_path / "arm", scene, true.boards(solve_equilibrium(true.model, poses)))
    opencv().imwrite(str(tmp_path / "arm" / "pose3.png"), np.full((720, 1280), 90, dtype=np.uint8))
    assert "written to" in stdout_of("camera", "board", "-o", tmp_path / "board.pdf")
    lens, data = tmp_path / "lens.toml", tmp_path / "data.csv"
    assert "of 9 photos used" in stdout_of("camera", "calibrate", tmp_path / "lens", "-o", lens)
    given = ("--arm", "so101", "--poses", tmp_path / "poses.csv", "--lens", lens, "-o", data)
    said = stdout_of("camera", "read", tmp_path / "arm", *given)
    assert "10 of 11 photos used" in said
    assert "pose3.png: 0 of 20 corners" in said
    measured = load_measurements(data, true.model.arm)
    assert measured.whitening.rows(5) == 6
    # the orientation of the tool is in the file: apart from the rig's hidden errors it is the nominal arm's
    turned = tool_rotation(solve_equilibrium(nominal_model(true.model.arm), measured.poses))
    (seen,) = measured.of(Orientations)
    off = rotation_vectors(np.asarray(turned).transpose(0, 2, 1) @ seen.values)
    assert np.degrees(np.linalg.norm(off - off.mean(axis=0), axis=1)).max() < 2.0
    assert np.degrees(np.linalg.norm(rotation_vectors(turned[0].T @ np.asarray(turned)), axis=1)).max() > 20.0
    assert (
        np.linalg.norm(
            measured.tcp - solve_equilibrium(nominal_model(true.model.arm), measured.poses).tcp, axis=1
        ).max()
        < 0.06
    )
    (tmp_path / "arm" / "pose11.png").unlink()
    assert "10 photos for 11 poses" in stderr_of(
        "camera", "read", tmp_path / "arm", *given[:-1], tmp_path / "other.csv"
    )
    assert not (tmp_path / "other.csv").exists()


BOARDS = {
    "--legacy": CharucoBoard(rows=4, legacy=True),
    "--dictionary 5X5_50": CharucoBoard(rows=4, dictionary="5X5_50"),
    "--columns 4 --rows 6": CharucoBoard(columns=4, rows=6),
    "--dictionary APRILTAG_36h11 --columns 4 --rows 6": CharucoBoard(columns=4, rows=6, dictionary="APRILTAG_36h11"),
    "--dictionary 6X6_50 --legacy": CharucoBoard(rows=4, dictionary="6X6_50", legacy=True),
}
"""By the options that read each of them beside `--columns 6 --rows 4`."""


def photo(folder: Path, board: CharucoBoard) -> Path:
    """A folder with a photo of a board, a little askew."""
    folder.mkdir()
    pose = np.eye(4)
    pose[:3, :3] = opencv().Rodrigues(np.array([0.2, -0.25, 0.1]))[0]
    pose[:3, 3] = -0.045, -0.035, 0.17
    opencv().imwrite(str(folder / "p.png"), PhotoScene().photo(board, pose, 0))
    return folder


@pytest.mark.long
@pytest.mark.parametrize("options", [*list(BOARDS)[:2], *soak(*list(BOARDS)[2:])])
def test_another_board_is_named_with_the_options_that_read_it(tmp_path: Path, options: str) -> None:
    folder, out = photo(tmp_path / "photos", BOARDS[options]), tmp_path / "lens.toml"
    words = ["camera", "calibrate", folder, "--columns", "6", "--rows", "4", "-o", out]
    said = stderr_of(*words)
    assert f"give {options}" in said
    assert "1 usable photos" in stderr_of(*words, *shlex.split(options))


@pytest.mark.long
def test_a_board_of_todays_pattern_is_named_where_the_older_one_was_stated(tmp_path: Path) -> None:
    folder = photo(tmp_path / "photos", CharucoBoard(rows=4))
    words = ["camera", "calibrate", folder, "--columns", "6", "--rows", "4", "-o", tmp_path / "lens.toml"]
    assert "give --no-legacy" in stderr_of(*words, "--legacy")
    assert "1 usable photos" in stderr_of(*words, "--no-legacy")


def test_a_photo_without_any_board_names_none(tmp_path: Path) -> None:
    (tmp_path / "photos").mkdir()
    opencv().imwrite(str(tmp_path / "photos" / "p.png"), np.full((200, 300), 120, dtype=np.uint8))
    said = stderr_of("camera", "calibrate", tmp_path / "photos", "-o", tmp_path / "lens.toml")
    assert "0 of 20 corners seen, 8 are needed" in said


@pytest.mark.parametrize("dictionary", DICTIONARIES)
def test_a_printed_board_of_any_dictionary_is_its_own(dictionary: Dictionary) -> None:
    board = CharucoBoard(dictionary=dictionary)
    assert board_pdf(board, "a4").startswith(b"%PDF")
    grey = np.pad(np.kron(board.picture, np.ones((3, 3))), 40, constant_values=255).astype(np.uint8)
    assert len(detected(grey, board).numbers) == 20


def test_a_dictionary_that_is_none_and_one_that_is_too_small(tmp_path: Path) -> None:
    words = ("camera", "board", "-o", tmp_path / "b.pdf", "--dictionary")
    assert "unknown dictionary '4X4_51'" in stderr_of(*words, "4X4_51")
    said = stderr_of(*words, "APRILTAG_16h5", "--columns", "12", "--rows", "8", "--square-mm", "10")
    assert "need 48 markers; APRILTAG_16h5 has 30" in said
