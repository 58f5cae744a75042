"""Commands that get measurements: with the arm itself, through its daemon, or from a tracker's recording."""

from __future__ import annotations

import math
import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

from typer import Argument, Exit, Option

from lrm_ident.cli import arguments as arg
from lrm_ident.cli.command import command, stated_reading
from lrm_ident.cli.common import notice, one_of, show
from lrm_ident.cli.groups.lerobot import LEROBOT, SO101, import_lerobot
from lrm_ident.data.apply_reading import LENGTH_UNITS
from lrm_ident.data.atomic_write import write_text
from lrm_math.arm.arm_file import GRAM, load_arm
from lrm_math.errors import LrmError

if TYPE_CHECKING:
    from lrm_ident.measuring.campaign.run import CampaignProgress, CampaignResult
    from lrm_ident.measuring.campaign.session import OpenArm
    from lrm_math.arm.arm import Arm
    from lrmd.client import Rover

SERVOS = "lerobot:, feetech: and dynamixel:"
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
Take = Annotated[bool, Option("--take", help="Take the arm over if another client has it.")]


@command
def measure(
    poses: arg.PosesFile,
    tracker: TrackerName,
    output: Annotated[
        Path,
        Option("-o", "--output", metavar="DATA", help="Measurements; an interrupted file goes on."),
        arg.CompanionFiles(appended=True),
    ],
    robot: AnyRobot = "rover",
    connect: Connect = None,
    arm: arg.ArmName = None,
    tool: ToolTarget = 1,
    base: BaseTarget = 0,
    pause: Pause = 15.0,
    settle: Settle = 0.5,
    dwell: Dwell = 1.0,
    load_command: LoadCommand = None,
    until: Annotated[
        str | None,
        Option(metavar="LENGTH", help="Adaptive: until the held-out error is surely below this, such as 0.6mm."),
    ] = None,
    explain: Annotated[
        bool, Option("--explain", help="Adaptive: until what is missing has a name, and nothing is missing any more.")
    ] = False,
    take: Take = False,
    speed: Speed = None,
    release: Release = False,
) -> None:
    """Drive the arm through POSES and measure its tip at each: DATA, one row as soon as it is known.

    The arm must be armed. It takes planned ways, and pauses when a servo is warm. A rest in which a target is hidden,
    the tracker is frozen, or a frame lies far off is repeated. Interrupted, it holds; the same command goes on.

    With LeRobot (put the arm down before: connecting switches torque off for a moment) or bare servos (they
    get torque where they stand) ways are straight, at 30 deg/s: keep them free of anything. Ctrl-C holds; so does
    Ctrl-\\ with bare servos, and then takes their torque if told to (--release, or the answer to its question).

    Adaptive (--until, --explain), it takes the most informative of POSES: after every batch it fits, diagnoses, and
    chooses the next ones, until that is enough; some are measured twice.
    """
    from lrm_ident.design.adaptive_batch import StoppingGoal
    from lrm_ident.measuring.campaign.plan import load_plan
    from lrm_ident.measuring.campaign.run import PoseTiming
    from lrm_ident.measuring.campaign.session import CampaignOrder, connected
    from lrm_ident.measuring.campaign.session import measure as run
    from lrm_ident.measuring.tracker.frames import TargetNumbers
    from lrm_ident.measuring.tracker.source import IN_ARM_FRAME

    signal.signal(signal.SIGTERM, end)
    goal = StoppingGoal(None if until is None else _length(until), explain) if until or explain else None
    numbers = TargetNumbers(tool, None if base < 0 or tracker.startswith(IN_ARM_FRAME) else base)
    daemon = daemon_of(robot, connect, speed)
    with daemon or nullcontext():
        name = arm or (SO101 if daemon is None else daemon.info().arm)
        the_arm = load_arm(name)
        plan = load_plan(poses, the_arm)
        drive = drive_of(daemon, take, robot, the_arm, speed, "lrm-ident measure", release)
        track = partial(connected, daemon, tracker, numbers)
        timing = PoseTiming(pause, settle, dwell)
        order = CampaignOrder(drive, track, tracker, numbers, the_arm, name, timing, _loads(load_command), _say, show)
        try:
            result = run(order, plan, output, goal)
        except (KeyboardInterrupt, SystemExit) as stop:
            show(f"stopped; {state_after(stop)}. What is measured is in {output}; the same command goes on")
            raise Exit(1) from None
    _conclude(result, len(plan.poses) if goal is None else None, output)


def photo_poses(
    plan_file: Path, arm: Arm, robot: str, servos: PhotoDrive, take: Callable[[int], object], driven: Path
) -> None:
    """Drives an arm through poses, a photo taken at each; `driven`: gets the angles commanded. Raises `LrmError`."""
    from lrm_ident.measuring.campaign.photo_poses import PhotographedPoses, PhotoOrder, photograph
    from lrm_ident.measuring.campaign.plan import load_plan
    from lrm_ident.measuring.campaign.run import PoseTiming
    from lrm_ident.measuring.campaign.session import RealClock

    signal.signal(signal.SIGTERM, end)
    plan = load_plan(plan_file, arm)
    daemon = daemon_of(robot, servos.connect, servos.speed)

    def keep(so_far: PhotographedPoses) -> None:
        """Writes the poses."""
        write_text(driven, so_far.csv())
        if len(so_far.poses) % 10 == 0:
            show(f"[{len(so_far.poses)}/{len(plan.poses)}] photos")

    with daemon or nullcontext():
        drive = drive_of(daemon, servos.take, robot, arm, servos.speed, "lrm-ident camera read", servos.release)
        timing, loads = PoseTiming(0.0, servos.settle), _loads(servos.load_command)
        try:
            photograph(PhotoOrder(drive, arm, RealClock(), timing, loads, take, keep, show), plan.poses)
        except (KeyboardInterrupt, SystemExit) as stop:
            show(f"stopped; {state_after(stop)}. The photos so far are in {driven.parent}, their poses in {driven}")
            raise Exit(1) from None
    if not driven.exists():
        raise LrmError("no pose could be driven to")


@dataclass(frozen=True)
class PhotoDrive:
    """Options by which an arm is driven for photos."""

    connect: str | None
    settle: float
    speed: float | None
    load_command: str | None
    take: bool
    release: bool


def daemon_of(robot: str, connect: str | None, speed: float | None, model: Path | None = None) -> Rover | None:
    """The connection with a daemon, None for servos without one. Raises `LrmError`: what only these take."""
    from lrm_ident.measuring.campaign.session import drives_servos
    from lrmd.client import Rover

    if drives_servos(robot):
        return None
    if speed is not None:
        raise LrmError(f"--speed: a daemon's arm moves at the speed of its lrmd.toml; it goes with {SERVOS}")
    if model is not None:
        raise LrmError(f"--model {model}: a daemon uses its own model (lrm deploy); it goes with {SERVOS}")
    return Rover(robot, connect.split(",") if connect else None)


def state_after(stop: BaseException) -> str:
    """State of the arm after an interruption, in words."""
    return "its torque is released" if getattr(stop, "released", False) else "the arm holds"


def drive_of(
    daemon: Rover | None, take: bool, robot: str, arm: Arm, speed: float | None, client: str, release: bool = False
) -> OpenArm:
    """Opens the arm of a daemon, or of servos without one. `release`: the person said so before (`release_key`)."""
    from lrm_ident.measuring.campaign.servo_arm import SPEED
    from lrm_ident.measuring.campaign.session import BUSES, by_daemon, by_servos

    if release and not robot.startswith(tuple(kind.prefix for kind in BUSES)):
        raise LrmError(f"--release: it goes with {' and '.join(kind.prefix for kind in BUSES)}")
    if daemon is not None:
        return by_daemon(daemon, take, client)
    rate = SPEED if speed is None else math.radians(speed)
    return by_servos(robot, arm, rate, lambda: True) if release else by_servos(robot, arm, rate)


def _length(text: str) -> float:
    """A length with its unit, such as `0.6mm`, in m. Raises `LrmError`."""
    found = re.fullmatch(r"\s*(\d+(?:\.\d*)?|\.\d+)\s*(um|mm|cm|m)\s*", text)
    if found is None or not float(found[1]) > 0.0:
        raise LrmError(f"--until {text}: should be a length with its unit, such as 0.6mm")
    return float(found[1]) * LENGTH_UNITS[found[2]]


def _conclude(result: CampaignResult, total: int | None, output: Path) -> None:
    for number, why in result.failed.items():
        show(f"not measured: pose {number}: {why}")
    again = f"; {result.repeated} unfit rests were repeated" if result.repeated else ""
    count = "what was measured is" if total is None else f"{total - len(result.failed)} of {total} poses are"
    show(f"{count} in {output}{again}")
    if result.failed:
        show("The same command tries those that are missing again.")


def _say(progress: CampaignProgress) -> None:
    if not (progress.notable or progress.done % 10 == 0):
        return
    left = f", about {_duration(progress.left)} left" if progress.left else ""
    count = f"{progress.done}/{progress.total}" if progress.total else f"{progress.done}"
    show(f"[{count}] {progress.words}{left}")


def _duration(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 120.0 else f"{seconds / 60.0:.0f} min"


def _loads(load_command: str | None) -> Callable[[float], None]:
    def by_command(payload: float) -> None:
        """Runs the command with the load (g) as its last word."""
        words = [*shlex.split(load_command or ""), f"{payload / GRAM:.4g}"]
        done = subprocess.run(words, capture_output=True, text=True)
        if done.returncode:
            raise LrmError(f"--load-command: exit code {done.returncode} of {shlex.join(words)}: {done.stderr.strip()}")

    def by_person(payload: float) -> None:
        """Asks at the terminal for the load (kg), and waits."""
        if not sys.stdin.isatty():
            raise LrmError(f"a load of {payload / GRAM:g} g is wanted, and nobody to put it on: give --load-command")
        input(f"Put {payload / GRAM:g} g on the tool, then press Enter. ")

    if load_command:
        return by_command
    state = {"payload": 0.0}  # the first poses may need no load

    def when_changed(payload: float) -> None:
        """Asks only if the load differs from the last one (kg)."""
        if payload != state["payload"]:
            by_person(payload)
            state["payload"] = payload

    return when_changed


def end(*_: object) -> NoReturn:
    """Ends the program as an interruption does; for signals."""
    raise SystemExit(1)


@command
def import_(
    recording: Annotated[
        Path,
        Argument(
            metavar="RECORDING", help="CSV of OptiTrack Motive or Vicon, .mcap, or .mat with a position per pose."
        ),
    ],
    poses: Annotated[
        Path, Argument(metavar="POSES", help="What was driven to: a CSV as measure takes it, .mat, .txt, or .mcap.")
    ],
    output: Annotated[
        Path,
        Option("-o", "--output", metavar="DATA", help="Measurements; a .toml file beside them."),
        arg.CompanionFiles({".toml": "metadata"}),
    ],
    arm: arg.ArmName = None,
    tool: Annotated[str | None, Option(help="Name of the body at the tip; not needed if there is only one.")] = None,
    base: Annotated[str | None, Option(help="Name of the body at the base. Default: the room's frame.")] = None,
    every: Annotated[float | None, Option(min=0.1, help="Seconds from the end of one rest to the next.")] = None,
    first: Annotated[float | None, Option(min=0, help="End of the first rest, seconds from the first frame.")] = None,
    skip: Annotated[int, Option(min=0, help="Rests before the first pose; without --every they are looked for.")] = 0,
    dwell: Dwell = 1.0,
    axes: Annotated[str | None, Option(help="Which axes of the file are the arm's x, y, z: x,-z,y.")] = None,
    rotation: Annotated[str | None, Option(help="Of Vicon's RX, RY, RZ: helical or euler-xyz.")] = None,
) -> None:
    """Turn a tracker's recording into measurements: one row for each pose, its mean over the end of the rest.

    Rests are found where the tip stands still, or taken at regular times (--every, --first). A rest in which a body is
    hidden, frozen or jumps is left out, and said.

    An .mcap (extra: mcap) has bodies as topics of poses, or frames of tf; as POSES, its JointState at the rests counts.

    With the word lerobot for RECORDING, POSES is a LeRobot dataset (v3; extra: lerobot), and DATA becomes poses: the
    commanded angles of every rest and what the encoders read, for `camera read` or a tracker's recording.
    """
    if recording == Path(LEROBOT):
        import_lerobot(poses, output, arm, dwell)
        return
    from lrm_ident.data.measurement_file.metadata import arm_for
    from lrm_ident.measuring.recordings.imported import RecordingOrder, import_recording, write_measurements
    from lrm_ident.measuring.recordings.rests import RestTimes
    from lrm_ident.measuring.recordings.vicon_csv import ROTATIONS

    if (every is None) != (first is None):
        raise LrmError("--every and --first go together")
    times = None if every is None or first is None else RestTimes(first, every)
    kind = None if rotation is None else one_of("rotation", rotation, ROTATIONS)
    order = RecordingOrder(tool, base, times, skip, dwell, stated_reading({"axes": axes}).axes, kind)
    name, the_arm = arm_for(poses, arm)
    found = import_recording(recording, poses, the_arm, order)
    write_measurements(found, output, name, recording.name)
    for words in found.notices:
        notice(words)
    for number, why in found.left_out.items():
        show(f"left out: pose {number}: {why}")
    show(f"{len(found.tip)} of {len(found.tip) + len(found.left_out)} poses are in {output}")
