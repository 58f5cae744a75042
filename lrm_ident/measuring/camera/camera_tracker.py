"""A camera whose place is known as a tracker: the tip in the arm's frame, from the board on the gripper."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Self

import numpy as np

from lrm_ident.data.rigid_motion import inverse
from lrm_ident.measuring.camera.board import RejectedPhoto
from lrm_ident.measuring.camera.board_pose import find_board
from lrm_ident.measuring.camera.capture import PhotoSource, Picture, open_camera
from lrm_ident.measuring.camera.session import CameraSession
from lrm_ident.measuring.tracker.dwell import LEAST
from lrm_ident.measuring.tracker.frames import TargetPose, TrackerFrame
from lrm_math.errors import LrmError
from lrm_math.toml_file import read_toml


class CameraTracker:
    """Photos of the board as frames of the target `tool`; a photo that is of no use has none. See `Tracker`."""

    def __init__(self, camera: PhotoSource, session: CameraSession, tool: int) -> None:
        self._camera, self._tool, self._number = camera, tool, 0
        self._lens = session.lens
        self._place, mount = session.motions
        self._from_board = inverse(mount)

    def __enter__(self) -> Self:
        self._camera.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self._camera.__exit__(None, None, None)

    def frames(self, seconds: float) -> list[TrackerFrame]:
        """See `Tracker`. While the board is seen, as many as a mean needs, however long a slow camera takes to them."""
        end, frames_read = time.monotonic() + seconds, list[TrackerFrame]()
        while time.monotonic() < end or not frames_read or (frames_read[-1].targets and len(frames_read) < LEAST):
            t = time.monotonic()
            self._number += 1
            frames_read.append(TrackerFrame(self._number, t, self._seen(self._camera.photo())))
        return frames_read

    def _seen(self, picture: Picture) -> dict[int, TargetPose]:
        pose = find_board("the camera", picture, self._lens)
        if isinstance(pose, RejectedPhoto):
            return {}
        tool = self._place @ pose.matrix @ self._from_board
        return {self._tool: TargetPose(np.asarray(tool[:3, 3]), np.asarray(tool[:3, :3]))}


def camera_named(text: str) -> Callable[[int], CameraTracker]:
    """What opens the tracker of `CAMERA,SESSION` for a target's number.

    CAMERA: as `open_camera` has it, SESSION: a file of `camera read`. Raises `LrmError`.
    """
    camera, _, session = text.rpartition(",")
    if not camera:
        raise LrmError(f"--tracker camera:{text}: should be camera:0,DATA.camera.toml, a file of camera read")
    seen = read_toml(Path(session), CameraSession)
    return lambda tool: CameraTracker(open_camera(camera), seen, tool)
