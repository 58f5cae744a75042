"""`lrm-ident arm`: descriptions of arms in, out, and looked at."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
from typer import Argument, Option

from lrm_ident.cli import arguments as arg
from lrm_ident.cli.command import command_group, command_of
from lrm_ident.cli.common import notice, one_of, publish, read_model, show
from lrm_ident.cli.groups.arm_export import writer_for
from lrm_ident.cli.groups.arm_report import arm_document
from lrm_ident.data.atomic_write import write_text
from lrm_ident.data.robot_files.arm_text import arm_text, template
from lrm_ident.data.robot_files.mjcf_robot import read_robot
from lrm_ident.data.robot_files.urdf_arm import import_arm
from lrm_ident.fitting.effect_plugins import catalogue_with
from lrm_ident.measuring.motion.joint_dynamics import ISAAC, with_dynamics
from lrm_ident.report.plots.arm import draw_arm
from lrm_math.arm.arm import BASE, TOOL
from lrm_math.arm.arm_file import load_arm
from lrm_math.arm.plausible_arm import RULES
from lrm_math.effects import marked
from lrm_math.errors import FileError, LrmError
from lrm_math.model.covariance import drawn_models
from lrm_math.model.deployed_model import as_deployed, of_a_session
from lrm_math.model.model import Model, model_of
from lrm_math.model.model_file import load_covariance
from lrm_math.motion.motion_model import MotionModel, load_motion
from lrm_math.number_list import parse_numbers
from lrm_math.toml_file import schema_of

group = command_group("arm", "Describe an arm: from a URDF, to a corrected URDF or MJCF, by hand.")
arm_command = command_of(group)

OwnUrdf = Annotated[
    Path | None, Option("--urdf", metavar="URDF", help="URDF of your robot, to correct; all else stays.")
]
OwnMjcf = Annotated[
    Path | None, Option("--mjcf", metavar="XML", help="MJCF of your robot, to correct; all else stays.")
]
OwnCalibration = Annotated[
    Path | None,
    Option(
        "--calibration",
        metavar="JSON",
        help="LeRobot's calibration of your arm; -o .yaml is for the ROS 2 driver of Feetech servos.",
    ),
]
OwnRos2Control = Annotated[
    Path | None,
    Option("--ros2-control", metavar="XACRO", help="Your <ros2_control> file, of a Dynamixel or Feetech driver."),
]
UrdfPath = Annotated[
    Path, Argument(metavar="URDF", help="A URDF, a .xacro (needs the package xacrodoc), or MuJoCo's .xml (mujoco).")
]
ArmOutput = Annotated[Path, Option("-o", "--output", metavar="ARM", help="Where to write the arm file (.toml).")]
Base = Annotated[str | None, Option("--base", metavar="LINK", help="Where the arm begins. Default: the root link.")]
Tip = Annotated[str | None, Option("--tip", metavar="LINK", help="The link that is measured. Default: the only tip.")]

RootGravity = Annotated[
    str | None,
    Option(
        "--gravity",
        metavar="X,Y,Z",
        help="Gravity in the root link's frame, m/s2. Default for a URDF: the root is level, 0,0,-9.81.",
    ),
]
XacroArguments = Annotated[
    list[str] | None,
    Option("--xacro", metavar="NAME:=VALUE", help="An argument of a xacro file; give it once for each argument."),
]
Accept = Annotated[
    str, Option(metavar="RULE,…", help=f"Accept what looks wrong and you know to be right: {', '.join(RULES)}.")
]


@command_of(group, "import")
def import_urdf(
    urdf: UrdfPath,
    output: ArmOutput,
    base: Base = None,
    tip: Tip = None,
    name: Annotated[str | None, Option(help="Name of the arm. Default: the robot's name in the URDF.")] = None,
    gravity: RootGravity = None,
    xacro: XacroArguments = None,
    accept: Accept = "",
    json: arg.JsonFile = None,
    show_all: arg.ShowAll = False,
) -> None:
    """Make an arm file of a URDF or an MJCF, exact to round-off: joints, limits, masses and centres of mass.

    The arm is compared with the URDF's own kinematics at 200 random poses before it is written.
    """
    rules = [one_of("rule", word.strip(), RULES) for word in accept.split(",") if word.strip()]
    robot = read_robot(urdf, _arguments(xacro or []))
    if gravity is not None:
        x, y, z = parse_numbers("--gravity", gravity, "three components in m/s2 by commas", 3)
        robot = replace(robot, gravity=(x, y, z))
    imported = import_arm(robot, base, tip, name, rules)
    text = arm_text(
        imported.arm,
        source=f"{urdf.name}, links {imported.base} to {imported.tip}",
        comments=(
            f"{imported.arm.dof} joints of {urdf.name} from {imported.base} to {imported.tip}, angles 0 as there.",
            f"Its pose differs from the URDF's own kinematics by at most {imported.difference:.1g} (m, rad).",
        ),
    )
    publish(arm_document(imported.arm, imported.difference), json, in_full=show_all)
    notice(*imported.notices)
    write_text(output, text)
    show(f"Arm written to {output}")


def _arguments(written: Sequence[str]) -> dict[str, str]:
    """Arguments of xacro by name. Raises `LrmError`."""
    for word in written:
        if ":=" not in word:
            raise LrmError(f"--xacro {word}: should be NAME:=VALUE, as ur_type:=ur5e")
    return {name: value for name, _, value in (word.partition(":=") for word in written)}


@arm_command
def export(
    model: Annotated[str, Argument(metavar="MODEL", help="A model file written by fit, or an arm (nominal).")],
    output: Annotated[
        Path,
        Option(
            "-o",
            "--output",
            metavar="FILE",
            help="Where to write it: .urdf; .xml for MJCF; .json for LeRobot, or (--motion) Isaac Lab; the ending "
            "of your own file.",
        ),
    ],
    urdf: OwnUrdf = None,
    mjcf: OwnMjcf = None,
    calibration: OwnCalibration = None,
    ros2_control: OwnRos2Control = None,
    base: Base = None,
    tip: Tip = None,
    keep: Annotated[
        str,
        Option(
            help="base, tool or base,tool: these stay nominal. With a tracker or camera their errors are those of its "
            "frame and of the mount of the target."
        ),
    ] = "",
    draws: Annotated[
        int,
        Option(
            "--draws",
            "--samples",
            min=0,
            help="Write this many variants, drawn from what the fits of MODEL and of --motion leave open: FILE-001 …",
        ),
    ] = 0,
    seed: arg.Seed = 0,
    motion: Annotated[
        Path | None,
        Option(
            metavar="MOTION",
            help="A motion model (lrm-ident motion auto): its damping, armature and friction, in place of guesses.",
        ),
    ] = None,
    effects_file: arg.EffectsFile = None,
) -> None:
    """Write a file that matches your arm: a URDF, an MJCF, LeRobot's calibration, ros2_control's offsets.

    URDF: the rigid part of the model is in every <origin>, a zero offset is a turn about the joint's axis. MJCF: bodies
    likewise, a joint's compliance k is a position actuator with kp = 1/k, play an extra joint with a range, friction
    a frictionloss. LeRobot, ros2_control: zero offsets. What a file cannot hold is listed; it stays in the model.
    """
    the_model = _model(model, effects_file)
    places = [one_of("place to keep", word.strip(), (BASE, TOOL)) for word in keep.split(",") if word.strip()]
    given = {"--urdf": urdf, "--mjcf": mjcf, "--calibration": calibration, "--ros2-control": ros2_control}
    options = {option: path for option, path in given.items() if path is not None}
    write_for = writer_for(output, options, base, tip, places)
    moves = None if motion is None else load_motion(motion)[1]
    variants = _variants(Path(model), the_model, draws, seed, effects_file, moves) if draws else [the_model]
    files = [output.with_stem(f"{output.stem}-{n:03d}") for n in range(1, draws + 1)] if draws else [output]
    made = [write_for(as_deployed(variant), path) for variant, path in zip(variants, files, strict=True)]
    if moves is None and made[0].what == ISAAC:
        right = "--motion MOTION (lrm-ident motion auto)"
        raise FileError(output, "", "Isaac Lab's actuators are written of a motion model", f"give {right}")
    if moves is not None:
        rng = np.random.default_rng([seed, 1])
        moved = [moves.drawn(rng) for _ in files] if draws else [moves]
        made = [with_dynamics(*row) for row in zip(made, files, moved, variants, strict=True)]
    for file, path in zip(made, files, strict=True):
        write_text(path, file.text)
    where = f"{files[0]} … {files[-1]}" if draws else str(output)
    missing = [*(effect.name for effect in the_model.effects if of_a_session(effect)), *made[0].left_out]
    show(f"{made[0].what} written to {where}", *([f"Not in it: {', '.join(map(marked, missing))}"] if missing else []))
    state = "" if the_model.state is None else the_model.state.sentence
    notice(*(words for words in (state, made[0].advice) if words))


@command_of(group, "show")
def show_arm(
    arm: arg.ArmArgument,
    q: Annotated[str | None, Option(metavar="DEG,…", help="Joint angles for the picture. Default: all zero.")] = None,
    json: arg.JsonFile = None,
    show_all: arg.ShowAll = False,
    figure: arg.FigureAndNumbers = None,
) -> None:
    """Show an arm: its dimensions, masses, reach, gravity's torques, and (--figure) a picture."""
    the_arm = load_arm(arm)
    right = f"{the_arm.dof} angles in deg by commas, one for each joint of {the_arm.name}"
    angles = np.zeros(the_arm.dof) if q is None else np.radians(parse_numbers("--q", q, right, the_arm.dof))
    publish(arm_document(the_arm, None, angles), json, figure, partial(draw_arm, the_arm, angles), show_all)


@arm_command
def new(
    output: ArmOutput,
    name: Annotated[str, Option(help="Name of the arm.")] = "my-arm",
) -> None:
    """Write a commented arm file to fill in, valid as it stands."""
    write_text(output, template(name))
    show(f"Template written to {output}; look at it with: lrm-ident arm show {output}")


def _model(name: str, effects_file: Path | None) -> Model:
    """A model file, or an arm as drawn. Raises `FileError`."""
    path = Path(name)
    if path.is_file() and (schema_of(path) or "").startswith("lrm/model/"):
        return read_model(path, catalogue_with(effects_file))[1]
    return model_of(load_arm(name), ())


def _variants(
    path: Path, model: Model, count: int, seed: int, effects_file: Path | None, motion: MotionModel | None
) -> list[Model]:
    """Models as far apart as the fit leaves open; of an arm as drawn all alike, beside a motion model.

    Raises `FileError`.
    """
    if not model.keys and motion is not None:
        return [model] * count
    covariance = load_covariance(path, catalogue_with(effects_file)) if path.is_file() and len(model.keys) else None
    if covariance is None:
        raise FileError(path, "covariance", "missing", "--draws needs a model that fit wrote, with its covariance")
    return drawn_models(model, covariance, count, np.random.default_rng(seed))
