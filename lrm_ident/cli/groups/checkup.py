"""`lrm-ident checkup`: what ails a teleoperated arm, by its encoders alone."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from lrm_ident.cli import arguments as arg
from lrm_ident.cli.command import command
from lrm_ident.cli.common import publish


@command
def checkup(
    dataset: Annotated[Path, Argument(metavar="DATASET", help="Folder of a LeRobot dataset, v2.1 or v3, in degrees.")],
    arm: Annotated[str, Option("--arm", metavar="ARM", help="A shipped arm or an arm file.")] = "so101",
    dwell: Annotated[float, Option(min=0.2, help="Seconds that a rest lasts at least.")] = 0.5,
    json: arg.JsonFile = None,
) -> None:
    """Name what a recording of teleoperation tells of an arm: sag, dead band, leader offset, drift, a slip.

    It looks at rests, where command (action) and encoder (observation.state) should agree, and finds what their
    difference follows. Two minutes with a stop now and then are enough. The dataset is not changed.
    """
    from lrm_ident.cli.groups.checkup_report import checkup_document
    from lrm_ident.measuring.recordings.encoder_checkup import checkup as check
    from lrm_ident.measuring.recordings.lerobot import read_frames
    from lrm_math.arm.arm_file import load_arm

    the_arm = load_arm(arm)
    publish(checkup_document(check(read_frames(dataset, the_arm), the_arm, dwell), the_arm, dataset.name), json)
