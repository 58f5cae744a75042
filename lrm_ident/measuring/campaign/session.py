"""Connects a campaign to a daemon and a tracker."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from lrm_ident.design.adaptive_batch import StoppingGoal
from lrm_ident.measuring.campaign.adaptive import AdaptiveCampaign
from lrm_ident.measuring.campaign.data_file import CampaignHead, DataFile
from lrm_ident.measuring.campaign.plan import CampaignPlan, lightest
from lrm_ident.measuring.campaign.rover_arm import RoverArm
from lrm_ident.measuring.campaign.run import CampaignProgress, CampaignResult, Clock, PoseCampaign, PoseTiming
from lrm_ident.measuring.campaign.zenoh_tracker import ZenohTracker
from lrm_ident.measuring.tracker.frames import TargetNumbers, Tracker, TrackerFrame
from lrm_ident.measuring.tracker.source import open_tracker
from lrm_math.arm.arm import Arm
from lrm_math.errors import LrmError
from lrmd.client import Rover

SERVOS_OFF = {"disarmed", "estop", "fault"}
"""Modes without pulses: servos that are switched on again may stand elsewhere, which is a new session."""

FIRST_FRAME_S, LOOK_S = 15.0, 0.25
"""s: how long to wait for the first frame, by how much at a time."""


class RealClock:
    """The computer's clock."""

    def now(self) -> float:
        """Monotonic time (s)."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Waits; not for a negative time."""
        time.sleep(max(0.0, seconds))


@dataclass(frozen=True)
class CampaignOrder:
    """Order of a campaign: what to measure with.

    `arm_name` as the metadata will have it; `loads`: has somebody change the load (kg); `on_findings`: called with what
    is known after a batch, if measuring is adaptive.
    """

    rover: Rover
    tracker: str
    numbers: TargetNumbers
    arm: Arm
    arm_name: str
    timing: PoseTiming
    loads: Callable[[float], object]
    on_progress: Callable[[CampaignProgress], object]
    on_findings: Callable[[str], object]
    take: bool = False


def measure(order: CampaignOrder, plan: CampaignPlan, output: Path, goal: StoppingGoal | None = None) -> CampaignResult:
    """Measures what is left of a plan into a file, holding the lease; with a goal, only as much as that needs.

    Raises `LrmError`; the file stays resumable.
    """
    file = DataFile(output, order.arm.dof)
    file.check_plan(plan.sha256)
    lease = order.rover.control("lrm-ident measure", order.take)
    with file, connected(order.rover, order.tracker, order.numbers) as tracker, lease:
        clock: Clock = RealClock()
        arm = RoverArm(order.rover, clock, order.loads, file.last_session)
        if len(arm.names) != order.arm.dof:
            raise LrmError(f"{order.arm_name} has {order.arm.dof} joints, {arm.info.robot} has {len(arm.names)}")
        first = first_frame(tracker, order.tracker)
        source = f"lrm-ident measure: {arm.info.robot}, {order.tracker}"
        start = tuple(order.rover.commanded_q())
        arm.session = file.begin(
            CampaignHead(order.arm_name, source, start, plan.sha256, first.t, power_on(order.rover))
        )
        rest = lightest(plan.poses, order.arm)
        campaign = PoseCampaign(arm, tracker, order.numbers, clock, order.timing, rest, order.on_progress)
        if goal is None:
            return campaign.run(plan.poses, file)
        return AdaptiveCampaign(campaign, order.arm, goal, order.on_findings).run(plan.poses, file)


def first_frame(tracker: Tracker, name: str) -> TrackerFrame:
    """A frame of a tracker that may just be starting. Raises `LrmError`."""
    for _ in range(round(FIRST_FRAME_S / LOOK_S)):
        if seen := tracker.frames(LOOK_S):
            return seen[-1]
    raise LrmError(f"--tracker {name}: no frame within {FIRST_FRAME_S:g} s")


@contextmanager
def connected(rover: Rover, tracker: str, numbers: TargetNumbers) -> Iterator[Tracker]:
    """The tracker that a text names. Raises `LrmError`."""
    kind, _, rest = tracker.partition(":")
    source = ZenohTracker(rover, rest) if kind == "zenoh" and rest else open_tracker(tracker, numbers)
    with source as opened:
        yield opened


def power_on(rover: Rover) -> str:
    """Name of the servos' present power-on session: the daemon's boot id, and the event in which they were last off."""
    modes = [event for event in rover.events() if event.code == "mode"]
    off = [event.seq for event in modes if SERVOS_OFF & {str(event.detail.get(key)) for key in ("before", "mode")}]
    return f"{rover.boot_id}-{max(off, default=0)}"
