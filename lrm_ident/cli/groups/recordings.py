"""`lrm-ident import`, `checkup`: what a tracker's recording and a LeRobot dataset tell of an arm."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
from typer import Argument, Exit, Option

from lrm_ident.cli import arguments as arg
from lrm_ident.cli.arm_access import SO101
from lrm_ident.cli.command import command, stated_reading
from lrm_ident.cli.common import notice, one_of, progress, publish, read_measurements, show
from lrm_ident.data.atomic_write import write_text
from lrm_ident.data.measurement_file.write import write_with_metadata
from lrm_ident.data.wording import joint_labels
from lrm_ident.measuring.recordings.readers import FORMATS
from lrm_math.arm.arm_file import load_arm
from lrm_math.errors import LrmError
from lrm_math.model.reading import AngleUnit
from lrm_math.toml_file import read_toml

LEROBOT = "lerobot"
Prefix = Annotated[
    str | None,
    Option(metavar="WORD", help="Prefix of the joint names, such as left_, if a LeRobot dataset has two arms."),
]


@command
def import_(
    recording: Annotated[
        Path,
        Argument(
            metavar="RECORDING",
            help=f"A tracker's recording: {FORMATS}. Or a .mat of positions.",
        ),
    ],
    poses: Annotated[
        Path,
        Argument(
            metavar="POSES",
            help="The commanded poses: a CSV as for measure, a log of the joints, .mat, .txt, or .mcap.",
        ),
    ],
    output: Annotated[
        Path,
        Option(
            "-o", "--output", metavar="DATA", help="Where to write the measurements; a .toml file goes beside them."
        ),
        arg.CompanionFiles({".toml": "metadata"}),
    ],
    arm: arg.ArmName = None,
    tool: Annotated[str | None, Option(help="Name of the body at the tip; not needed if there is only one.")] = None,
    base: Annotated[str | None, Option(help="Name of the body at the base. Default: the room's frame.")] = None,
    every: Annotated[
        float | None, Option(min=0.1, help="Seconds from the end of one stop to the end of the next.")
    ] = None,
    first: Annotated[
        float | None, Option(min=0, help="End of the first stop, in seconds from the first frame.")
    ] = None,
    skip: Annotated[int, Option(min=0, help="How many stops come before the first pose; they are left out.")] = 0,
    dwell: arg.Dwell = 1.0,
    axes: Annotated[str | None, Option(help="Which axes of the file are the arm's x, y, z: x,-z,y.")] = None,
    rotation: Annotated[str | None, Option(help="Meaning of Vicon's RX, RY, RZ: helical or euler-xyz.")] = None,
    angle_unit: Annotated[
        str | None, Option(help="Unit of the joint angles: deg or rad. Default: as the names of the columns state.")
    ] = None,
    orientation: Annotated[
        bool, Option("--orientation", help="Also write the tool's orientation, and its spread, for fit to use.")
    ] = False,
    prefix: Prefix = None,
) -> None:
    """Convert a tracker's or robot's recording to measurements: one row per pose, the mean over the end of its stop.

    A stop is where the tip stands still for twice --dwell, or at regular times (--every, --first). A stop in which a
    body is hidden, frozen or jumps is left out and reported.

    POSES has one row per stop, or is a log of the joints with many rows and their times, by any clock. The stops of
    the joints then count as those of the tip, in order. An .mcap (extra: mcap) has bodies as topics of poses or
    frames of tf. As POSES, its JointState is read at the stops.

    For a LeRobot dataset (v3; extra: lerobot) type the word lerobot as RECORDING and the dataset as POSES. The output
    is then poses for camera read or a tracker: the commanded angles of every stop and what the encoders read.
    """
    if recording == Path(LEROBOT):
        unit = stated_reading({"angle_unit": angle_unit}).angle_unit
        _import_lerobot(poses, output, arm, dwell, unit, prefix)
        return
    from lrm_ident.data.measurement_file.conventions import arm_for
    from lrm_ident.measuring.recordings.imported import RecordingOrder, RestTimes, import_recording
    from lrm_ident.measuring.recordings.tracker_csv import ROTATIONS

    if (every is None) != (first is None):
        raise LrmError("--every and --first go together")
    times = None if every is None or first is None else RestTimes(first, every)
    kind = None if rotation is None else one_of("rotation", rotation, ROTATIONS)
    stated = stated_reading({"axes": axes, "angle_unit": angle_unit})
    order = RecordingOrder(tool, base, times, skip, dwell, stated.axes, kind, stated.angle_unit, orientation)
    name, the_arm = arm_for(poses, arm)
    imported = import_recording(recording, poses, the_arm, order)
    write_with_metadata(output, imported.csv(), name, f"import: {recording.name}")
    notice(*imported.notices)
    for number, why in imported.left_out.items():
        show(f"left out: pose {number}: {why}")
    show(f"{len(imported.tip)} of {len(imported.tip) + len(imported.left_out)} poses are in {output}")


def _import_lerobot(
    dataset: Path, output: Path, arm: str | None, dwell: float, unit: AngleUnit | None, prefix: str | None
) -> None:
    """Writes the rests of a dataset as poses, and a .toml file beside them. Raises `LrmError`."""
    from lrm_ident.cli.groups.checkup_report import misread_words
    from lrm_ident.measuring.recordings.lerobot import read_frames, read_lerobot, rests_csv
    from lrm_ident.measuring.recordings.lerobot_hub import dataset_folder

    name, dataset = arm or SO101, dataset_folder(dataset)
    the_arm = load_arm(name)
    frames, labels = read_frames(dataset, the_arm, unit, prefix), joint_labels(the_arm)
    rests = read_lerobot(dataset, the_arm, frames, dwell)
    gone = np.flatnonzero(frames.missing.any(axis=1))
    lost = [labels[joint] for joint in np.flatnonzero(frames.missing.any(axis=0)).tolist()]
    left_out = (
        [f"{len(gone)} frames without a number of {', '.join(lost)} left out: {gone[0]} to {gone[-1]}"] if lost else []
    )
    notice(*frames.notices, *left_out, *(misread_words(misread, labels) for misread in rests.misread))
    sd, source = round(float(np.degrees(rests.feedback_sd)), 5), f"LeRobot dataset {dataset.name}"
    write_with_metadata(output, rests_csv(rests), name, source, feedback_sd_deg=sd)
    off = np.degrees(rests.feedback - rests.command)
    worst = int(np.abs(off).mean(axis=0).argmax())
    show(
        f"{len(rests.t)} stops of {len(np.unique(rests.episode))} episodes written to {output}.",
        *(["The angles are taken for degrees (LeRobot's use_degrees=true)."] if unit is None else []),
        f"The servo of {labels[worst]} is off its command most: by {np.abs(off[:, worst]).mean():.2f} deg on average.",
    )


@command
def checkup(
    dataset: Annotated[
        Path,
        Argument(
            metavar="DATASET", help="Folder of a LeRobot dataset, v2.1 or v3, in degrees; or USER/DATASET of its cache."
        ),
    ],
    arm: arg.ServoArm = SO101,
    dwell: Annotated[float, Option(min=0.2, help="Seconds that a stop lasts at least.")] = 0.5,
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
    angle_unit: Annotated[str | None, Option(help="Unit of the dataset's angles: deg (default) or rad.")] = None,
    prefix: Prefix = None,
    card: Annotated[
        Path | None, Option("--card", metavar="FILE", help="Also write a paragraph for the dataset's card (.md).")
    ] = None,
    json: arg.JsonFile = None,
    show_all: arg.ShowAll = False,
) -> None:
    """Check a LeRobot recording for faults of the arm: sag, dead band, zero offset, drift, a slipped horn.

    Also finds a joint that is reversed, swapped with another, frozen, or past its encoder's seam.

    Compares command (action) and encoder (observation.state) at the stops, where they should agree, and reports what
    their difference depends on. Two minutes with a stop now and then are enough. The dataset is not changed.

    USER/DATASET is looked for in LeRobot's cache (HF_LEROBOT_HOME), then on the Hub if huggingface_hub is installed.
    Exit code: 0 without a finding, 1 with findings, 2 where nothing could be checked.

    With a board in the video (--video, --lens, -o; extras: camera, video) the frames at the stops show where the tip
    was. The command then also fits links and springs and diagnoses what is missing.
    """
    from lrm_ident.cli.groups.checkup_report import card_paragraph, checkup_document, studied, with_video
    from lrm_ident.measuring.recordings.encoder_checkup import checkup as check
    from lrm_ident.measuring.recordings.lerobot import read_frames
    from lrm_ident.measuring.recordings.lerobot_hub import dataset_folder

    if video is None and (lens is not None or output is not None or on_gripper):
        raise LrmError("--lens, --on-gripper and -o go with --video")
    if video is not None and (lens is None or output is None):
        raise LrmError(f"--video {video}: give --lens (camera calibrate) and -o, where its measurements go")
    the_arm, folder = load_arm(arm), dataset_folder(dataset, video is not None)
    frames = read_frames(folder, the_arm, stated_reading({"angle_unit": angle_unit}).angle_unit, prefix)
    notice(*frames.notices)
    checked = check(frames, the_arm, dwell)
    document = checkup_document(checked, the_arm, dataset.name)
    if card is not None:
        write_text(card, card_paragraph(checked, the_arm))
    if video is None or lens is None or output is None:
        publish(document, json, in_full=show_all)
        raise Exit(1 if checked.findings else 0)
    from lrm_ident.data.measurement_file.write import measurements_csv, write_with_metadata
    from lrm_ident.measuring.camera.lens import Lens
    from lrm_ident.measuring.recordings.lerobot_video import measure_video

    with progress("looking at the rests") as tick:
        photos = measure_video(folder, video, frames, dwell, the_arm, arm, read_toml(lens, Lens), on_gripper, tick)
    write_with_metadata(output, measurements_csv(photos.data), arm, f"video, {dataset.name}", frame="arm")
    publish(
        with_video(document, photos, studied(read_measurements(output, the_arm, arm)), output), json, in_full=show_all
    )
    raise Exit(1 if checked.findings else 0)
