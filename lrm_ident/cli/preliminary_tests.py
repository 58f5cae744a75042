"""Commands of the preliminary tests (Conenna 2024, section 5.3): one servo under load, targets against each other."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from lrm_ident.cli.arguments import FigureFile, JsonFile
from lrm_ident.cli.common import app, log, out
from lrm_ident.data.atomic_write import write_text
from lrm_ident.data.servo_stiffness import load_servo_test
from lrm_ident.data.servo_stiffness import stiffness as run_stiffness
from lrm_ident.data.tracker_alignment import align as run_align
from lrm_ident.data.tracker_alignment import load_tracked, measurements_from
from lrm_ident.report import json_files
from lrm_ident.report.preliminary_tests import alignment_json, print_alignment, print_stiffness, stiffness_json
from lrm_math.arm.arm_file import MM, load_arm
from lrm_math.errors import LrmError

STILL = 3.0  # times the TCP's noise that the base target may wander before a person should know


@app.command()
def stiffness(
    data: Annotated[
        Path, typer.Argument(metavar="DATA", help="CSV: angle_deg and torque_Nm (or load_g and lever_mm), in order.")
    ],
    json: JsonFile = None,
    figure: FigureFile = None,
) -> None:
    """Test one servo under load: slope, linearity, and the loop between loading and unloading."""
    found = run_stiffness(load_servo_test(data))
    print_stiffness(out, found)
    if json:
        write_text(json, json_files.text(stiffness_json(found)))
    if figure:
        from lrm_ident.plots.servo_stiffness import draw_stiffness  # matplotlib takes half a second to load

        draw_stiffness(found, figure)
        out.print(f"Figure written to {figure}, its data are {data}")


@app.command()
def align(
    fixture: Annotated[
        Path,
        typer.Argument(metavar="FIXTURE", help="CSV of both targets: base_x_mm…, base_qw…base_qz, tcp_x_mm…"),
    ],
    known_mm: Annotated[
        str, typer.Option("--known-mm", metavar="X,Y,Z", help="Where the fixture holds the TCP target on the base's.")
    ],
    raw: Annotated[
        Path | None, typer.Option(metavar="RAW", help="Raw readings of an arm to turn into measurements.")
    ] = None,
    arm: Annotated[str, typer.Option(help="The arm that RAW was measured on.")] = "lrm-lab",
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="CSV", help="Where to write the measurements.")
    ] = None,
    json: JsonFile = None,
) -> None:
    """Find how far the tracker's targets read from where they are, and take it off raw measurements."""
    if (raw is None) != (output is None):
        raise LrmError("--raw and -o go together: raw readings in, measurements out")
    found = run_align(load_tracked(fixture), _vector(known_mm) * MM)
    print_alignment(out, found)
    if json:
        write_text(json, json_files.text(alignment_json(found)))
    if raw and output:
        text, tracked = measurements_from(raw, load_arm(arm), found.deviation)
        if tracked.base_wander() > STILL * float(np.linalg.norm(found.noise)):
            log.print(f"notice: {raw.name}: the base target wanders by {tracked.base_wander() * 1e3:.2f} mm RMS")
        write_text(output, text)
        out.print(f"{len(tracked.tcp)} measurements written to {output}")


def _vector(text: str) -> np.ndarray:
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise LrmError(f"--known-mm {text}; should be three numbers by commas, for instance 245,0,40") from None
    if not np.all(np.isfinite([x, y, z])):
        raise LrmError(f"--known-mm {text}; should be finite numbers")
    return np.array([x, y, z])
