"""Whether an arm still stands where it was sent, and goes on after its lease expired, by a real controller."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from lrm_ident.measuring.campaign.plan import PlannedPose
from lrm_ident.measuring.campaign.real_clock import RealClock
from lrm_ident.measuring.campaign.rover_arm import ATTEMPTS, STARTING_S, RoverArm
from lrm_ident.measuring.campaign.session import by_daemon, power_on
from lrm_math.arm.arm_file import load_arm
from lrm_math.errors import LrmError
from lrmd.client import LEASE_LOST, MotionInterrupted, RequestRefused, Rover
from lrmd.config import SECOND, load_config
from lrmd.messages.codec import ErrorReply
from tests.support.daemon.in_memory_daemon import CONFIG, SimulatedDaemon
from tests.support.daemon.in_memory_zenoh import InMemoryDaemon

Q = (0.0, math.radians(10.0), 0.0, 0.0, 0.0, 0.0)
Meanwhile = Callable[[InMemoryDaemon, Rover], object]


def started(boot_id: str) -> InMemoryDaemon:
    sim = SimulatedDaemon(load_config(CONFIG))
    sim.run(30)
    return InMemoryDaemon(sim, boot_id)


@pytest.fixture
def daemon() -> Iterator[InMemoryDaemon]:
    found = started("boot1")
    with found.reachable():
        yield found


@pytest.fixture
def rover(daemon: InMemoryDaemon) -> Iterator[Rover]:
    assert daemon.boot_id == "boot1"
    with Rover("rover") as opened, opened.control("campaign"):
        yield opened


@pytest.fixture
def arm(rover: Rover) -> RoverArm:
    """At `Q`, in whole counts, so that going there needs no planned way."""
    names = rover.info().names[:6]
    rover.arm("given", dict.fromkeys(names, 0.0))
    found = RoverArm(rover, RealClock(), lambda _: None, 1)
    rover.move(dict(zip(names, found.rounded(Q), strict=True)))
    return found


def test_a_daemon_of_an_arm_with_other_joints_is_refused(daemon: InMemoryDaemon) -> None:
    assert daemon.boot_id == "boot1"
    with Rover("rover") as rover:
        with rover.control("campaign"):
            rover.arm("given", dict.fromkeys(rover.info().names[:6], 0.0))
        driven = by_daemon(rover, load_arm("so101"), False, "campaign", RealClock(), lambda _: None)
        with pytest.raises(LrmError, match="so101 has 5 joints, rover has 6"), driven:
            pass


def stopped(_: InMemoryDaemon, rover: Rover) -> None:
    rover.estop("somebody in the way")


def stopped_and_armed_again(_: InMemoryDaemon, rover: Rover) -> None:
    rover.estop("somebody in the way")
    rover.reset_fault()
    rover.arm("given", dict(zip(rover.info().names[:6], rover.commanded_q(), strict=True)))


def taken_and_moved_there_and_back(_: InMemoryDaemon, __: Rover) -> None:
    with Rover("rover") as other, other.control("campaign", take=True):
        other.move({"joint1": 0.1}, {"joint1": 0.0})


def taken_and_given_back(_: InMemoryDaemon, __: Rover) -> None:
    with Rover("rover") as other, other.control("campaign", take=True):
        pass


def moved_with_our_lease(_: InMemoryDaemon, rover: Rover) -> None:
    rover.move({"joint1": 0.1})


def gripper_off(_: InMemoryDaemon, rover: Rover) -> None:
    rover.relax(["joint6"])


def restarted(_: InMemoryDaemon, rover: Rover) -> None:
    rover._session = started("boot2").session  # type: ignore[assignment]


@pytest.mark.long
@pytest.mark.parametrize(
    ("meanwhile", "words"),
    [
        (stopped, "the arm is estop (somebody in the way); other servos have pulses"),
        (stopped_and_armed_again, "the arm is armed"),
        (taken_and_moved_there_and_back, "lease"),
        (taken_and_given_back, "lease"),
        (moved_with_our_lease, "other angles are commanded"),
        (gripper_off, "other servos have pulses"),
        (restarted, "was restarted (boot id boot1, now boot2)"),
    ],
)
def test_what_happens_during_a_rest_is_noticed(
    daemon: InMemoryDaemon, rover: Rover, arm: RoverArm, meanwhile: Meanwhile, words: str
) -> None:
    arm.go(PlannedPose(1, Q, 0.0, (), 1))
    assert arm.disturbed() == ""
    meanwhile(daemon, rover)
    assert words in arm.disturbed()


@pytest.mark.parametrize("meanwhile", [stopped, gripper_off])
def test_an_arm_that_does_not_stand_after_its_way_ends_the_campaign(
    daemon: InMemoryDaemon, rover: Rover, arm: RoverArm, meanwhile: Meanwhile
) -> None:
    """Between the end of the motion and the first look."""
    meanwhile(daemon, rover)
    with pytest.raises(MotionInterrupted):
        arm.go(PlannedPose(1, Q, 0.0, (), 1))


def held(_: InMemoryDaemon, __: Rover) -> None:
    with Rover("rover") as other:
        other.hold()


@pytest.mark.long
@pytest.mark.parametrize("meanwhile", [held, stopped_and_armed_again, gripper_off])
def test_a_stop_at_a_rest_ends_the_campaign_although_it_looks_at_the_mode(
    daemon: InMemoryDaemon, rover: Rover, arm: RoverArm, monkeypatch: pytest.MonkeyPatch, meanwhile: Meanwhile
) -> None:
    """Whoever stops an arm that stands means it: the next pose is not approached, read from the board's pulses."""
    way = lambda request: SimpleNamespace(found=True, waypoints_rad=[request.from_rad, request.to_rad])  # noqa: E731
    monkeypatch.setattr(rover, "plan", way)
    arm.go(PlannedPose(1, Q, 0.0, (), 1))
    meanwhile(daemon, rover)
    assert arm.disturbed()
    pulses = daemon.sim._pulses()
    with pytest.raises(RequestRefused, match="stopped since"):
        arm.go(PlannedPose(2, (0.2, *Q[1:]), 0.0, (1,) * 6, 1))
    daemon.run(30)
    assert daemon.sim._pulses() == pulses


def test_a_power_on_session_ends_with_the_pulses_or_the_daemon(daemon: InMemoryDaemon, rover: Rover) -> None:
    names = rover.info().names[:6]
    rover.arm("given", dict.fromkeys(names, 0.0))
    first = power_on(rover).name
    rover.move({"joint1": 0.1}, {"joint1": 0.0})
    rover.hold()
    assert power_on(rover).name == first
    for off in (rover.disarm, rover.estop):
        before = power_on(rover).name
        off()
        if off == rover.estop:
            rover.reset_fault()
        daemon.run(6)
        rover.arm("given", dict.fromkeys(names, 0.0))
        assert power_on(rover).name != before
    rover._session = started("boot2").session  # type: ignore[assignment]
    rover.mode()
    assert power_on(rover).name == "boot2-0"


def test_the_time_since_power_on_is_that_of_the_pulses(daemon: InMemoryDaemon, rover: Rover) -> None:
    """Not of the session's first motion, and anew after each time without pulses."""
    names = rover.info().names[:6]
    for _ in range(2):
        assert power_on(rover).ago is None
        rover.arm("given", dict.fromkeys(names, 0.0))
        begun, began = power_on(rover), daemon.sim.now
        rover.move({"joint1": 0.1}, {"joint1": 0.0})
        later = power_on(rover)
        assert later.name == begun.name
        assert later.ago - begun.ago == pytest.approx((daemon.sim.now - began) / SECOND, abs=0.1)
        assert later.temperature == begun.temperature
        rover.disarm()
        daemon.run(6)


GOAL = [0.5]
LOST = MotionInterrupted("holding", LEASE_LOST)
REFUSED = RequestRefused(ErrorReply(code="lease", msg="the lease has run out"))


class OneJoint:
    """A daemon with one joint; each motion ends as the next of `ends` says: an error half way, or at its goal."""

    def __init__(self, *ends: Exception, why: str = LEASE_LOST) -> None:
        self.ends, self.q, self.slept, self.moves, self.why = list(ends), [0.0], 0.0, 0, why

    def info(self) -> Any:
        return SimpleNamespace(joints=1, names=["joint1"])

    def mode(self) -> Any:
        return SimpleNamespace(mode="holding", why=self.why, stops=7)

    def commanded_q(self) -> list[float]:
        return self.q

    def plan(self, request: Any) -> Any:
        return SimpleNamespace(found=True, waypoints_rad=[request.from_rad, request.to_rad])

    def move(self, way: dict[str, float], payload_kg: float, stops: int) -> None:
        assert (payload_kg, stops) == (0.1, 7)
        self.moves += 1
        if not self.ends:
            self.q = [way["joint1"]]
            return
        self.q = [0.5 * (self.q[0] + way["joint1"])]
        raise self.ends.pop(0)

    def sleep(self, seconds: float) -> None:
        self.slept += seconds


def moved(rover: Any) -> None:
    RoverArm(rover, rover, lambda _: None, 1)._move(GOAL, 0.1)


def test_it_goes_on_from_where_the_arm_holds() -> None:
    rover = OneJoint(LOST, REFUSED, LOST)
    moved(rover)
    assert (rover.q, rover.moves) == (GOAL, 4)
    assert rover.slept == pytest.approx(3.0)


def test_a_pose_waits_while_the_ik_process_is_being_started() -> None:
    starting = RequestRefused(ErrorReply(code="busy", msg="the ik process is being started", retryable=True))

    class Starting(OneJoint):
        refusals = 3

        def plan(self, request: Any) -> Any:
            self.refusals -= 1
            if self.refusals >= 0:
                raise starting
            return super().plan(request)

    rover = Starting()
    moved(rover)
    assert rover.q == GOAL
    assert rover.slept == pytest.approx(3 * STARTING_S)


def test_after_some_attempts_it_ends() -> None:
    rover = OneJoint(*[LOST] * 20)
    with pytest.raises(MotionInterrupted, match=LEASE_LOST):
        moved(rover)
    assert rover.moves == ATTEMPTS


def test_somebody_who_stops_the_arm_meanwhile_stops_the_campaign() -> None:
    rover = OneJoint(LOST, why="hold")
    with pytest.raises(MotionInterrupted, match="hold"):
        moved(rover)
    assert rover.moves == 1


@pytest.mark.parametrize(
    "error", [MotionInterrupted("holding", "hold"), RequestRefused(ErrorReply(code="wrong_mode", msg="fault"))]
)
def test_any_other_end_ends_it_at_once(error: Exception) -> None:
    rover = OneJoint(error)
    with pytest.raises(type(error)):
        moved(rover)
    assert rover.moves == 1
