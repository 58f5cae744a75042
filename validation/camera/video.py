"""60 rests of a teleoperated dataset's video beside 60 stills of the same poses: `python -m validation.camera.video`.

AV1 as LeRobot records it. Printed is how well the tip is known at poses that were never seen, fitted and with what is
named.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from lrm_ident.data.measurement_file.write import measurements_csv
from lrm_ident.measuring.camera.board import RejectedPhoto, find_corners, read_picture
from lrm_ident.measuring.camera.capture import photos_in
from lrm_ident.measuring.camera.lens import Lens, calibrate_lens
from lrm_ident.measuring.camera.session import CameraMeasurements, measure, read_photos
from lrm_ident.measuring.recordings.lerobot import read_frames
from lrm_ident.measuring.recordings.lerobot_video import measure_video
from lrm_ident.study.api import add, diagnose, fit, load
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import solve_equilibrium
from validation.camera.rendered_photos import PhotoScene
from validation.camera.scene import (
    BOARD,
    HIDDEN,
    CameraRig,
    poses_in_view,
    rig,
    tip_error,
    write_arm_photos,
    write_lens_photos,
)
from validation.camera.teleoperated_video import CAMERA, FilmedStops, write_filmed

COUNT, DWELL_S = 60, 0.5


def main() -> None:
    """Prints the figures of one arm."""
    with tempfile.TemporaryDirectory() as name:
        folder, scene, true = Path(name), PhotoScene(), rig(1, HIDDEN)
        write_lens_photos(folder / "lens", scene, 20)
        corners = [find_corners(read_picture(path), BOARD) for path in photos_in(folder / "lens")]
        lens = calibrate_lens([one for one in corners if not isinstance(one, RejectedPhoto)], BOARD, scene.lens.size)
        poses, fresh = poses_in_view(true, COUNT, 1), poses_in_view(true, 100, 51)
        boards = true.boards(solve_equilibrium(true.model, poses))
        say("stills", true, stills(folder, true, poses, boards, lens), fresh)
        dataset = write_filmed(folder / "dataset", scene, poses.q, boards, "v3.0", FilmedStops())
        frames = read_frames(dataset, true.model.arm)
        arm = true.model.arm
        found = measure_video(dataset, CAMERA, frames, DWELL_S, arm, "so101", lens, False, lambda *_: None)
        say("video", true, found, fresh)


def stills(folder: Path, true: CameraRig, poses: Poses, boards: np.ndarray, lens: Lens) -> CameraMeasurements:
    """Measurements from stills at commanded poses."""
    write_arm_photos(folder / "arm", PhotoScene(), boards)
    seen = read_photos(photos_in(folder / "arm"), lens)
    return measure(true.model.arm, "so101", poses, seen, lens, folder / "stills.csv")


def say(what: str, true: CameraRig, found: CameraMeasurements, fresh: Poses) -> None:
    """A line: what is named, and the tip's error before and after."""
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "data.csv"
        path.write_text(measurements_csv(found.data))
        data = load(path, arm="so101")
        before = fit(data)
        named = diagnose(before.model, data).first
        tips = [tip_error(true, before.model, found.session, fresh)]
        if named is not None:
            tips.append(tip_error(true, add(before.model, data, named.scored.name).model, found.session, fresh))
    words = "nothing" if named is None else named.scored.name
    figures = " then ".join(f"{1e3 * tip:.2f}" for tip in tips)
    print(f"{what}: {len(found.data)} of {COUNT} used, named {words}; tip known to {figures} mm", flush=True)


if __name__ == "__main__":
    main()
