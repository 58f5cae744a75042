"""A camera that is driven for, and one that measures: from the network's pictures, at poses that servos go to."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Self

import numpy as np
import pytest

pytest.importorskip("cv2", reason="OpenCV is not installed (extra 'camera')")

from lrm_ident.data.measurement_file.conventions import frame_table
from lrm_ident.data.measurement_file.load import load_poses
from lrm_ident.measuring.camera.camera_tracker import CameraTracker, camera_named
from lrm_ident.measuring.camera.capture import Picture, open_camera
from lrm_ident.measuring.camera.opencv import opencv
from lrm_ident.measuring.camera.session import CameraSession
from lrm_ident.measuring.campaign.data_file import ArmState
from lrm_ident.measuring.campaign.photo_poses import PhotoCampaign, PhotographedPoses
from lrm_ident.measuring.campaign.plan import PlannedPose
from lrm_ident.measuring.campaign.run import PoseTiming, Unreachable
from lrm_ident.measuring.tracker.dwell import LEAST, RestMean, rest_mean
from lrm_ident.measuring.tracker.frames import TargetNumbers
from lrm_math.arm.arm_file import load_arm
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from tests.ident.measuring.camera.test_camera import LENS
from tests.support.commands import stderr_of
from tests.support.simulated_clock import SimulatedClock
from validation.camera.rendered_photos import PhotoScene
from validation.camera.scene import BOARD, CAMERA, CameraRig, board_mount, poses_in_view

ARM = load_arm("so101")
RIG = CameraRig(model_of(ARM, ()), CAMERA, board_mount(ARM))
SESSION = CameraSession(
    schema="lrm/camera-session/1",
    arm="so101",
    lens=LENS,
    camera=frame_table(CAMERA[:3, :3], CAMERA[:3, 3]),
    mount=frame_table(RIG.mount[:3, :3], RIG.mount[:3, 3]),
)


@dataclass
class StillPhotos:
    """A camera before an arm that stands; its grain is another one in each picture."""

    pictures: list[Picture]
    taken: int = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        return None

    def photo(self) -> Picture:
        """The next picture, over and over."""
        self.taken += 1
        return self.pictures[self.taken % len(self.pictures)]


@pytest.mark.long
def test_the_tip_is_where_the_board_shows_it() -> None:
    q = poses_in_view(RIG, 1, 3)
    equilibrium = solve_equilibrium(RIG.model, q)
    board = RIG.boards(equilibrium)[0]
    camera = StillPhotos([PhotoScene().photo(BOARD, board, seed) for seed in range(LEAST + 1)])
    with CameraTracker(camera, SESSION, 1) as tracker:
        found = rest_mean(tracker.frames(0.0), TargetNumbers(1, None))
    assert isinstance(found, RestMean)
    assert found.frames == LEAST
    np.testing.assert_allclose(found.tip, equilibrium.tcp[0], atol=1.5e-3)


def test_a_board_out_of_sight_is_a_frame_without_a_target() -> None:
    camera = StillPhotos([np.full((720, 1280), 90, dtype=np.uint8)])
    (frame,) = CameraTracker(camera, SESSION, 1).frames(0.0)
    assert frame.targets == {}
    small = StillPhotos([np.full((480, 640), 90, dtype=np.uint8)])
    with pytest.raises(LrmError, match="640 × 480 pixels; its lens was calibrated for 1280 × 720"):
        CameraTracker(small, SESSION, 1).frames(0.0)


@contextmanager
def pictures_at(content: bytes) -> Iterator[str]:
    """A picture on the network."""

    class Answer(BaseHTTPRequestHandler):
        """Sends it."""

        def do_GET(self) -> None:
            """The picture."""
            self.send_response(200)
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, *_: object) -> None:
            """Says nothing."""

    with HTTPServer(("127.0.0.1", 0), Answer) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_address[1]}/photo.jpg"
        finally:
            server.shutdown()
            thread.join()


def test_pictures_of_the_network_and_what_is_none() -> None:
    picture = PhotoScene().photo(BOARD, RIG.boards(solve_equilibrium(RIG.model, poses_in_view(RIG, 1, 3)))[0], 0)
    content = bytes(opencv().imencode(".png", picture)[1])
    with pictures_at(content) as address, open_camera(address) as camera:
        np.testing.assert_array_equal(camera.photo(), picture)
    with pictures_at(b"<html>") as address, pytest.raises(LrmError, match="no still picture"):
        open_camera(address).photo()
    with pytest.raises(LrmError, match=r"camera http://127\.0\.0\.1:1/"):
        open_camera("http://127.0.0.1:1/").photo()
    with pytest.raises(LrmError, match="its number, or the address"):
        open_camera("webcam")
    with pytest.raises(LrmError, match="camera:0,DATA"):
        camera_named("0")


@dataclass
class StandingArm:
    """Goes wherever it is sent, but not to pose 2; is disturbed once at pose 3."""

    session: int = 1
    went: list[int] = field(default_factory=list)

    def go(self, pose: PlannedPose) -> ArmState:
        if pose.number == 2:
            raise Unreachable("joint 1 would leave its limits")
        self.went.append(pose.number)
        return ArmState(tuple(q + 1e-3 for q in pose.q), (1,) * ARM.dof, 30.0, 1)

    def commanded(self) -> tuple[float, ...]:
        return (0.0,) * ARM.dof

    def disturbed(self) -> str:
        return "elbow_flex was moved" if self.went == [1, 3] else ""

    def too_warm(self) -> str:
        return ""

    def cool(self, rest: PlannedPose) -> None:
        """See `CampaignArm`."""

    def change_payload(self, payload: float) -> None:
        """See `CampaignArm`."""


def test_a_photo_at_every_pose_that_can_be_reached(tmp_path: Path) -> None:
    standing, taken, said = StandingArm(), list[int](), list[str]()
    plan = [PlannedPose(n, (0.1 * n,) * ARM.dof, 0.0, (), n) for n in (1, 2, 3)]
    kept: list[PhotographedPoses] = []
    campaign = PhotoCampaign(standing, SimulatedClock(), PoseTiming(), plan[0], taken.append, kept.append, said.append)
    found = campaign.run(plan)
    assert standing.went == [1, 3, 3]
    assert taken == [1, 2, 2]  # the photo of an arm that was moved is taken again
    assert found.failed == {2: "joint 1 would leave its limits"}
    assert said == ["pose 2: no photo: joint 1 would leave its limits"]
    path = tmp_path / "poses.csv"
    path.write_text(kept[-1].csv())
    np.testing.assert_allclose(load_poses(path, ARM).q[:, 0], [0.101, 0.301], atol=1e-6)


def test_a_robot_goes_with_a_camera_and_an_empty_folder(tmp_path: Path) -> None:
    (tmp_path / "lens.toml").write_text(_toml())
    (tmp_path / "poses.csv").write_text("q1_deg,q2_deg,q3_deg,q4_deg,q5_deg\n0,0,0,0,0\n")
    given = ("--arm", "so101", "--poses", tmp_path / "poses.csv", "--lens", tmp_path / "lens.toml")
    robot = ("--robot", "feetech:/dev/none,ids=1-5", "-o", tmp_path / "data.csv")
    assert "is a folder of photos" in stderr_of("camera", "read", tmp_path, *given, *robot)
    (tmp_path / "data.photos").mkdir()
    (tmp_path / "data.photos" / "pose0001.png").touch()
    assert "has photos already" in stderr_of("camera", "read", "http://127.0.0.1:1/", *given, *robot)


def _toml() -> str:
    import tomli_w

    return tomli_w.dumps(LENS.model_dump(by_alias=True))


def test_poses_in_view_are_shown() -> None:
    assert RIG.shows(poses_in_view(RIG, 20, 5).q).all()
    assert not RIG.shows(poses_of(np.radians([[90.0, 0, 0, 0, 0]])).q).any()
