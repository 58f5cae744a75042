"""`lrm-ident arm`: descriptions of arms in, out, and looked at."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
from typer import Argument, Option, Typer

from lrm_ident.cli import arguments as arg
from lrm_ident.cli.app import app
from lrm_ident.cli.command import command_of
from lrm_ident.cli.common import notice, one_of, parse_numbers, publish, read_model, show
from lrm_ident.cli.groups.arm_report import arm_document
from lrm_ident.data.atomic_write import write_text
from lrm_ident.data.robot_files.arm_text import arm_text, template
from lrm_ident.data.robot_files.mjcf import mjcf
from lrm_ident.data.robot_files.urdf import read_urdf
from lrm_ident.data.robot_files.urdf_arm import import_arm
from lrm_ident.data.robot_files.urdf_export import bare_urdf, corrected_urdf, exported_difference, left_out, rigid_part
from lrm_ident.fitting.effect_plugins import catalogue_with
from lrm_ident.report.plots.arm import draw_arm
from lrm_math.arm.arm import BASE, TOOL
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import split_key
from lrm_math.errors import FileError, LrmError
from lrm_math.model.model import Model, model_of
from lrm_math.toml_file import schema_of

group = Typer(no_args_is_help=True, help="Describe an arm: from a URDF, to a corrected URDF or MJCF, by hand.")
app.add_typer(group, name="arm")
arm_command = command_of(group)

UrdfPath = Annotated[Path, Argument(metavar="URDF", help="A URDF, or a .xacro (needs the package xacrodoc).")]
Base = Annotated[str | None, Option("--base", metavar="LINK", help="Where the arm begins. Default: the root link.")]
Tip = Annotated[str | None, Option("--tip", metavar="LINK", help="The link that is measured. Default: the only tip.")]


@command_of(group, "import")
def import_urdf(
    urdf: UrdfPath,
    output: Annotated[Path, Option("-o", "--output", metavar="ARM", help="Where to write the arm file (.toml).")],
    base: Base = None,
    tip: Tip = None,
    name: Annotated[str | None, Option(help="Name of the arm. Default: the robot's name in the URDF.")] = None,
    json: arg.JsonFile = None,
) -> None:
    """Make an arm file of a URDF, exact to round-off: joints, limits, masses and centres of mass.

    The arm is compared with the URDF's own kinematics at 200 random poses before it is written.
    """
    found = import_arm(read_urdf(urdf), base, tip, name)
    text = arm_text(
        found.arm,
        source=f"{urdf.name}, links {found.base} to {found.tip}",
        comments=(
            f"{found.arm.dof} joints of {urdf.name} from {found.base} to {found.tip}, angles 0 as there.",
            f"Its pose differs from the URDF's own kinematics by at most {found.difference:.1g} (m, rad).",
        ),
    )
    publish(arm_document(found.arm, found.difference), json)
    for words in found.notices:
        notice(words)
    write_text(output, text)
    show(f"Arm written to {output}")


@arm_command
def export(
    model: Annotated[str, Argument(metavar="MODEL", help="A model file written by fit, or an arm (as drawn).")],
    output: Annotated[Path, Option("-o", "--output", metavar="FILE", help="corrected.urdf, or .xml for MJCF.")],
    urdf: Annotated[
        Path | None, Option(metavar="URDF", help="The robot's own URDF: it is corrected, meshes and all.")
    ] = None,
    base: Base = None,
    tip: Tip = None,
    keep: Annotated[
        str,
        Option(
            help="base, tool or base,tool: these stay as drawn. Their errors are those of the tracker's (or camera's) "
            "frame and of the target's mount, if you measured with one."
        ),
    ] = "",
    effects_file: arg.EffectsFile = None,
) -> None:
    """Write a URDF that matches your arm, or an MJCF with its springs and its play.

    URDF: the rigid part of the model is in every <origin>, a zero offset is a turn about the joint's axis. What bends,
    and what depends on the angle or the load, stays in the model file. MJCF: a joint's compliance k is a position
    actuator with kp = 1/k, play an extra joint with a range.
    """
    the_model = _model(model, effects_file)
    places = [one_of("place to keep", word.strip(), (BASE, TOOL)) for word in keep.split(",") if word.strip()]
    if output.suffix in (".xml", ".mjcf"):
        if urdf or base or tip:
            raise LrmError("--urdf, --base and --tip are for a URDF; an MJCF is written from the model alone")
        file = mjcf(_as_drawn(the_model, places))
        write_text(output, file.text)
        show(f"MJCF written to {output}", *_missing(file.left_out))
        return
    if output.suffix != ".urdf":
        raise FileError(output, "", f"a {output.suffix or 'nameless'} file", "name it .urdf, or .xml for MJCF")
    robot = read_urdf(urdf) if urdf else bare_urdf(the_model.arm)
    rigid = rigid_part(the_model, places)
    text = corrected_urdf(rigid, robot, base, tip)
    difference = exported_difference(rigid, text, base, tip)
    write_text(output, text)
    show(
        f"URDF written to {output}; its kinematics and the model's rigid part differ by at most {difference:.1g} m",
        *_missing(left_out(the_model)),
    )


@command_of(group, "show")
def show_arm(
    arm: arg.ArmArgument,
    q: Annotated[str | None, Option(metavar="DEG,…", help="Joint angles for the picture. Default: all zero.")] = None,
    json: arg.JsonFile = None,
    figure: arg.FigureAndNumbers = None,
) -> None:
    """Look at an arm: its dimensions, masses, reach, gravity's torques, and (--figure) a picture."""
    the_arm = load_arm(arm)
    angles = np.zeros(the_arm.dof) if q is None else np.radians(parse_numbers("--q", q, "angles in deg by commas"))
    if angles.shape != (the_arm.dof,):
        raise LrmError(f"--q {q}: {len(angles)} angles, {the_arm.name} has {the_arm.dof} joints")
    publish(arm_document(the_arm, None, angles), json, figure, partial(draw_arm, the_arm, angles))


@arm_command
def new(
    output: Annotated[Path, Option("-o", "--output", metavar="ARM", help="Where to write the arm file (.toml).")],
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


def _as_drawn(model: Model, places: list[str]) -> Model:
    values = [
        0.0 if split_key(key)[0] == "offsets" and split_key(key)[1] in places else value
        for key, value in zip(model.keys, model.values.tolist(), strict=True)
    ]
    return model.with_values(values)


def _missing(effects: tuple[str, ...]) -> list[str]:
    return [f"Not in it: {', '.join(effects)}"] if effects else []
