"""`lrm-ident camera`: a webcam and a printed board as the tracker."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
import tomli_w
from typer import Argument, Option

from lrm_ident.cli import arguments as arg
from lrm_ident.cli.arm_access import ArmAccess
from lrm_ident.cli.campaign import photo_poses
from lrm_ident.cli.command import command_group, command_of
from lrm_ident.cli.common import notice, one_of, progress, read_poses, show
from lrm_ident.data.atomic_write import write_bytes, write_text
from lrm_ident.data.measurement_file.load import load_poses, read_pose_feedback
from lrm_ident.data.measurement_file.write import measurements_csv, write_with_metadata
from lrm_ident.data.robot_files.camera_pose import camera_pose_text
from lrm_ident.measuring.camera.board import (
    DICTIONARIES,
    CharucoBoard,
    RejectedPhoto,
    board_pdf,
    find_corners,
    read_picture,
)
from lrm_ident.measuring.camera.capture import is_camera, keep_photo, open_camera, photograph_by_hand, photos_in
from lrm_ident.measuring.camera.lens import Lens, calibrate_lens
from lrm_ident.measuring.camera.other_boards import other_board
from lrm_ident.measuring.camera.session import (
    ENOUGH_TO_LEVEL,
    CameraMeasurements,
    CameraSession,
    measure,
    read_photos,
)
from lrm_ident.report.document import ListSection
from lrm_math.arm.arm_file import MM, arm_name_for, load_arm
from lrm_math.errors import FileError, LrmError
from lrm_math.toml_file import StrictSchema, read_toml

camera_command = command_of(command_group("camera", "Measure with a webcam and a printed board (extra: camera)."))

Columns = Annotated[int, Option(help="Squares along the board.")]
Rows = Annotated[int, Option(help="Squares down the board.")]
SquareMm = Annotated[float, Option("--square-mm", help="Edge of a square, as printed: measure the line of 100 mm.")]
DictionaryName = Annotated[str, Option("--dictionary", help="Markers of the board, by OpenCV's name: 5X5_100.")]
Legacy = Annotated[bool, Option("--legacy/--no-legacy", help="The pattern of OpenCV before 4.6: first square white.")]
PhotosFolder = Annotated[str, Argument(metavar="PHOTOS", help="A folder of photos, taken in order of their names.")]
SHOWN = 15  # refused photos


@camera_command
def board(
    output: Annotated[Path, Option("-o", "--output", metavar="PDF", help="Where to write the page.")],
    columns: Columns = 6,
    rows: Rows = 5,
    square_mm: SquareMm = 15.0,
    dictionary: DictionaryName = "4X4_50",
    legacy: Legacy = False,
    paper: Annotated[str, Option(help="Paper: a4 or letter.")] = "a4",
) -> None:
    """Write a ChArUco board as a PDF at true scale, with a ruler to check the print."""
    the_board = _board(columns, rows, square_mm, dictionary, legacy)
    write_bytes(output, board_pdf(the_board, paper))
    show(
        f"Board of {the_board} written to {output}.",
        "Print it at 100 % ('actual size'), lay a ruler on the line of 100 mm, glue it on something flat and stiff.",
    )


@camera_command
def calibrate(
    photos: PhotosFolder,
    output: Annotated[Path, Option("-o", "--output", metavar="LENS", help="Where to write the lens (.toml).")],
    columns: Columns = 6,
    rows: Rows = 5,
    square_mm: SquareMm = 15.0,
    dictionary: DictionaryName = "4X4_50",
    legacy: Legacy = False,
) -> None:
    """Calibrate a camera's lens from photos of the board: 15 or more, near and far, leaning, out to the edges."""
    the_board, files = _board(columns, rows, square_mm, dictionary, legacy), photos_in(Path(photos))
    corner_sets, refused, sizes = [], [], set()
    with progress("looking for the board") as tick:
        for number, file in enumerate(files, start=1):
            picture = read_picture(file)
            corners = find_corners(picture, the_board)
            if isinstance(corners, RejectedPhoto):
                refused.append((file.name, corners.reason))
            else:
                corner_sets.append(corners)
                sizes.add((picture.shape[1], picture.shape[0]))
            tick(number, len(files))
    if len(sizes) > 1:
        raise LrmError(f"{photos}: photos of {len(sizes)} sizes; a lens is calibrated for one")
    show_refused(refused)
    if not corner_sets:
        why = other_board(map(read_picture, files), the_board) or refused[0][1]
        raise LrmError(f"{photos}: {the_board} are in none of the {len(files)} photos; {why}")
    lens = calibrate_lens(corner_sets, the_board, next(iter(sizes)))
    write_text(output, _toml(lens))
    show(
        f"{len(corner_sets)} of {len(files)} photos used; corners are off by {lens.noise_px:.2f} px.",
        f"Focal length {lens.focal_x_px:.0f} px of {lens.width_px}, "
        f"centre {lens.centre_x_px:.0f}, {lens.centre_y_px:.0f} px.",
        f"Lens written to {output}",
    )


@camera_command
def read(
    photos: Annotated[
        str,
        Argument(
            metavar="PHOTOS|CAMERA",
            help="A folder of photos, the number of a camera, such as 0, or the address of its still picture: http://…",
        ),
    ],
    poses: Annotated[Path, Option(metavar="POSES", help="CSV of the commanded poses, one per photo, in their order.")],
    lens: Annotated[Path, Option(metavar="LENS", help="The lens, written by camera calibrate.")],
    arm: Annotated[str, Option(help="A shipped arm or the path of an arm file.")],
    output: Annotated[
        Path,
        Option("-o", "--output", metavar="DATA", help="Where to write the measurements (.csv)."),
        arg.CompanionFiles({".toml": "metadata", ".camera.toml": "session"}),
    ],
    robot: Annotated[str | None, arg.AnyRobot.__metadata__[0]] = None,
    connect: arg.Connect = None,
    settle: arg.Settle = 0.5,
    speed: arg.Speed = None,
    load_command: arg.LoadCommand = None,
    take: arg.Take = False,
    release: arg.Release = False,
) -> None:
    """Turn photos of the board on the arm into measurements: one pose of the board per commanded pose.

    Where the camera stands and how the board is mounted is found together with it. Written are DATA.csv, DATA.toml
    beside it, and DATA.camera.toml, with which `design --camera` offers only poses that the camera can see, and
    `verify --tracker camera:0,DATA.camera.toml` measures where the tip lands.

    With a camera, a person drives to each pose and presses Enter, or --robot is driven there, as by `measure`; then
    poses.csv among the photos in DATA.photos has the angles that were commanded.
    """
    session_file, folder = output.with_suffix(".camera.toml"), output.with_suffix(".photos")
    the_arm, file = load_arm(arm), read_toml(lens, Lens)
    commanded = read_poses(poses, the_arm)
    if robot is not None:
        if not is_camera(photos):
            raise LrmError(f"--robot {robot}: it goes with a camera; {photos} is a folder of photos")
        if folder.exists() and any(folder.iterdir()):
            raise FileError(folder, "", "has photos already", "move them away, or read them with their poses")
        folder.mkdir(parents=True, exist_ok=True)
        driven, access = folder / "poses.csv", ArmAccess(robot, connect, speed, take, release)
        with open_camera(photos) as opened:
            take_one = partial(keep_photo, opened, folder)
            photo_poses(poses, arm, access, take_one, driven, settle, load_command)
        poses, commanded, files = driven, load_poses(driven, the_arm), photos_in(folder)
    elif is_camera(photos):
        with open_camera(photos) as opened:
            files = photograph_by_hand(opened, folder, commanded)
    else:
        files = photos_in(Path(photos))
    if len(files) != len(commanded):
        raise FileError(photos, "", f"{len(files)} photos for {len(commanded)} poses of {poses.name}", "one for each")
    seen = read_photos(files, file)
    show_refused(seen.refused)
    if not seen.rows and (why := other_board(map(read_picture, files), file.board)):
        raise LrmError(f"{photos}: {why} to camera calibrate, with photos of this board")
    measured = measure(the_arm, arm_name_for(arm, output.parent), commanded, seen, file, output)
    feedback, feedback_sd = read_pose_feedback(poses, the_arm)
    data = measured.data.beside(*(readings.take(measured.photos.rows) for readings in feedback))
    table, source = measurements_csv(data), f"camera, {photos}"
    write_with_metadata(output, table, arm, source, frame="arm", feedback_sd_deg=feedback_sd)
    write_text(session_file, _toml(measured.session))
    _show(measured, len(files), output)


@camera_command
def export(
    session: Annotated[Path, Argument(metavar="CAMERA", help="The .camera.toml beside the data of camera read.")],
    output: Annotated[
        Path, Option("-o", "--output", metavar="FILE", help=".launch.py for ROS 2 and MoveIt, .yaml for tf2, or .json.")
    ],
    base: Annotated[str, Option(metavar="LINK", help="The arm's base in the robot's URDF.")] = "base_link",
    frame: Annotated[str, Option(metavar="FRAME", help="Name of the camera's frame.")] = "camera_optical_frame",
) -> None:
    """Write where the camera stands at the arm's base, for ROS 2, MoveIt or other programs.

    The frame is the optical one of ROS and OpenCV: z ahead, x right, y down. The arm's frame is that of its arm file,
    which has to be the frame of --base.
    """
    camera, _ = read_toml(session, CameraSession).motions
    write_text(output, camera_pose_text(output, camera, base, frame))
    x, y, z = 1e3 * camera[:3, 3]
    show(f"{frame} at {base}: x {x:.1f}, y {y:.1f}, z {z:.1f} mm, written to {output}")


def _show(measured: CameraMeasurements, photos: int, output: Path) -> None:
    sd = np.sqrt(np.einsum("nii->ni", measured.data.positions.covariance)) / MM
    x, y, z = (getattr(measured.session.camera, f"{axis}_mm") for axis in "xyz")
    if len(measured.data) < ENOUGH_TO_LEVEL:
        notice(
            f"{len(measured.data)} photos: the camera was placed by the arm as drawn; from {ENOUGH_TO_LEVEL} on the "
            "arm's own errors are taken into account"
        )
    show(
        f"{len(measured.data)} of {photos} photos used; the tool's position is known to "
        f"{np.median(sd.min(axis=1)):.2f} to {np.median(sd.max(axis=1)):.2f} mm per axis.",
        f"The camera stands at {x:.0f}, {y:.0f}, {z:.0f} mm in the arm's frame.",
        f"Measurements written to {output}; next: lrm-ident fit {output} -o model.toml",
    )


def _board(columns: int, rows: int, square_mm: float, dictionary: str, legacy: bool) -> CharucoBoard:
    for name, value, low, high in (
        ("columns", columns, 3, 20),
        ("rows", rows, 3, 20),
        ("square-mm", square_mm, 2, 200),
    ):
        if not low <= value <= high:
            raise LrmError(f"--{name} {value:g}: should be {low} to {high}")
    name = one_of("dictionary", dictionary, DICTIONARIES)
    return CharucoBoard(columns=columns, rows=rows, square_mm=float(square_mm), dictionary=name, legacy=legacy)


def show_refused(photos: Sequence[tuple[str, str]]) -> None:
    """Prints why photos, by name, are of no use."""
    if photos:
        lines = tuple(f"{name}: {reason}" for name, reason in photos[:SHOWN])
        show(ListSection(f"{len(photos)} photos are of no use:", lines))


def _toml(file: StrictSchema) -> str:
    return tomli_w.dumps(file.model_dump(by_alias=True))
