"""`lrm-ident sockets`: a printed or drilled board in which the tip is held, instead of a tracker."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

from typer import Option

from lrm_ident.cli import arguments as arg
from lrm_ident.cli.arm_access import SO101
from lrm_ident.cli.command import command_group, command_of
from lrm_ident.cli.common import progress, show
from lrm_ident.data.atomic_write import write_bytes, write_text
from lrm_ident.data.measurement_file.conventions import metadata_of
from lrm_ident.data.measurement_file.write import metadata_toml
from lrm_ident.measuring.sockets.board import RAISED, SocketBoard
from lrm_ident.measuring.sockets.drill_plan import drill_plan
from lrm_ident.measuring.sockets.solid import stl
from lrm_math.arm.arm_file import MM, arm_name_for, load_arm
from lrm_math.arm.servo_settings import settings_tables
from lrm_math.errors import FileError, LrmError

BY_HAND_S = 30.0
"""That a touch takes by hand, with the moves of the board: 20 touches in ten minutes (docs/sockets.md)."""
sockets_command = command_of(command_group("sockets", "Measure by holding the tip in sockets; no tracker."))


@sockets_command
def board(
    output: Annotated[
        Path,
        Option("-o", "--output", metavar="STL|PDF", help="Where to write it: .stl to print, .pdf to drill a plate."),
        arg.CompanionFiles({".toml": "metadata"}),
    ],
    length_mm: Annotated[float, Option(help="Distance from socket A to B, and from D to C.")] = 160.0,
    width_mm: Annotated[float, Option(help="Distance from socket A to D, and from B to C.")] = 130.0,
    raised_mm: Annotated[float, Option(help="Height of socket E over the others; 0: none (a drilled plate).")] = 60.0,
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


@sockets_command
def plan(
    output: Annotated[Path, Option("-o", "--output", metavar="CSV", help="Where to write the touches to make.")],
    board: Annotated[
        Path | None,
        Option(metavar="TOML", help="The file that sockets board wrote. Default: the board of its default size."),
    ] = None,
    arm: arg.ServoArm = SO101,
    count: Annotated[int, Option("-n", "--count", min=1, help="How many touches.")] = 24,
    placements: Annotated[int, Option(min=1, max=5, help="At how many placements of the board.")] = 3,
    noise_mm: Annotated[float, Option(min=1e-3, help="Noise of a touch per axis: how exactly the tip sits.")] = 0.2,
    seed: arg.Seed = 0,
) -> None:
    """Choose where to put the board and in which postures to touch it, before measuring."""
    from lrm_ident.measuring.sockets.touch_plan import plan_touches

    board_metadata = None if board is None else metadata_of(board)
    if board is not None and (board_metadata is None or not board_metadata.points):
        raise FileError(board, "", "states no [points]", "give the file that sockets board wrote")
    points = SocketBoard().points if board_metadata is None or board_metadata.points is None else board_metadata.points
    described = load_arm(arm)
    with progress("trying placements") as tick:
        planned = plan_touches(described, points, count, placements, noise_mm * MM, seed, tick)
    show(f"{count} touches of {described.name} at {placements} placements. Put the board:")
    for number, placement in enumerate(planned.placements, start=1):
        show(f"  placement {number} ({planned.placement.count(number)} touches): {placement.words}")
    show(
        f"Expected error of the tip: {planned.tip_error / MM:.2f} mm RMS by the noise of {noise_mm:g} mm per axis "
        f"(random postures at these placements: {planned.random_tip_error / MM:.2f} mm; a tracker of this noise: "
        f"{planned.tracker_error / MM:.2f} mm).",
        "By number of touches (-n): "
        + "; ".join(
            f"{touches}: {error / MM:.2f} mm, {touches * BY_HAND_S / 60.0:.0f} min by hand"
            for touches, error in planned.error_of.items()
        )
        + ".",
    )
    write_text(output, planned.csv())
    show(
        f"The touches are in {output}: move near each posture, bring the tip into its socket, record.",
        "A board may stand 20 mm or 10 deg elsewhere: where it stood is identified.",
    )


@sockets_command
def record(
    output: Annotated[
        Path,
        Option(
            "-o", "--output", metavar="DATA", help="Where to write the touches. The command continues an existing file."
        ),
        arg.CompanionFiles({".toml": "metadata"}),
    ],
    robot: Annotated[str, Option(help="The servos: feetech:/dev/ttyACM0,ids=1-5 or dynamixel:/dev/ttyUSB0,ids=1-5.")],
    board: Annotated[
        Path | None,
        Option(metavar="TOML", help="The file with the places of the sockets, which sockets board wrote."),
    ] = None,
    arm: arg.ServoArm = SO101,
    points: Annotated[str, Option(help="Names of the sockets by commas. Default: those of the board.")] = "",
) -> None:
    """Record touches by hand: torque is off, you hold the tip in a socket, Enter reads the encoders."""
    from lrm_ident.measuring.campaign.session import BUSES
    from lrm_ident.measuring.servo_bus.servos import limp_bus
    from lrm_ident.measuring.sockets.by_hand import TouchLog, points_to_touch, record_touches

    kind = next((kind for kind in BUSES if robot.startswith(kind.prefix)), None)
    if kind is None:
        raise LrmError(f"--robot {robot}: should begin with {' or '.join(each.prefix for each in BUSES)}")
    described, board_metadata = load_arm(arm), None if board is None else metadata_of(board)
    if board is not None and (board_metadata is None or not board_metadata.points):
        raise FileError(board, "", "states no [points]", "give the file that sockets board wrote")
    places = {} if board_metadata is None else board_metadata.points or {}
    chosen = points_to_touch(points, [*places])
    with limp_bus(robot, kind, described) as servos:
        log = TouchLog(output, described.dof)
        if not output.with_suffix(".toml").exists():
            about: dict[str, object] = {
                "points": places or None,
                "distances": None if board_metadata is None else board_metadata.distances,
            }
            about["servos"] = settings_tables(servos.settings())
            text = metadata_toml(arm_name_for(arm, output.parent), f"sockets record: {robot}", **about)
            write_text(output.with_suffix(".toml"), text)
        count = record_touches(servos, log, chosen, input, show, time.sleep)
    show(f"{count} touches recorded; {log.count} are in {output}.", f"Next: lrm-ident fit {output} -o model.toml")
