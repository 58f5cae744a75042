"""`lrm-ident sockets`: a printed or drilled board in which the tip is held, instead of a tracker."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Option

from lrm_ident.cli import arguments as arg
from lrm_ident.cli.command import command_group, command_of
from lrm_ident.cli.common import show
from lrm_ident.data.atomic_write import write_bytes, write_text
from lrm_ident.measuring.sockets.board import RAISED, SocketBoard
from lrm_ident.measuring.sockets.drill_plan import drill_plan
from lrm_ident.measuring.sockets.solid import stl
from lrm_math.errors import LrmError

sockets_command = command_of(command_group("sockets", "Measure by holding the tip in sockets; no tracker."))


@sockets_command
def board(
    output: Annotated[
        Path,
        Option("-o", "--output", metavar="STL|PDF", help="Where to write it: .stl to print, .pdf to drill a plate."),
        arg.CompanionFiles({".toml": "metadata"}),
    ],
    length_mm: Annotated[float, Option(help="From socket A to B, and from D to C.")] = 120.0,
    width_mm: Annotated[float, Option(help="From socket A to D, and from B to C.")] = 80.0,
    raised_mm: Annotated[float, Option(help="Height of socket E over the others; 0: none (a drilled plate).")] = 25.0,
    opening_mm: Annotated[float, Option(help="Diameter of the cones of 90 deg.")] = 12.0,
    paper: Annotated[str, Option(help="a4 or letter, for a PDF.")] = "a4",
) -> None:
    """Write a board with conical sockets to print or to drill, and beside it where its sockets are (.toml)."""
    if output.suffix not in (".stl", ".pdf"):
        raise LrmError(f"{output}: should end in .stl (to print) or .pdf (to drill)")
    the_board = SocketBoard(length_mm, width_mm, raised_mm, opening_mm)
    drilled = output.suffix == ".pdf"
    the_board = the_board.flat if drilled else the_board
    content = drill_plan(the_board, paper) if drilled else stl(the_board)
    write_text(output.with_suffix(".toml"), the_board.metadata())
    write_bytes(output, content)
    distances = ", ".join(f"{pair} {value:.2f}" for pair, value in the_board.distances.items())
    names = ", ".join(the_board.points)
    show(
        f"Board with sockets {names} written to {output}, their places to {output.with_suffix('.toml')}.",
        "Drill it at the crosses, then countersink 90 deg."
        if drilled
        else f"Print it flat, 100 % size. One bump is beside A, two are at B; {RAISED} is on the post.",
        f"Nominal distances, mm: {distances}",
        "Measure them: put two equal balls into two sockets, measure over both with a caliper, subtract one diameter.",
        "Printed lengths are off by 0.2 to 0.5 %, and the arm by as much: state what you measured, as [distances].",
    )
