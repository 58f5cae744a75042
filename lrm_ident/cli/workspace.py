"""The command of the capability map (Conenna 2024, section 3.1)."""

from __future__ import annotations

from collections.abc import Sequence
from time import perf_counter
from typing import Annotated

import typer

from lrm_ident.cli.arguments import FigureFile, JsonFile
from lrm_ident.cli.common import app, log, out, progress
from lrm_ident.cli.identifiability import ArmArgument, check_apart, data_behind
from lrm_ident.data.atomic_write import write_text
from lrm_ident.progress import Tick
from lrm_ident.report import json_files
from lrm_ident.report.workspace import AS_IT_IS, Compared, print_reach, reach_json, reach_rows
from lrm_ident.workspace.arm_variants import Variant, variant
from lrm_ident.workspace.capability_map import Capability, capability, pose_solver
from lrm_ident.workspace.orientation_grid import directions as directions_round
from lrm_ident.workspace.orientation_grid import rotations
from lrm_ident.workspace.presets import study_of
from lrm_ident.workspace.voxel_grid import area_named, grid_around
from lrm_math.arm.arm_file import MM, load_arm
from lrm_math.collision.scene import Scene
from lrm_math.errors import LrmError
from lrm_math.ik.closed_form import ClosedForm

NOTHING = "none"


@app.command()
def reach(
    arm: ArmArgument,
    variants: Annotated[
        list[str] | None,
        typer.Option(
            "--variant",
            help="The arm with something changed: base_beta_deg=45, tool_z_mm=100, joint3_d_mm=50, link2+20mm; several "
            "changes of one variant by commas. May be given again. Default: the thesis's variants for lrm-rover, none "
            "for others; 'none' for the arm alone.",
        ),
    ] = None,
    areas: Annotated[
        list[str] | None,
        typer.Option(
            "--area",
            help="A box of space that matters: NAME=X:X,Y:Y,Z:Z in mm. May be given again; all rank the variants. "
            "Default: the ground behind the rover and its basket for lrm-rover, none for others.",
        ),
    ] = None,
    step_mm: Annotated[float, typer.Option(help="Edge of a cell of the grid.")] = 30.0,
    directions: Annotated[int, typer.Option(help="Directions of the tool in every cell: 12, 42, 92, 162, ….")] = 42,
    rolls: Annotated[int, typer.Option(help="Turns of the tool about each direction.")] = 4,
    collisions: Annotated[bool, typer.Option(help="Leave out poses in which the arm's shapes come too close.")] = True,
    margin_mm: Annotated[float | None, typer.Option(help="How close is too close. Default: the arm file's.")] = None,
    may_touch: Annotated[
        list[str] | None,
        typer.Option(
            "--may-touch",
            metavar="A:B",
            help="Two shapes that may touch. May be given again. Default: fingers:ground for lrm-rover.",
        ),
    ] = None,
    json: JsonFile = None,
    figure: FigureFile = None,
) -> None:
    """Map what an arm can reach: place by place, the share of all orientations its tool can take; compare variants.

    Every orientation in every cell of a grid goes through the inverse kinematics of the nominal arm.
    """
    check_apart(figure, json)
    if figure:
        from lrm_ident.plots.comparison import check_format  # matplotlib takes half a second to load

        check_format(figure)
    the_arm = load_arm(arm)
    usual = study_of(the_arm.name)
    compared = (Variant(AS_IT_IS, the_arm), *(variant(the_arm, words) for words in _said(variants, usual.variants)))
    boxes = tuple(area_named(words) for words in _said(areas, usual.areas))
    _check_names("--variant", [each.name for each in compared])
    _check_names("--area", [area.name for area in boxes])
    pairs = [_pair(words) for words in _said(may_touch, usual.may_touch)]
    tools = rotations(directions_round(directions), rolls)
    grid = grid_around([each.arm for each in compared], step_mm * MM)
    for area in boxes:
        grid.inside(area)
    looked_at = collisions and bool(the_arm.shapes.capsules)
    scenes = [Scene.of(each.arm, pairs) if looked_at else None for each in compared]
    margin = None if margin_mm is None else margin_mm * MM
    searched = [each.name for each in compared if not isinstance(pose_solver(each.arm), ClosedForm)]
    if collisions and not looked_at:
        log.print(f"notice: the file of {the_arm.name} has no shapes: collisions are not looked at")
    if searched:
        log.print(
            f"notice: no closed form for '{searched[0]}': {len(grid) * directions * rolls:,} goals are searched "
            "for, tenths of a second each; take larger cells and fewer directions"
        )
    maps: list[Capability] = []
    started = perf_counter()
    with progress("solving goals") as tick:
        for number, (each, scene) in enumerate(zip(compared, scenes, strict=True)):
            maps.append(capability(each.arm, grid, tools, scene, margin, _part(tick, number, len(compared))))
    orientations = directions * rolls
    found = Compared(compared, tuple(maps), boxes, orientations, looked_at, perf_counter() - started)
    print_reach(out, found)
    if json:
        write_text(json, json_files.text(reach_json(found)))
    if figure:
        from lrm_ident.plots.workspace import draw_reach

        draw_reach(found, figure)
        data_behind(figure, reach_rows(found))


def _said(given: list[str] | None, usual: Sequence[str]) -> list[str]:
    """What was asked for, or what is usual; nothing if the word is 'none'."""
    return [words for words in (usual if given is None else given) if words.strip() != NOTHING]


def _part(tick: Tick, number: int, of: int) -> Tick:
    """Progress of one map among several as large."""
    return lambda done, goals: tick(number * goals + done, of * goals)


def _check_names(option: str, names: Sequence[str]) -> None:
    for name in names:
        if names.count(name) > 1:
            raise LrmError(f"{option} {name} is given twice")


def _pair(words: str) -> tuple[str, str]:
    one, colon, other = (part.strip() for part in words.partition(":"))
    if not (one and colon and other):
        raise LrmError(f"--may-touch {words}; should be two shapes, for instance fingers:ground")
    return one, other
