"""A dataset's video as photos: the board's pose at each rest, the joints where their encoders say that they are."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from lrm_ident.measuring.camera.board import CharucoBoard
from lrm_ident.measuring.camera.capture import Picture
from lrm_ident.measuring.camera.lens import Lens, LensFile
from lrm_ident.measuring.camera.session import CameraMeasurements, measure, read_pictures
from lrm_ident.measuring.recordings.encoder_checkup import elapsed, last_sides
from lrm_ident.measuring.recordings.lerobot import LeRobotFrames
from lrm_ident.measuring.recordings.lerobot_video import camera_named, rest_pictures
from lrm_math.arm.arm import Arm
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import Poses


def measure_video(
    dataset: Path,
    camera: str,
    frames: LeRobotFrames,
    dwell: float,
    arm: Arm,
    arm_name: str,
    lens: LensFile,
    on_gripper: bool,
    progress: Callable[[int, int], object],
) -> CameraMeasurements:
    """Measurements from the rests of a video; with the camera `on_gripper`, of a board that stands beside the arm.

    Raises `LrmError`: no such video, no rests, a board that is never seen, or pictures that do not belong together.
    """
    name, rests = camera_named(dataset, camera), list(frames.rests(dwell))
    if not rests:
        raise LrmError(f"{dataset}: the arm never rests for {dwell:g} s; stop for a moment now and then")

    def pictures() -> Iterator[tuple[str, Picture]]:
        """Each with its name."""
        for number, one in enumerate(rest_pictures(dataset, name, frames, rests), start=1):
            yield one.name, one.picture
            progress(number, len(rests))

    seen = read_pictures(pictures(), Lens.of(lens), CharucoBoard(lens.board))
    if not seen.rows:
        where, why = seen.refused[0]
        raise LrmError(f"{name}: the board is seen at none of the {len(rests)} rests; {where}: {why}")
    last = np.array([rows[-1] for rows in rests])
    poses = Poses(
        q=np.array([frames.feedback[rows].mean(axis=0) for rows in rests]),
        payload=np.zeros(len(rests)),
        direction=last_sides(frames)[last],
        t=elapsed(frames)[last],
        number=np.arange(1, len(rests) + 1),
    )
    photos = seen.from_gripper if on_gripper else seen
    return replace(measure(arm, arm_name, poses, photos, lens, dataset), photos=photos)
