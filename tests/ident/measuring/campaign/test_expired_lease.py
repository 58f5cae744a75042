"""A campaign's arm whose lease expires on the way: it goes on, unless somebody stopped the arm or has the lease."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from lrm_ident.measuring.campaign.rover_arm import ATTEMPTS, STARTING_S, RoverArm
from lrmd.client import LEASE_LOST, MotionInterrupted, RequestRefused
from lrmd.messages.codec import ErrorReply

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
