"""Commands of the component tests (Conenna 2024, section 5.3): one servo under load, the tracker's two targets."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
from typer import Argument, Option

from lrm_ident.cli import arguments as arg
from lrm_ident.cli.command import command
from lrm_ident.cli.common import notice, publish, show
from lrm_ident.data.atomic_write import write_text
from lrm_ident.data.servo_stiffness import load_servo_test
from lrm_ident.data.servo_stiffness import stiffness as run_stiffness
from lrm_ident.data.tracker_alignment import align as run_align
from lrm_ident.data.tracker_alignment import load_tracked, measurements_from
from lrm_ident.data.wording import in_mm
from lrm_ident.report.component_tests import alignment_document, stiffness_document
from lrm_ident.report.plots.servo_stiffness import draw_stiffness
from lrm_math.arm.arm_file import MM, load_arm
from lrm_math.errors import LrmError
from lrm_math.number_list import parse_numbers

STILL = 3.0  # times the TCP's noise that the base target may wander before a person should know


@command
def stiffness(
    data: Annotated[
        Path, Argument(metavar="DATA", help="CSV: angle_deg and torque_Nm (or load_g and lever_mm), in order.")
    ],
    json: arg.JsonFile = None,
    figure: arg.FigureFile = None,
) -> None:
    """Measure the stiffness of one servo under load: slope, linearity, hysteresis between loading and unloading."""
    result = run_stiffness(load_servo_test(data))
    publish(stiffness_document(result), json)
    if figure:
        draw_stiffness(result, figure)
        show(f"Figure written to {figure}, its data are {data}")


@command
def align(
    fixture: Annotated[
        Path, Argument(metavar="FIXTURE", help="CSV of both targets: base_x_mm…, base_qw…base_qz, tcp_x_mm…")
    ],
    known_mm: Annotated[
        str,
        Option(
            "--known-mm",
            metavar="X,Y,Z",
            help="Where the fixture holds the TCP target, in the frame of the base target.",
        ),
    ],
    raw: Annotated[Path | None, Option(metavar="RAW", help="Raw readings of an arm to turn into measurements.")] = None,
    arm: Annotated[str, Option(help="The arm that RAW was measured on.")] = "lrm-lab",
    output: Annotated[
        Path | None, Option("-o", "--output", metavar="CSV", help="Where to write the measurements.")
    ] = None,
    json: arg.JsonFile = None,
) -> None:
    """Measure the offset between the tracker's targets and the tip, and subtract it from raw measurements."""
    if (raw is None) != (output is None):
        raise LrmError("--raw and -o go together: raw readings in, measurements out")
    readings = load_tracked(fixture)
    known_points = parse_numbers("--known-mm", known_mm, "three numbers by commas, for instance 245,0,40", count=3)
    alignment = run_align(readings, np.array(known_points) * MM)
    publish(alignment_document(alignment), json)
    if raw and output:
        text, tracked = measurements_from(raw, load_arm(arm), alignment.deviation)
        if tracked.base_scatter() > STILL * float(np.linalg.norm(alignment.noise)):
            notice(f"{raw.name}: the base target wanders by {in_mm(tracked.base_scatter())} mm RMS")
        write_text(output, text)
        show(f"{len(tracked.tcp)} measurements written to {output}")
