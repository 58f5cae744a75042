"""The daemon as a client drives it by skills: a motion is asked for, planned for a while, and then begun by the daemon.

The kinematics are a stand-in that answers every plan with a way through a third place, up to a second later: by then
the arm may have been stopped, moved by a request, or its client gone.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress

from lrm_math.errors import LrmError
from lrmd.errors import RequestError
from lrmd.messages.control import MotionRequest
from lrmd.messages.kinematics import KinematicsRequest, PlanReply, PlanRequest
from lrmd.messages.skills import SenseCommand, SkillRequest
from tests.doors.daemon_door import KEYS, DaemonDoor
from tests.doors.door import DoorKind

THINKING_S = 1.0
"""s that a plan takes at most."""


def straight_way(request: KinematicsRequest, between: Sequence[float]) -> PlanReply:
    """A plan through another pose (rad)."""
    assert isinstance(request, PlanRequest)
    assert request.to_rad is not None
    way = [request.from_rad, list(between), request.to_rad]
    return PlanReply(
        boot_id="", seq=0, t_mono_ns=0, t_wall_ns=0, model="", model_sha256="", elapsed_ms=0.0, found=True, text="",
        waypoints_rad=way,
    )  # fmt: skip


class SkillDoor(DaemonDoor):
    """One daemon, one client that asks for skills, and sometimes for a motion beside them."""

    _due: tuple[int, int] | None = None

    def _wished(self, wish: Sequence[float]) -> MotionRequest:
        if self._rng.random() < 0.2:
            return super()._wished(wish)
        return SkillRequest(lease=self._lease or "none", stops=self._stops, skill="stow", q_rad=list(wish))

    def disturb(self) -> None:
        if self._rng.random() < 0.2:
            with suppress(LrmError):
                self._ask(KEYS[SenseCommand], SenseCommand(what=self._rng.choice(["touch", "empty"])))
        else:
            super().disturb()

    def _ticked(self) -> None:
        question = self._sim.core.question
        if question is None:
            return
        number, asked = question
        if self._due is None or self._due[0] != number:
            self._due = number, self._sim.now + round(self._rng.uniform(0.0, THINKING_S) * 1e9)
        if self._sim.now < self._due[1]:
            return
        between = [self._rng.uniform(-0.5, 0.5) for _ in self.joints]
        failed = self._rng.random() < 0.1
        reply = RequestError("busy", "not now") if failed else straight_way(asked, between)
        self._sim.core.answer(number, reply, self._sim.now)


@contextmanager
def skill_door(seed: int) -> Iterator[SkillDoor]:
    """A daemon and its client."""
    yield SkillDoor(seed)


DOORS = (DoorKind("skills", ("lrmd.api.zenoh_server",), skill_door, 0.5, 0.5),)
