"""Commands that drive the arm: to measure its tip at poses, to have photos taken, to see where it lands at goals."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

from lrm_ident.cli import arguments as arg
from lrm_ident.cli.arm_access import ArmAccess, load_changer, resumable, target_numbers
from lrm_ident.cli.command import command
from lrm_ident.cli.common import notice, publish, show
from lrm_ident.data.atomic_write import write_text
from lrm_ident.data.measurement_file.conventions import LENGTH_UNITS
from lrm_math.arm.arm_file import GRAM
from lrm_math.arm.servo_settings import require_same_settings
from lrm_math.errors import FileError, LrmError
from lrm_math.model.model_file import settings_of_model

if TYPE_CHECKING:
    from lrm_ident.measuring.campaign.plan import CampaignPlan
    from lrm_ident.measuring.campaign.run import CampaignProgress, CampaignResult, PoseTiming
    from lrm_math.arm.arm import Arm


AUTO = "auto"


@command
def measure(
    poses: arg.PosesFile,
    tracker: arg.TrackerName,
    output: Annotated[
        Path,
        Option(
            "-o",
            "--output",
            metavar="DATA",
            help="Where to write the measurements. The command continues an interrupted file.",
        ),
        arg.CompanionFiles(appended=True),
    ],
    robot: arg.AnyRobot = "rover",
    connect: arg.Connect = None,
    arm: arg.DrivenArm = None,
    tool: arg.ToolTarget = 1,
    base: arg.BaseTarget = 0,
    pause: arg.Pause = 15.0,
    settle: Annotated[
        str,
        Option(
            metavar="SECONDS|auto",
            help="Seconds that the arm stands at least, before the averaging. auto: as long as the tip swings by the "
            "daemon's motion model, in place of --pause.",
        ),
    ] = "0.5",
    dwell: arg.Dwell = 1.0,
    load_command: arg.LoadCommand = None,
    until: Annotated[
        str | None,
        Option(metavar="LENGTH", help="Stop when the held-out error is below this with 95 % certainty, such as 0.6mm."),
    ] = None,
    explain: Annotated[
        bool, Option("--explain", help="Stop when nothing is missing any more and each added effect has one name.")
    ] = False,
    take: arg.Take = False,
    speed: arg.Speed = None,
    release: arg.Release = False,
    accept: arg.AcceptSettings = False,
    motion: Annotated[
        Path | None,
        Option(
            metavar="MOTION",
            help="A motion model of the arm (lrm-ident motion auto): wait as long as it says that the tip swings, in "
            "place of --pause.",
        ),
    ] = None,
    orientation: Annotated[
        bool, Option("--orientation", help="Also write the orientation of the tool's target, for fit to use.")
    ] = False,
) -> None:
    """Drive the arm through POSES and measure its tip at each. Every row is on disk before the arm moves on.

    Arm the robot first. The daemon plans collision-free ways, and pauses when a servo is warm. A measurement with a
    hidden target, a frozen tracker or a far outlier is repeated. If interrupted, the arm holds; type the same command
    again to continue.

    With LeRobot or bare servos the arm moves in straight lines at 30 deg/s: keep the way free. Put it down before
    LeRobot connects, which switches torque off for a moment. Bare servos get torque where they stand. Ctrl-C holds.
    With bare servos Ctrl-\\ holds too, and then asks whether to release the torque.

    With --until or --explain the command measures only as many of POSES as needed, the most informative first. After
    every batch it fits, diagnoses, and chooses the next poses. It measures some of them twice.
    """
    from lrm_ident.design.adaptive_batch import StoppingGoal
    from lrm_ident.measuring.campaign.duration import pose_durations
    from lrm_ident.measuring.campaign.plan import load_plan
    from lrm_ident.measuring.campaign.run import PredictedSettling
    from lrm_ident.measuring.campaign.session import CampaignOrder, check_tracker, connected
    from lrm_ident.measuring.campaign.session import measure as run

    check_tracker(tracker, robot)
    goal = StoppingGoal(None if until is None else _length(until), explain) if until or explain else None
    numbers, timing = target_numbers(tool, base, tracker), _timing(pause, settle, dwell, motion)
    with ArmAccess(robot, connect, speed, take, release).connection(arm, "lrm-ident measure") as link:
        plan, track = load_plan(poses, link.arm), partial(connected, link.daemon, tracker, numbers)
        if motion is not None:
            timing = _settled(motion, link.arm, plan, timing, speed)
        notice(*plan.notices)
        if goal is None and not isinstance(timing, PredictedSettling):
            each = pose_durations(plan.poses, timing, link.rates)
            least = f", at least {timing.pause:g} s each (--pause)" if timing.pause else ""
            longer = int((each > timing.pause).sum()) if timing.pause else 0
            held = f", {longer} of them longer (a long way, or hold_s)" if longer else ""
            show(f"{len(plan.poses)} poses{least}{held}: about {_duration(float(each.sum()))} for all, moves included")
        changer = load_changer(load_command)
        order = CampaignOrder(
            link.drive, track, tracker, numbers, link.arm, link.name, timing, changer, _say, show, accept, orientation
        )
        with resumable(f"What is measured is in {output}; the same command goes on"):
            result = run(order, plan, output, goal)
    conclude(result, len(plan.poses) if goal is None else None, output)


def _timing(pause: float, settle: str, dwell: float, motion: Path | None) -> PoseTiming:
    """The timing of the options; `settle`: seconds or auto. Raises `LrmError`."""
    from lrm_ident.measuring.campaign.run import PoseTiming, PredictedSettling

    if settle == AUTO:
        if motion is not None:
            raise LrmError("--settle auto asks the daemon's motion model; leave out --motion, or give seconds")
        show("Each stop lasts as long as the daemon says that the tip swings (--settle auto); no pause")
        return PredictedSettling(0.0, 0.0, dwell)
    try:
        seconds = float(settle)
    except ValueError:
        seconds = -1.0
    if not 0.0 <= seconds < 1e6:
        raise LrmError(f"--settle '{settle}': should be seconds, 0 or more, or auto")
    return PoseTiming(pause, seconds, dwell)


def _settled(motion: Path, arm: Arm, plan: CampaignPlan, timing: PoseTiming, speed: float | None) -> PoseTiming:
    """The timing without a pause, which waits as long as the plan's moves swing at most. Raises `FileError`."""
    from lrm_ident.measuring.motion.settling_times import longest, settling_times
    from lrm_math.motion.motion_model import load_motion

    model = load_motion(motion)[1]
    if model.arm != arm:
        raise FileError(motion, "arm", f"is a model of {model.arm.name}, not of {arm.name}")
    wait = longest(settling_times(model, [pose.q for pose in plan.poses], speed)).seconds
    show(f"The tip swings {wait:.2f} s at most after a move; each rest waits so long ({motion})")
    return replace(timing, pause=0.0, settle=max(timing.settle, wait))


def photo_poses(
    plan_file: Path,
    arm: str,
    access: ArmAccess,
    take: Callable[[int], object],
    driven: Path,
    settle: float,
    load_command: str | None,
) -> None:
    """Drives an arm through poses, a photo taken at each; `driven`: gets the angles commanded. Raises `LrmError`."""
    from lrm_ident.measuring.campaign.photo_poses import PhotoCampaign, PhotographedPoses
    from lrm_ident.measuring.campaign.plan import lightest, load_plan
    from lrm_ident.measuring.campaign.real_clock import RealClock
    from lrm_ident.measuring.campaign.run import PoseTiming

    with access.connection(arm, "lrm-ident camera read") as link:
        plan = load_plan(plan_file, link.arm)
        notice(*plan.notices)

        def keep(so_far: PhotographedPoses) -> None:
            """Writes the poses."""
            write_text(driven, so_far.csv())
            if len(so_far.poses) % 10 == 0:
                show(f"[{len(so_far.poses)}/{len(plan.poses)}] photos")

        timing, clock, rest = PoseTiming(0.0, settle), RealClock(), lightest(plan.poses, link.arm)
        stopped = resumable(f"The photos so far are in {driven.parent}, their poses in {driven}")
        with stopped, link.drive(clock, load_changer(load_command)) as opened:
            PhotoCampaign(opened.arm, clock, timing, rest, take, keep, show).run(plan.poses)
    if not driven.exists():
        raise LrmError("no pose could be driven to")


def _length(text: str) -> float:
    """A length with its unit, such as `0.6mm`, in m. Raises `LrmError`."""
    match = re.fullmatch(r"\s*(\d+(?:\.\d*)?|\.\d+)\s*(um|mm|cm|m)\s*", text)
    if match is None or not float(match[1]) > 0.0:
        raise LrmError(f"--until {text}: should be a length with its unit, such as 0.6mm")
    return float(match[1]) * LENGTH_UNITS[match[2]]


def conclude(result: CampaignResult, total: int | None, output: Path) -> None:
    """Says what was measured, and which poses were not. Raises `LrmError` if none was."""
    if result.failed and len(result.failed) == total:
        raise LrmError(f"no pose was measured; {next(iter(result.failed.values()))}")
    for number, why in result.failed.items():
        show(f"not measured: pose {number}: {why}")
    again = f"; {result.repeated} unfit stops were measured again" if result.repeated else ""
    count = "what was measured is" if total is None else f"{total - len(result.failed)} of {total} poses are"
    show(f"{count} in {output}{again}")
    if result.failed:
        show("The same command tries those that are missing again.")


def _say(progress: CampaignProgress) -> None:
    if not (progress.notable or progress.done % 10 == 0):
        return
    remaining = f", about {_duration(progress.left)} left" if progress.left else ""
    count = f"{progress.done}/{progress.total}" if progress.total else f"{progress.done}"
    show(f"[{count}] {progress.words}{remaining}")


def _duration(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 120.0 else f"{seconds / 60.0:.0f} min"


@command
def verify(
    tracker: arg.TrackerName,
    robot: arg.AnyRobot = "rover",
    connect: arg.Connect = None,
    goals: Annotated[
        str,
        Option(help="Number of random goals, or a CSV of x_mm, y_mm, z_mm (and qw, qx, qy, qz), or hole-to-basket."),
    ] = "50",
    arm: arg.DrivenArm = None,
    payload_g: Annotated[float, Option(min=0, help="Load that the tool carries.")] = 0.0,
    seed: Annotated[int, Option(help="Seed of the random goals: use the same before and after.")] = 0,
    before: Annotated[
        Path | None, Option(metavar="JSON", help="An earlier result (--json) with another model, to compare with.")
    ] = None,
    tool: arg.ToolTarget = 1,
    base: arg.BaseTarget = 0,
    settle: arg.Settle = 0.5,
    dwell: arg.Dwell = 1.0,
    take: arg.Take = False,
    model: Annotated[
        Path | None,
        Option(metavar="MODEL", help="Model that corrects the commands, without a daemon. Default: the nominal arm."),
    ] = None,
    speed: arg.Speed = None,
    accept: arg.AcceptSettings = False,
    json: arg.JsonFile = None,
) -> None:
    """Send the tip to goals through inverse kinematics with a model, and measure where it lands.

    Uses the daemon's model, or --model with LeRobot or bare servos. Prints the measured error beside the predicted
    one: rounding to counts, the uncertainty of the model, and the error that it left at the poses of its fit.
    """
    from lrm_ident.measuring.campaign.real_clock import RealClock
    from lrm_ident.measuring.campaign.run import PoseTiming
    from lrm_ident.measuring.campaign.session import check_tracker, connected
    from lrm_ident.measuring.verification.goal_run import GoalRun
    from lrm_ident.measuring.verification.goals import goals_named
    from lrm_ident.measuring.verification.report import read_verification, verification_document

    check_tracker(tracker, robot)
    earlier = None if before is None else read_verification(before)
    numbers, clock, timing = target_numbers(tool, base, tracker), RealClock(), PoseTiming(0.0, settle, dwell)
    with ArmAccess(robot, connect, speed, take, model=model).connection(arm, "lrm-ident verify") as link:
        wanted = goals_named(goals, link.arm, seed)
        with connected(link.daemon, tracker, numbers) as opened, link.drive(clock, lambda _: None) as driven:
            parts = (link.arm, opened, numbers, clock, timing, payload_g * GRAM)
            if model is not None and not accept:
                require_same_settings(driven.settings, settings_of_model(model), str(model), "--accept it")
            run = GoalRun(driven.arm, driven.solver(model), *parts)
            visited = run.visit(wanted, lambda number, words: show(f"[{number}/{len(wanted)}] {words}"))
    publish(verification_document(visited, earlier), json)
