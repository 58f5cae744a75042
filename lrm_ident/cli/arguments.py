"""The words that several commands take, with their help."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

DataFile = Annotated[
    Path, typer.Argument(metavar="DATA", help="Measurements: CSV with pose, q1_deg…, x_mm, y_mm, z_mm.")
]
ModelPath = Annotated[Path, typer.Argument(metavar="MODEL", help="A model file written by fit.")]
PosesFile = Annotated[Path, typer.Argument(metavar="POSES", help="CSV with q1_deg… and, optionally, payload_g.")]
ArmName = Annotated[
    str | None,
    typer.Option(
        "--arm",
        help="A shipped arm (lrm-rover, lrm-lab) or the path of an arm file. "
        "Default: the arm that the .toml file beside DATA names.",
    ),
]
Effects = Annotated[
    str | None,
    typer.Option(
        help="What the model is made of, by commas: offsets, compliance, lateral_compliance, backlash@joint2, … "
        "Default: offsets,compliance."
    ),
]
Start = Annotated[
    Path | None, typer.Option(metavar="MODEL", help="Start from this model's values, and effects unless given.")
]
Parameters = Annotated[
    str,
    typer.Option(
        help="What to fit: 'identifiable' (all that the data can tell), option1 to option5 of the thesis, or names and "
        "patterns by commas, for instance 'compliance.*,offsets.base.?_mm'."
    ),
]
LossName = Annotated[str, typer.Option(help="squared, huber or cauchy; the last two bear wrong measurements.")]
Unbounded = Annotated[
    bool, typer.Option("--unbounded", help="Allow what physics forbids, such as negative compliances.")
]
PriorName = Annotated[
    str | None,
    typer.Option(
        "--prior",
        help="What is known beforehand: a shipped prior (printed, vague) or the path of a prior file. All parameters "
        "are then fitted together, and shown beside what the data alone can tell.",
    ),
]
ModelOutput = Annotated[Path | None, typer.Option("-o", "--output", metavar="MODEL", help="Where to write the model.")]
TableOutput = Annotated[Path, typer.Option("-o", "--output", metavar="CSV", help="Where to write the predictions.")]
JsonFile = Annotated[Path | None, typer.Option("--json", metavar="FILE", help="Also write the result for machines.")]
FigureFile = Annotated[
    Path | None, typer.Option("--figure", metavar="FILE", help="Also draw the result: .png, .svg or .pdf.")
]
EffectsFile = Annotated[
    Path | None,
    typer.Option("--effects-file", metavar="FILE.py", help="A Python file with effects of your own (docs/effects.md)."),
]
EffectName = Annotated[str, typer.Argument(metavar="EFFECT[@PLACE]", help="For instance backlash@joint2.")]
NewModel = Annotated[Path, typer.Option("-o", "--output", metavar="MODEL2", help="Where to write the new model.")]
MostEffects = Annotated[int, typer.Option("--max-effects", min=0, help="Stop after this many.")]
