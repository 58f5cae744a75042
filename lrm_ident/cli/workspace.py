"""The command of the capability map (Conenna 2024, section 3.1)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from time import perf_counter
from typing import Annotated

from typer import Option

from lrm_ident.cli import arguments as arg
from lrm_ident.cli.command import command
from lrm_ident.cli.common import notice, progress, publish
from lrm_ident.design.workspace.arm_variants import ArmVariant, parse_variant
from lrm_ident.design.workspace.capability_map import CapabilityMap, capability_map, pose_solver
from lrm_ident.design.workspace.orientation_grid import directions as directions_round
from lrm_ident.design.workspace.orientation_grid import rotations
from lrm_ident.design.workspace.voxel_grid import default_study, grid_around, parse_area
from lrm_ident.fitting.progress import OnProgress
from lrm_ident.report.plots.workspace import draw_reach
from lrm_ident.report.workspace import AS_IT_IS, VariantComparison, reach_document
from lrm_math.arm.arm_file import MM, load_arm
from lrm_math.collision.scene import Scene
from lrm_math.errors import LrmError

NOTHING = "none"


@command
def reach(
    arm: arg.ArmArgument,
    variants: Annotated[
        list[str] | None,
        Option(
            "--variant",
            help="The arm with something changed: base_beta_deg=45, tool_z_mm=100, joint3_d_mm=50, link2+20mm. "
            "Separate several changes by commas; repeat the option for several variants. 'none': the arm alone. "
            "Default: the thesis's variants for lrm-rover, none for others.",
        ),
    ] = None,
    areas: Annotated[
        list[str] | None,
        Option(
            "--area",
            help="A box in which the tool has work to do: NAME=X:X,Y:Y,Z:Z in mm. Repeat the option for several. "
            "Default: the ground behind the rover and its basket for lrm-rover, none for others.",
        ),
    ] = None,
    step_mm: Annotated[float, Option(help="Edge of a cell of the grid.")] = 20.0,
    directions: Annotated[int, Option(help="Directions of the tool in every cell: 12, 42, 92, 162, ….")] = 42,
    rolls: Annotated[int, Option(help="Turns of the tool about each direction.")] = 4,
    collisions: Annotated[bool, Option(help="Leave out poses in which the arm's shapes come too close.")] = True,
    margin_mm: Annotated[
        float | None, Option(help="Smallest distance between two shapes. Default: that of the arm file.")
    ] = None,
    may_touch: Annotated[
        list[str] | None,
        Option(
            "--may-touch",
            metavar="A:B",
            help="Two shapes that may touch; repeat the option for several. Default: fingers:ground for lrm-rover.",
        ),
    ] = None,
    json: arg.JsonFile = None,
    figure: arg.FigureAndNumbers = None,
) -> None:
    """Map the workspace of an arm: for each place the share of orientations that its tool can take; compare variants.

    Every orientation in every cell of a grid goes through the inverse kinematics of the nominal arm.
    """
    the_arm = load_arm(arm)
    usual = default_study(the_arm.name)
    changed = _given_or_default(variants, usual.variants)
    compared = (ArmVariant(AS_IT_IS, the_arm), *(parse_variant(the_arm, words) for words in changed))
    boxes = tuple(parse_area(words) for words in _given_or_default(areas, usual.areas))
    _check_names("--variant", [each.name for each in compared])
    _check_names("--area", [area.name for area in boxes])
    pairs = [_pair(words) for words in _given_or_default(may_touch, usual.may_touch)]
    tools = rotations(directions_round(directions), rolls)
    grid = grid_around([each.arm for each in compared], step_mm * MM)
    for area in boxes:
        grid.inside(area)
    checked = collisions and bool(the_arm.shapes.capsules)
    scenes = [Scene.of(each.arm, pairs) if checked else None for each in compared]
    margin = None if margin_mm is None else margin_mm * MM
    searched = [each.name for each in compared if pose_solver(each.arm).form is None]
    if collisions and not checked:
        notice(f"the file of {the_arm.name} has no shapes: collisions are not looked at")
    if searched:
        notice(
            f"no closed form for '{searched[0]}': {len(grid) * directions * rolls:,} goals are searched "
            "for, a tenth of a millisecond each; take larger cells and fewer directions"
        )
    maps: list[CapabilityMap] = []
    started = perf_counter()
    with progress("solving goals") as tick:
        for number, (each, scene) in enumerate(zip(compared, scenes, strict=True)):
            maps.append(capability_map(each.arm, grid, tools, scene, margin, _part(tick, number, len(compared))))
    seconds = perf_counter() - started
    comparison = VariantComparison(compared, tuple(maps), boxes, directions * rolls, checked, seconds)
    publish(reach_document(comparison), json, figure, partial(draw_reach, comparison))


def _given_or_default(given: list[str] | None, usual: Sequence[str]) -> list[str]:
    """The words given, else the arm's usual ones; nothing if the word is 'none'."""
    return [words for words in (usual if given is None else given) if words.strip() != NOTHING]


def _part(tick: OnProgress, number: int, of: int) -> OnProgress:
    """Progress of one map among several as large."""
    return lambda done, goals: tick(number * goals + done, of * goals)


def _check_names(option: str, names: Sequence[str]) -> None:
    for name in names:
        if names.count(name) > 1:
            raise LrmError(f"{option} {name} is given twice")


def _pair(words: str) -> tuple[str, str]:
    first, colon, other = (part.strip() for part in words.partition(":"))
    if not (first and colon and other):
        raise LrmError(f"--may-touch {words}; should be two shapes, for instance fingers:ground")
    return first, other
