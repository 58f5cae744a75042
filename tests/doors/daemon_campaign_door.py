"""A campaign over the daemon: pose after pose by the real client, until somebody else stops the arm.

Poses that were asked for wait for the ones before them, so that a stop often comes while the arm stands between two.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

from lrm_ident.measuring.campaign.plan import PlannedPose
from lrm_ident.measuring.campaign.rover_arm import RoverArm
from lrmd.client import Rover
from lrmd.messages.codec import Message
from lrmd.messages.control import LeaseRequest
from tests.doors.daemon_door import JOINTS, RENEWED, DaemonDoor
from tests.doors.door import DoorKind
from tests.doors.lockstep import Lockstep
from tests.support.daemon.in_memory_zenoh import InMemoryDaemon

PAUSE_S, NEAR = 0.5, 0.04
"""s that the arm stands at a pose; rad to poses, so near that most stops come while it stands."""


class QuietDaemon(InMemoryDaemon):
    """One whose time does not pass by being looked at."""

    def state(self, tail: str) -> Message:
        self._flush()
        return self._publisher.states[tail]()


def straight(request: Any) -> SimpleNamespace:
    """Answer of `rpc/plan` where nothing is in the way."""
    return SimpleNamespace(found=True, waypoints_rad=[request.from_rad, request.to_rad])


class DaemonCampaignDoor(DaemonDoor):
    """See `DaemonDoor`; who asks is a campaign, which begins anew with the first wish after it has ended."""

    def __init__(self, seed: int, time: Lockstep) -> None:
        super().__init__(seed)
        self.daemon = QuietDaemon(self._sim)
        self._home = self.standing()
        self.time, self._begin, self._poses = time, self._sim.now, deque[Sequence[float]]()

    def torque_on(self) -> None:
        """A person arms, and leaves the lease to the campaign."""
        super().torque_on()
        self._ask("rpc/lease", LeaseRequest(action="release", lease=self._lease))
        self._lease = ""

    def ask(self, wish: Sequence[float]) -> None:
        """See `MotionDoor`: the next pose of a campaign, by where the arm stood first."""
        self._poses.append([at + by for at, by in zip(self._home, wish, strict=True)])
        if not self.time.running:
            self.time.starts(self._campaign)

    def _campaign(self) -> None:
        """As `PoseCampaign` does: a row of an arm that did not stand is dropped, and on it goes."""
        try:
            with Rover("rover") as rover, rover.control("campaign"):
                rover.plan = straight  # type: ignore[assignment,method-assign]
                arm = RoverArm(rover, self.time, lambda _: None, 1)
                while self._poses:
                    self._goes(arm, self._poses.popleft())
                    self.time.sleep(PAUSE_S)
                    arm.disturbed()
        finally:
            self._poses.clear()

    def _goes(self, arm: RoverArm, wish: Sequence[float]) -> None:
        """What is done for a wish: the next pose."""
        arm.go(PlannedPose(1, tuple(wish), 0.0, (0,) * JOINTS, 1))

    def lose_contact(self) -> None:
        """The campaign is killed."""
        super().lose_contact()
        self.time.abandons()

    def pass_time(self, seconds: float) -> None:
        self.time.passes(seconds)

    def advance(self, t: float) -> None:
        """Lets the daemon's time pass until `t` (s), in which the campaign's thread renews its lease."""
        while self._sim.now < self._begin + round(t * 1e9):
            lease = self._sim.core.lease
            if self._contact and lease is not None and self._sim.ticks % RENEWED == 0:
                self._sim.core.handle(LeaseRequest(action="renew", lease=lease.token), self._sim.now)
            self._sim.tick()
            self.commanded()


@contextmanager
def daemon_campaign(make: type[DaemonCampaignDoor], seed: int) -> Iterator[DaemonCampaignDoor]:
    """A campaign, the daemon and somebody who stops it, by one clock."""
    time = Lockstep(lambda t: door.advance(t))
    door = make(seed, time)
    clock = SimpleNamespace(sleep=time.sleep, monotonic=time.now)
    alone = patch.object(Rover, "_keep_alive", lambda *_: None)
    with patch("lrmd.client.rover.time", clock), alone, door.daemon.reachable(), time.ended():
        yield door


DOORS = (
    DoorKind(
        "campaign over the daemon", ("lrm_ident.measuring.campaign.rover_arm", "lrmd.client.rover"),
        partial(daemon_campaign, DaemonCampaignDoor), 0.5, 0.5, NEAR,
    ),
)  # fmt: skip
