"""`lrm-ident checkup`: what ails a teleoperated arm, by its encoders alone, and by a board in its video."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from lrm_ident.cli import arguments as arg
from lrm_ident.cli.command import command
from lrm_ident.cli.common import progress, publish
from lrm_math.arm.arm_file import load_arm
from lrm_math.errors import LrmError
from lrm_math.toml_file import read_toml


@command
def checkup(
    dataset: Annotated[Path, Argument(metavar="DATASET", help="Folder of a LeRobot dataset, v2.1 or v3, in degrees.")],
    arm: Annotated[str, Option("--arm", metavar="ARM", help="A shipped arm or an arm file.")] = "so101",
    dwell: Annotated[float, Option(min=0.2, help="Seconds that a rest lasts at least.")] = 0.5,
    video: Annotated[
        str | None,
        Option(metavar="CAMERA", help="Camera of the dataset that sees the board: observation.images.front, or front."),
    ] = None,
    lens: Annotated[
        Path | None, Option(metavar="LENS", help="That camera's lens, written by camera calibrate.")
    ] = None,
    on_gripper: Annotated[
        bool, Option("--on-gripper", help="That camera is on the gripper; the board stands beside the arm.")
    ] = False,
    output: Annotated[
        Path | None,
        Option("-o", "--output", metavar="DATA", help="Where to write the measurements of the video (.csv)."),
        arg.CompanionFiles({".toml": "metadata"}),
    ] = None,
    json: arg.JsonFile = None,
) -> None:
    """Name what a recording of teleoperation tells of an arm: sag, dead band, leader offset, drift, a slip.

    It looks at rests, where command (action) and encoder (observation.state) should agree, and finds what their
    difference follows. Two minutes with a stop now and then are enough. The dataset is not changed.

    With a board in the video (--video, --lens, -o; extras: camera, video) the frames of the rests are photos: where the
    tip truly was, what the arm's parts and springs explain of it, and what is missing.
    """
    from lrm_ident.cli.groups.checkup_report import checkup_document, studied, with_video
    from lrm_ident.measuring.recordings.encoder_checkup import checkup as check
    from lrm_ident.measuring.recordings.lerobot import read_frames

    if video is None and (lens is not None or output is not None or on_gripper):
        raise LrmError("--lens, --on-gripper and -o go with --video")
    if video is not None and (lens is None or output is None):
        raise LrmError(f"--video {video}: give --lens (camera calibrate) and -o, where its measurements go")
    the_arm = load_arm(arm)
    frames = read_frames(dataset, the_arm)
    document = checkup_document(check(frames, the_arm, dwell), the_arm, dataset.name)
    if video is None or lens is None or output is None:
        publish(document, json)
        return
    from lrm_ident.data.measurement_file.write import measurements_csv, write_with_metadata
    from lrm_ident.measuring.camera.lens import LensFile
    from lrm_ident.measuring.recordings.lerobot_video import measure_video
    from lrm_ident.study.api import load

    with progress("looking at the rests") as tick:
        photos = measure_video(dataset, video, frames, dwell, the_arm, arm, read_toml(lens, LensFile), on_gripper, tick)
    write_with_metadata(output, measurements_csv(photos.data), arm, f"video, {dataset.name}", frame="arm")
    publish(with_video(document, photos, studied(load(output, arm)), output), json)
