"""Connects a campaign to a daemon and a tracker; one whose datagrams come on a zenoh key too."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeAlias

from lrm_ident.design.adaptive_batch import StoppingGoal
from lrm_ident.measuring.campaign.adaptive import AdaptiveCampaign
from lrm_ident.measuring.campaign.data_file import DataFile, PowerOn
from lrm_ident.measuring.campaign.lerobot_robot import KIND as LEROBOT
from lrm_ident.measuring.campaign.lerobot_robot import LeRobotServos, connected_robot
from lrm_ident.measuring.campaign.plan import CampaignPlan, lightest
from lrm_ident.measuring.campaign.real_clock import RealClock
from lrm_ident.measuring.campaign.rover_arm import APPROACH, DaemonSolver, RoverArm
from lrm_ident.measuring.campaign.run import (
    CampaignArm,
    CampaignProgress,
    CampaignResult,
    Clock,
    PoseCampaign,
    PoseTiming,
)
from lrm_ident.measuring.campaign.servo_arm import ServoArm, Servos
from lrm_ident.measuring.servo_bus.dynamixel import DYNAMIXEL
from lrm_ident.measuring.servo_bus.feetech import FEETECH
from lrm_ident.measuring.servo_bus.servos import connected_bus, release_key
from lrm_ident.measuring.tracker.dtrack import parse_dtrack
from lrm_ident.measuring.tracker.frames import TargetNumbers, Tracker, TrackerFrame
from lrm_ident.measuring.tracker.source import OpenTracker, open_tracker, tracker_named
from lrm_ident.measuring.verification.goal_commands import GoalSolver, ModelSolver
from lrm_math.arm.arm import Arm
from lrm_math.arm.servo_settings import ServoSettings, require_same_settings, settings_tables
from lrm_math.errors import LrmError
from lrmd.client import Rover

BUSES = (FEETECH, DYNAMIXEL)
"""Kinds of servos that are driven without anything between."""
SERVOS_OFF = {"disarmed", "estop", "fault"}
"""Modes without pulses: servos that are switched on again may stand elsewhere, which is a new session."""

FIRST_FRAME_S, LOOK_S = 15.0, 0.25
"""s: how long to wait for the first frame, by how much at a time."""
MOST_FRAMES = 100_000
"""Frames that are kept of one rest."""


@dataclass(frozen=True)
class DrivenArm:
    """An arm that is ready to be driven. `robot`: its name. `start`: commanded angles (rad).

    `power_on`: gives the servos' present power-on session. `solver`: gives its inverse kinematics; without a daemon
    with the model of a file, or of the arm as drawn.
    `approach`: how far (rad) beside a pose it stands before it comes straight from there, None where it may go round.
    `settings`: of its servos, None where they have none.
    """

    arm: CampaignArm
    robot: str
    start: tuple[float, ...]
    power_on: Callable[[], PowerOn]
    solver: Callable[[Path | None], GoalSolver]
    approach: float | None = None
    settings: ServoSettings | None = None


Loads: TypeAlias = Callable[[float], object]
"""Has somebody change the load (kg)."""
OpenArm: TypeAlias = Callable[[Clock, Loads], AbstractContextManager[DrivenArm]]


@dataclass(frozen=True)
class CampaignOrder:
    """Order of a campaign: what to measure with.

    `drive`, `track`: open the arm and the tracker, whose name is `tracker`. `arm_name` as the metadata will have it;
    `on_findings`: called with what is known after a batch, if measuring is adaptive. `accept`: whether rows may be
    added with other settings of the servos. `orientation`: whether the tool's orientation is written, too.
    """

    drive: OpenArm
    track: Callable[[], AbstractContextManager[Tracker]]
    tracker: str
    numbers: TargetNumbers
    arm: Arm
    arm_name: str
    timing: PoseTiming
    loads: Loads
    on_progress: Callable[[CampaignProgress], object]
    on_findings: Callable[[str], object]
    accept: bool = False
    orientation: bool = False


def measure(order: CampaignOrder, plan: CampaignPlan, output: Path, goal: StoppingGoal | None = None) -> CampaignResult:
    """Measures what is left of a plan into a file; with a goal, only as much as that needs.

    Raises `LrmError`; the file stays resumable.
    """
    file = DataFile(output, order.arm.dof, order.orientation)
    file.check_plan(plan.sha256)
    clock: Clock = RealClock()
    with order.track() as tracker, order.drive(clock, order.loads) as driven, file:
        first = first_frame(tracker, order.tracker)
        source = f"lrm-ident measure: {driven.robot}, {order.tracker}"
        start = [round(math.degrees(q), 6) for q in driven.start]
        beside = None if driven.approach is None else round(math.degrees(driven.approach), 6)
        about: dict[str, object] = {
            "start_q_deg": start,
            "approach_deg": beside,
            "poses_sha256": plan.sha256,
        }
        if file.head is not None and file.done and not order.accept:
            require_same_settings(driven.settings, file.head.servos, str(file.metadata), "--accept the mixture")
        about["servos"] = settings_tables(driven.settings or {}) or None
        driven.arm.session = file.begin(driven.power_on(), first.t, order.arm_name, source, **about)
        rest = lightest(plan.poses, order.arm)
        campaign = PoseCampaign(driven.arm, tracker, order.numbers, clock, order.timing, rest, order.on_progress)
        if goal is None:
            return campaign.run(plan.poses, file)
        return AdaptiveCampaign(campaign, order.arm, goal, order.on_findings).run(plan.poses, file)


@contextmanager
def by_daemon(rover: Rover, arm: Arm, take: bool, client: str, clock: Clock, loads: Loads) -> Iterator[DrivenArm]:
    """The arm of a daemon, its lease held meanwhile by a client of that name. Raises `LrmError`: it is another arm."""
    with rover.control(client, take):
        driven = RoverArm(rover, clock, loads, 1)
        if len(driven.names) != arm.dof:
            raise LrmError(f"{arm.name} has {arm.dof} joints, {driven.info.robot} has {len(driven.names)}")
        solver = DaemonSolver.of(rover)
        yield DrivenArm(driven, driven.info.robot, driven.commanded(), partial(power_on, rover), lambda _: solver)


@contextmanager
def by_servos(text: str, arm: Arm, speed: float, release: bool, clock: Clock, loads: Loads) -> Iterator[DrivenArm]:
    """The arm of bare servos (`connected_bus`) or of a robot of LeRobot (`connected_robot`), as the text names it.

    Every connection counts as a power-on session. `speed`: rad/s of the fastest joint. `release`: see `release_key`.
    """
    with ExitStack() as held:
        servos: Servos
        kind = next((kind for kind in BUSES if text.startswith(kind.prefix)), None)
        if kind is not None:
            servos = bare = held.enter_context(connected_bus(text, kind, arm))
            held.enter_context(release_key(bare, release))
        else:
            servos = LeRobotServos.of(held.enter_context(connected_robot(text)), arm)
        held.enter_context(torque_named(servos))
        driven = ServoArm(servos, arm, clock, loads, speed)
        session = PowerOn(f"{text.partition(':')[0]}-{time.time_ns()}")
        solver = partial(ModelSolver.of, arm=arm, rounded=driven.rounded)
        yield DrivenArm(driven, text, driven.seen(), lambda: session, solver, APPROACH, driven.settings())


@contextmanager
def torque_named(servos: Servos) -> Iterator[None]:
    """Adds to an error which joints have torque when it ends a campaign: servos hold whatever becomes of the host.

    All of them, where they do not answer.
    """
    try:
        yield
    except LrmError as error:
        on = list(servos.joints)
        with suppress(OSError, RuntimeError, LrmError):
            on = [joint for joint, powered in servos.powered().items() if powered]
        words = f"torque is on, as far as is known, at {', '.join(on)}" if on else "no joint has torque"
        raise LrmError(f"{error}; {words}") from error


def drives_servos(robot: str) -> bool:
    """Whether a text names servos of its own, and not a daemon."""
    return robot.startswith((*(kind.prefix for kind in BUSES), LEROBOT))


def first_frame(tracker: Tracker, name: str) -> TrackerFrame:
    """A frame of a tracker that may just be starting. Raises `LrmError`."""
    for _ in range(round(FIRST_FRAME_S / LOOK_S)):
        if seen := tracker.frames(LOOK_S):
            return seen[-1]
    raise LrmError(f"--tracker {name}: no frame within {FIRST_FRAME_S:g} s")


def check_tracker(tracker: str, robot: str) -> None:
    """Raises `LrmError`: no tracker has this name, or no file it names is there. Nothing is connected for that."""
    kind, _, rest = tracker.partition(":")
    if kind != "zenoh" or not rest:
        tracker_named(tracker)
    elif drives_servos(robot):
        raise LrmError(f"--tracker {tracker}: zenoh comes with a daemon, and --robot {robot} has none; dtrack:PORT")


def connected(rover: Rover | None, tracker: str, numbers: TargetNumbers) -> OpenTracker:
    """The tracker that a text names; those on zenoh come by the session with a rover. Raises `LrmError`."""
    kind, _, rest = tracker.partition(":")
    return ZenohTracker(rover, rest) if kind == "zenoh" and rest and rover else open_tracker(tracker, numbers)


def power_on(rover: Rover) -> PowerOn:
    """The servos' present power-on session, named by the daemon's boot id and the event in which they were last off."""
    modes = [event for event in rover.events() if event.code == "mode"]
    off = [event.seq for event in modes if SERVOS_OFF & {str(event.detail.get(key)) for key in ("before", "mode")}]
    heat = rover.thermal()
    return PowerOn(f"{rover.boot_id}-{max(off, default=0)}", heat.powered_s, heat.powered_at_c)


class ZenohTracker(AbstractContextManager["ZenohTracker"]):
    """Listens on a key; what is no frame is ignored."""

    def __init__(self, rover: Rover, key: str) -> None:
        self._frames: list[TrackerFrame] = []
        self._subscriber = rover.listen(key, self._received)

    def __exit__(self, *_: object) -> None:
        self._subscriber.undeclare()  # type: ignore[no-untyped-call]

    def frames(self, seconds: float) -> list[TrackerFrame]:
        """See `Tracker`."""
        self._frames = []
        time.sleep(seconds)
        return list(self._frames)

    def _received(self, data: bytes) -> None:
        frame = parse_dtrack(data)
        if frame is not None and len(self._frames) < MOST_FRAMES:
            self._frames.append(frame)
