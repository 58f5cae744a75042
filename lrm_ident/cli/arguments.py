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
    Path,
    Argument(
        metavar="DATA",
        help="Measurements: a CSV with joint angles and positions of the tip, or distances (docs/files.md).",
    ),
]
ModelPath = Annotated[Path, Argument(metavar="MODEL", help="A model file written by fit.")]
PosesFile = Annotated[Path, Argument(metavar="POSES", help="Poses: a CSV with q1_deg… and, optionally, payload_g.")]
ArmArgument = Annotated[str, Argument(metavar="ARM", help="A shipped arm or the path of an arm file.")]
_ARMS = "A shipped arm (lrm-rover, lrm-lab, two-joint, so100, so101, koch, lekiwi, ur5) or the path of an arm file."
ArmName = Annotated[
    str | None, Option("--arm", help=f"{_ARMS} Default: the arm that the .toml file beside DATA names.")
]
DrivenArm = Annotated[str | None, Option("--arm", help=f"{_ARMS} Default: the daemon's arm; so101 without a daemon.")]
ServoArm = Annotated[str, Option("--arm", metavar="ARM", help="A shipped arm or an arm file.")]
ShowAll = Annotated[bool, Option("--all", help="Print the details, too, and long lists in full.")]
Force = Annotated[bool, Option("--force", help="Replace an existing model file that has more steps than the new one.")]
NewModel = Annotated[Path, Option("-o", "--output", metavar="MODEL2", help="Where to write the new model.")]
JsonFile = Annotated[Path | None, Option("--json", metavar="FILE", help="Also write the result as JSON, for programs.")]
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
        help="A prior file that lrm-ident fleet wrote: how often arms of this kind have each effect.",
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
IndexName = Annotated[str, Option(help="Criterion to maximise: O1 (determinant), O2, O3, O4 or O5 (docs/design.md).")]
Seed = Annotated[int, Option(help="Seed of the random starts.")]
PosesOutput = Annotated[Path | None, Option("-o", "--output", metavar="CSV", help="Where to write the poses.")]
AnyRobot = Annotated[
    str,
    Option(
        help="Name of the robot whose daemon (lrmd) drives the arm. Or a robot of LeRobot: "
        "lerobot:so101_follower,port=/dev/ttyACM0,id=mine. Or bare servos: feetech:/dev/ttyACM0,ids=1-5 (SO-100, "
        "SO-101, LeKiwi), dynamixel:/dev/ttyUSB0,ids=1-5 (Koch)."
    ),
]
Connect = Annotated[
    str | None, Option(metavar="ENDPOINT", help="zenoh endpoint. Default: LRM_CONNECT, or tcp/127.0.0.1:7447.")
]
TrackerName = Annotated[
    str,
    Option(
        help="Where positions come from: dtrack:PORT (ART's ASCII datagrams), zenoh:KEY (the same on zenoh), csv:FILE "
        "(another program writes it), camera:0,DATA.camera.toml (a camera, as camera read left it)."
    ),
]
ToolTarget = Annotated[int, Option(min=0, help="Number of the target at the tip.")]
BaseTarget = Annotated[
    int, Option(min=-1, help="Number of the target at the base; -1: positions are in the arm's frame.")
]
Pause = Annotated[
    float, Option("--pause", min=0, help="Seconds from one pose to the next, at least: 65 poses at 15 s take 16 min.")
]
Settle = Annotated[float, Option(min=0, help="Seconds that the arm stands at least, before the averaging.")]
Dwell = Annotated[float, Option(min=0.05, help="Seconds at the end of each stop to average over.")]
LoadCommand = Annotated[
    str | None,
    Option(
        metavar="COMMAND",
        help="Program that changes the load; its last argument is the grams. Default: you are asked to change it.",
    ),
]
Speed = Annotated[
    float | None,
    Option(min=1.0, max=180.0, metavar="DEG_PER_S", help="Speed of the fastest joint, without a daemon. Default: 30."),
]
Release = Annotated[
    bool, Option("--release", help="Bare servos: Ctrl-\\ switches torque off without a question, and the arm falls.")
]
AcceptSettings = Annotated[
    bool,
    Option(
        "--accept",
        help="Continue although the servos have other settings than before (P, I, D, torque limit, firmware …).",
    ),
]
Take = Annotated[bool, Option("--take", help="Take command of the arm even if another client has it.")]
