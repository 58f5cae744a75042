"""A campaign: every pose that is not measured yet, one after the other, until all are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

from lrm_ident.data.wording import in_mm
from lrm_ident.measuring.campaign.data_file import ArmState, DataFile
from lrm_ident.measuring.campaign.plan import PlannedPose
from lrm_ident.measuring.tracker.dwell import RestMean, UnstableDwell, rest_mean
from lrm_ident.measuring.tracker.frames import TargetNumbers, Tracker, tip_position
from lrm_math.errors import LrmError

SIGHT_S, GLANCE_S = 3.0, 0.05
"""s: how long to wait until a tracker sees the targets after a motion, by how much at a time."""


class Unreachable(LrmError):
    """A pose to which there is no way, or that the daemon refuses; the campaign goes on without it."""


class CampaignArm(Protocol):
    """The arm as a campaign sees it. `session`: of the servos' power, for the rows."""

    session: int

    @property
    def settle_s(self) -> float | None:
        """How long after the last motion its tip swings (s); None where nobody knows."""

    def go(self, pose: PlannedPose) -> ArmState:
        """Moves there and waits. Raises `Unreachable`; other `LrmError`s end the campaign."""

    def commanded(self) -> tuple[float, ...]:
        """(n,), angles that are commanded now (rad)."""

    def disturbed(self) -> str:
        """Changes since `go`, so that the arm may not stand there any more, in words; empty if nothing has."""

    def too_warm(self) -> str:
        """The servo that is too warm to go on, in words; empty if none is."""

    def cool(self, rest: PlannedPose) -> None:
        """Goes to a pose that loads it little, and waits until it is cool."""

    @property
    def change_payload(self) -> Callable[[float], object]:
        """Has the payload changed (kg), by whoever does that."""


class Clock(Protocol):
    """Time: `now` in s, and `sleep`."""

    def now(self) -> float: ...
    def sleep(self, seconds: float) -> None: ...


@dataclass(frozen=True)
class PoseTiming:
    """Seconds: `pause` from one pose to the next, `settle` at least after a motion, `dwell` averaged at its end.

    `attempts`: how often a pose is tried whose rest is unfit.
    """

    pause: float = 15.0
    settle: float = 0.5
    dwell: float = 1.0
    attempts: int = 3

    def after_motion(self, arm: CampaignArm) -> PoseTiming:
        """The timing of the stop after the last motion of an arm."""
        return self


class PredictedSettling(PoseTiming):
    """A stop lasts as long as the arm says that its tip swings, and `settle` at least; no pause."""

    def after_motion(self, arm: CampaignArm) -> PoseTiming:
        """See `PoseTiming`. Raises `LrmError`: the arm does not know."""
        if arm.settle_s is None:
            right = "give --settle in seconds, or the daemon a motion model ([motion] model in lrmd.toml)"
            raise LrmError(f"--settle auto: this arm does not know how long its tip swings; {right}")
        return PoseTiming(0.0, max(self.settle, arm.settle_s), self.dwell, self.attempts)


def held(timing: PoseTiming, pose: PlannedPose) -> PoseTiming:
    """The timing of the stop at a pose that is to be held."""
    return replace(timing, settle=pose.hold) if pose.hold > timing.settle else timing


@dataclass(frozen=True)
class CampaignProgress:
    """Event at a pose: `words`; `done` of `total` poses are measured, the rest takes about `left` s.

    `notable`: something was not as it should be, or it is the first pose, which tells how long the others take.
    """

    words: str
    done: int
    total: int
    left: float
    notable: bool = False


@dataclass
class CampaignResult:
    """Numbers of the poses that could not be measured, with the reason; rests that were repeated."""

    failed: dict[int, str] = field(default_factory=dict)
    repeated: int = 0


@dataclass(frozen=True)
class PoseCampaign:
    """Parts that a campaign works with. `rest`: where the arm cools. Poses of `plan` that the file has are left out."""

    arm: CampaignArm
    tracker: Tracker
    numbers: TargetNumbers
    clock: Clock
    timing: PoseTiming
    rest: PlannedPose
    on_progress: Callable[[CampaignProgress], object]

    def run(self, plan: Sequence[PlannedPose], file: DataFile) -> CampaignResult:
        """Measures every pose of the plan that the file does not have, in order. Raises what ends it before."""
        result, payload, began = CampaignResult(), None, self.clock.now()
        done = set(file.done)
        remaining = [pose for pose in plan if pose.number not in done]
        total = len(file.done) + len(remaining)
        for place, pose in enumerate(remaining):
            if pose.payload != payload:
                self.arm.change_payload(pose.payload)
                payload = pose.payload
            faults = len(result.failed) + result.repeated
            words = self._pose(pose, file, result)
            notable = place == 0 or len(result.failed) + result.repeated > faults
            each = (self.clock.now() - began) / (place + 1)
            self.on_progress(
                CampaignProgress(words, len(file.done), total, each * (len(remaining) - place - 1), notable)
            )
        return result

    def _pose(self, pose: PlannedPose, file: DataFile, result: CampaignResult) -> str:
        if why := self.arm.too_warm():
            self.on_progress(CampaignProgress(f"{why}: cooling", len(file.done), 0, 0.0, True))
            self.arm.cool(self.rest)
        faults: list[str] = []
        for _ in range(self.timing.attempts):
            begin = self.clock.now()
            try:
                state = self.arm.go(pose)
            except Unreachable as error:
                faults.append(str(error))
                break
            timing = held(self.timing.after_motion(self.arm), pose)
            rest = rest_at(self.tracker, self.numbers, self.clock, timing, begin)
            if why := self.arm.disturbed():
                words = f"pose {pose.number}: its row is dropped: {why}"
                self.on_progress(CampaignProgress(words, len(file.done), 0, 0.0, True))
                rest = UnstableDwell(why)
            if isinstance(rest, RestMean):
                file.append(pose, state, rest)
                again = f", after {len(faults)} unfit stops ({faults[-1]})" if faults else ""
                waited = "" if timing is self.timing else f", {timing.settle:.1f} s after its motion"
                return f"pose {pose.number}: spread {in_mm(rest.sd)} mm over {rest.frames} frames{waited}{again}"
            faults.append(rest.why)
            result.repeated += 1
        result.failed[pose.number] = faults[-1]
        return f"pose {pose.number} not measured: {faults[-1]}"


def rest_at(
    tracker: Tracker, numbers: TargetNumbers, clock: Clock, timing: PoseTiming, begin: float
) -> RestMean | UnstableDwell:
    """The mean over the end of a rest whose pose began at a time (s): once the targets are seen again, and settled."""
    given_up = clock.now() + SIGHT_S
    for _ in range(round(SIGHT_S / GLANCE_S)):
        seen = any(tip_position(frame, numbers) is not None for frame in tracker.frames(GLANCE_S))
        if seen or clock.now() > given_up:
            break
    clock.sleep(max(timing.settle, begin + timing.pause - timing.dwell - clock.now()))
    return rest_mean(tracker.frames(timing.dwell), numbers)
