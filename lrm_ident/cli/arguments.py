"""Arguments and options that several commands take, with their help."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from typer import Argument, Option


@dataclass(frozen=True)
class CompanionFiles:
    """Mark of an output: the files written beside it, by their ending, and whether an existing one goes on."""

    files: Mapping[str, str] = field(default_factory=dict)
    appended: bool = False


DataFile = Annotated[
    Path, Argument(metavar="DATA", help="Measurements: a CSV of positions, or of distances (docs/files.md).")
]
ModelPath = Annotated[Path, Argument(metavar="MODEL", help="A model file written by fit.")]
PosesFile = Annotated[Path, Argument(metavar="POSES", help="CSV with q1_deg… and, optionally, payload_g.")]
ArmArgument = Annotated[str, Argument(metavar="ARM", help="A shipped arm or the path of an arm file.")]
ArmName = Annotated[
    str | None,
    Option(
        "--arm",
        help="A shipped arm (lrm-rover, lrm-lab, two-joint, so100, so101, koch, lekiwi, ur5) or the path of an arm "
        "file. Default: the arm that the .toml file beside DATA names.",
    ),
]
ShowAll = Annotated[bool, Option("--all", help="Print the details, too, and long lists in full.")]
Force = Annotated[bool, Option("--force", help="Replace a model file that has more steps than the new one.")]
NewModel = Annotated[Path, Option("-o", "--output", metavar="MODEL2", help="Where to write the new model.")]
JsonFile = Annotated[Path | None, Option("--json", metavar="FILE", help="Also write the result for machines.")]
FigureFile = Annotated[
    Path | None, Option("--figure", metavar="FILE", help="Also draw the result: .png, .svg or .pdf.")
]
FigureAndNumbers = Annotated[
    Path | None,
    Option("--figure", metavar="FILE", help="Also draw the result: .png, .svg or .pdf; its numbers beside it as .csv."),
    CompanionFiles({".csv": "numbers"}),
]
EffectsFile = Annotated[
    Path | None,
    Option("--effects-file", metavar="FILE.py", help="A Python file with effects of your own (docs/effects.md)."),
]
Cluster = Annotated[
    str | None,
    Option(
        "--cluster",
        metavar="ADDRESS",
        help="Hand the work to a Dask cluster: its scheduler's address (tcp://scheduler:8786) or scheduler file "
        "(docs/fleet.md). Default: all cores of this machine.",
    ),
]
FleetPrior = Annotated[
    str | None,
    Option(
        "--prior",
        metavar="FILE",
        help="A prior file that says how often arms of this kind have each effect, as lrm-ident fleet writes it.",
    ),
]
LinearizedAt = Annotated[
    Path | None,
    Option("--model", metavar="MODEL", help="Linearise about this fitted model instead of the nominal arm."),
]
NoiseMm = Annotated[float, Option(min=0.001, help="Noise of the measurement per axis.")]
UnitsName = Annotated[
    str, Option(help="thesis (mm per rad, per mm, per rad/Nmm) or scaled (mm per typical size of a parameter).")
]
Count = Annotated[int, Option("-n", "--count", min=1, help="How many poses to choose.")]
IndexName = Annotated[str, Option(help="What to raise: O1 (determinant), O2, O3, O4 or O5 (docs/design.md).")]
Seed = Annotated[int, Option(help="Of the random starts.")]
PosesOutput = Annotated[Path | None, Option("-o", "--output", metavar="CSV", help="Where to write the poses.")]
AnyRobot = Annotated[
    str,
    Option(
        help="Whose daemon; or a robot of LeRobot: lerobot:so101_follower,port=/dev/ttyACM0,id=mine; or bare Feetech "
        "(SO-100, SO-101, LeKiwi) or Dynamixel (Koch) servos: feetech:/dev/ttyACM0,ids=1-5, "
        "dynamixel:/dev/ttyUSB0,ids=1-5."
    ),
]
Connect = Annotated[
    str | None, Option(metavar="ENDPOINT", help="zenoh endpoint. Default: LRM_CONNECT, or tcp/127.0.0.1:7447.")
]
TrackerName = Annotated[
    str,
    Option(
        help="dtrack:PORT (ART's ASCII datagrams), zenoh:KEY (the same on zenoh), csv:FILE that is being written, or a "
        "camera and its DATA.camera.toml of camera read: camera:0,DATA.camera.toml."
    ),
]
ToolTarget = Annotated[int, Option(min=0, help="Number of the target at the tip.")]
BaseTarget = Annotated[
    int, Option(min=-1, help="Number of the target at the base; -1: positions are in the arm's frame.")
]
Pause = Annotated[float, Option("--pause", min=0, help="Seconds from one pose to the next.")]
Settle = Annotated[float, Option(min=0, help="Seconds of rest at least, before the averaging.")]
Dwell = Annotated[float, Option(min=0.05, help="Seconds at the end of the rest to average over.")]
LoadCommand = Annotated[
    str | None,
    Option(
        metavar="COMMAND",
        help="Changes the load, with the grams as its last word. Default: a question on the terminal.",
    ),
]
Speed = Annotated[
    float | None,
    Option(min=1.0, max=180.0, metavar="DEG_PER_S", help="Of the fastest joint, without a daemon. Default: 30."),
]
Release = Annotated[
    bool, Option("--release", help="Bare servos: Ctrl-\\ takes their torque without a question, and the arm falls.")
]
AcceptSettings = Annotated[
    bool, Option("--accept", help="Go on though the servos are set otherwise (P, I, D, torque limit, firmware …).")
]
Take = Annotated[bool, Option("--take", help="Take the arm over if another client has it.")]
