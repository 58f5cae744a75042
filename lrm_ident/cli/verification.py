"""The command that sends the tip to goals and measures where it lands."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Option

from lrm_ident.cli import arguments as arg
from lrm_ident.cli.arm_access import (
    AnyRobot,
    ArmAccess,
    BaseTarget,
    Connect,
    Dwell,
    Settle,
    Speed,
    Take,
    ToolTarget,
    TrackerName,
    target_numbers,
)
from lrm_ident.cli.command import command
from lrm_ident.cli.common import publish, show
from lrm_math.arm.arm_file import GRAM


@command
def verify(
    tracker: TrackerName,
    robot: AnyRobot = "rover",
    connect: Connect = None,
    goals: Annotated[
        str, Option(help="How many random goals; a CSV of x_mm, y_mm, z_mm to visit in order; or hole-to-basket.")
    ] = "50",
    arm: arg.ArmName = None,
    payload_g: Annotated[float, Option(min=0, help="What the tool carries.")] = 0.0,
    seed: Annotated[int, Option(help="Of the goals: the same goals before and after.")] = 0,
    before: Annotated[
        Path | None, Option(metavar="JSON", help="An earlier result (--json), of another model, to stand beside.")
    ] = None,
    tool: ToolTarget = 1,
    base: BaseTarget = 0,
    settle: Settle = 0.5,
    dwell: Dwell = 1.0,
    take: Take = False,
    model: Annotated[
        Path | None,
        Option(metavar="MODEL", help="Corrects the commands, without a daemon. Default: none, the arm as drawn."),
    ] = None,
    speed: Speed = None,
    json: arg.JsonFile = None,
) -> None:
    """Send the tip to goals through inverse kinematics with a model, and measure where it lands.

    The model is the one that the daemon uses; with LeRobot or bare Feetech servos that of --model. Beside the measured
    error stands what it predicts: rounding to counts, and the model's own uncertainty.
    """
    from lrm_ident.measuring.campaign.run import PoseTiming
    from lrm_ident.measuring.campaign.session import RealClock, connected
    from lrm_ident.measuring.verification.goal_run import GoalRun
    from lrm_ident.measuring.verification.goals import goals_named
    from lrm_ident.measuring.verification.report import read_verification, verification_document

    earlier = None if before is None else read_verification(before)
    numbers, clock, timing = target_numbers(tool, base, tracker), RealClock(), PoseTiming(0.0, settle, dwell)
    with ArmAccess(robot, connect, speed, take, model=model).connection(arm, "lrm-ident verify") as link:
        wanted = goals_named(goals, link.arm, seed)
        with connected(link.daemon, tracker, numbers) as opened, link.drive(clock, lambda _: None) as driven:
            parts = (link.arm, opened, numbers, clock, timing, payload_g * GRAM)
            run = GoalRun(driven.arm, driven.solver(model), *parts)
            found = run.visit(wanted, lambda number, words: show(f"[{number}/{len(wanted)}] {words}"))
    publish(verification_document(found, earlier), json)
