"""Command that takes a calibrated arm from a bench to where it works."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from lrm_ident.cli import arguments as arg
from lrm_ident.cli.command import command
from lrm_ident.cli.common import bars, notice, publish, read_measurements, show
from lrm_ident.design.installation import expected_errors
from lrm_ident.fitting.effect_plugins import catalogue_with
from lrm_ident.report.transfer import transfer_document
from lrm_ident.study.transfer import identified, read_transfer
from lrm_math.errors import LrmError
from lrm_math.model.reading import AS_NAMED, Reading


@command
def transfer(
    model: arg.ModelPath,
    few: Annotated[
        Path | None,
        Argument(metavar="FEW.csv", help="A few poses measured where the arm now stands; 6 of design --installation."),
    ] = None,
    to: Annotated[
        str, Option("--to", metavar="ARM", help="The arm at its new place: a shipped arm or an arm file.")
    ] = "",
    output: Annotated[Path | None, Option("-o", "--output", metavar="MODEL", help="Where to write the model.")] = None,
    noise_mm: Annotated[
        float | None,
        Option(
            min=0.001,
            help="Noise of FEW.csv per axis, if it is larger than the error that the model left in its own data.",
        ),
    ] = None,
    json: arg.JsonFile = None,
    effects_file: arg.EffectsFile = None,
    reading: Reading = AS_NAMED,
) -> None:
    """Move a calibrated model from its bench to another base and tool, such as a rover's.

    The arm's own errors go along, with their standard errors: links, springs, play, gears. Base, tool, gravity and
    tracker of the bench stay behind. A few poses, measured at the new place, identify base, tool and gravity there.
    Without poses, base and tool are as the arm file says.

    Prints the error of the tip to expect with 0, 3, 6 and 12 poses.

    \b
      lrm-ident transfer lab.toml --to lrm-rover
      lrm-ident design lrm-rover --model lab.toml --installation -o 6.csv
      lrm-ident measure 6.csv -o few.csv
      lrm-ident transfer lab.toml --to lrm-rover few.csv -o rover.toml
      lrm deploy rover.toml
    """
    if not to:
        raise LrmError("transfer: --to ARM is missing: the arm file of the place that the arm goes to")
    catalogue = catalogue_with(effects_file)
    transfer_result, notices = read_transfer(model, to, catalogue, None if noise_mm is None else noise_mm * 1e-3)
    notice(*notices)
    if few is not None:
        transfer_result = identified(transfer_result, read_measurements(few, transfer_result.model.arm, to, reading))
    with bars() as progress:
        expected = expected_errors(transfer_result.start, progress=partial(progress, "choosing poses"))
    if output:
        transfer_result.save(output)
    publish(transfer_document(transfer_result, expected), json)
    show(f"Model written to {output}" if output else "Not saved; give -o MODEL to keep it.")
