"""The daemon as a client drives it: real server, controller, ramp and link on a simulated clock and board.

What a client sends is under way for up to 0.3 s, so that a stop, which anybody may send, often arrives before it. A
stop is final at once, but for one step that may be in a stalled line already (0.16 deg): it comes out with the line.
"""

from __future__ import annotations

import random
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

from lrm_math.errors import LrmError
from lrmd.client import RequestRefused
from lrmd.config import Config
from lrmd.messages.codec import ErrorReply, Message, pack, unpack, unpack_shown
from lrmd.messages.control import (
    ArmRequest,
    EstopCommand,
    HoldRequest,
    JogRequest,
    LeaseRequest,
    MotionRequest,
    MoveRequest,
    Reply,
)
from lrmd.messages.skills import SenseCommand, SkillRequest
from tests.doors.door import Angles, DoorKind
from tests.support.daemon.in_memory_daemon import SimulatedDaemon, config_at
from tests.support.daemon.in_memory_zenoh import InMemoryDaemon

JOINTS, RENEWED, UNDER_WAY_S, ARMING_S = 6, 15, 0.3, 4.0
"""Ticks between two renewals of the lease; s that a request takes at most; s that arming may take."""


KEYS: dict[type[Message], str] = {
    MoveRequest: "rpc/move", JogRequest: "cmd/jog", SkillRequest: "rpc/skill", SenseCommand: "cmd/sense"
}  # fmt: skip


@cache
def simulated_config() -> Config:
    """The shipped configuration at 330 Hz."""
    with tempfile.TemporaryDirectory() as folder:
        return config_at(330.0, Path(folder))


class SimulatedArmDoor:
    """A door with a simulated daemon's arm behind it: what the chip of its board puts out, and put out last."""

    joints: Sequence[str]
    _sim: SimulatedDaemon
    _shaft: list[float]

    def commanded(self) -> Angles:
        for i, servo in enumerate(self._sim.config.servos[: len(self.joints)]):
            if (pulse := self._sim.board.chip.pulse(servo.channel)) is not None:
                self._shaft[i] = servo.angle(round(pulse * 1e9))
        return tuple(self._shaft)

    def standing(self) -> Angles:
        return self.commanded()

    def powered(self) -> frozenset[str]:
        servos, chip = self._sim.config.servos[: len(self.joints)], self._sim.board.chip
        return frozenset(servo.name for servo in servos if chip.pulse(servo.channel) is not None)


class DaemonDoor(SimulatedArmDoor):
    """One daemon, one client with the lease, and an arm that stands where a seed puts it."""

    def __init__(self, seed: int) -> None:
        self._rng, self._config = random.Random(seed), simulated_config()
        self._sim = SimulatedDaemon(self._config, seed=seed)
        self._sim.run(30)
        self._daemon = InMemoryDaemon(self._sim)
        self._under_way: list[tuple[int, MotionRequest]] = []
        self._contact, self._stops = True, 0
        self.joints: Sequence[str] = self._config.names[:JOINTS]
        self._shaft = [self._rng.uniform(-0.5, 0.5) for _ in self.joints]
        self._lease = ""

    def torque_on(self) -> None:
        self._lease = self._ask("rpc/lease", LeaseRequest(action="acquire", holder="door", take=True)).lease or ""
        given = dict(zip(self.joints, self._shaft, strict=True))
        self._ask("rpc/arm", ArmRequest(lease=self._lease, stops=self._stops, where="given", q_rad=given))
        for _ in range(round(ARMING_S / 0.05)):
            self.pass_time(0.05)
            if self._sim.core.mode != "arming":
                break
        if self._sim.core.mode != "armed":
            on = ", ".join(sorted(self.powered())) or "no servo"
            raise LrmError(f"the motion ended before its goal: {self._sim.core.mode}; with pulses: {on}")

    def ask(self, wish: Sequence[float]) -> None:
        late = round(self._rng.uniform(0.0, UNDER_WAY_S) * 1e9)
        self._under_way.append((self._sim.now + late, self._wished(wish)))

    def _wished(self, wish: Sequence[float]) -> MotionRequest:
        """The request for a motion to angles (n,), rad."""
        if self._rng.random() < 0.3:
            rates = {self._rng.choice(self.joints): self._rng.uniform(-0.2, 0.2)}
            return JogRequest(lease=self._lease or "none", stops=self._stops, rate_rad_per_s=rates)
        goal = dict(zip(self.joints, wish, strict=True))
        return MoveRequest(lease=self._lease or "none", stops=self._stops, waypoints=[goal])

    def stop(self) -> None:
        if self._rng.random() < 0.2:
            self._ask("rpc/estop", EstopCommand())
            return
        with suppress(RequestRefused):  # where nothing has pulses, or a fault has stopped it
            self._ask("rpc/hold", HoldRequest())
        self._sim.settle()  # as the api process waits for the ramp

    def lose_contact(self) -> None:
        self._contact = False

    def disturb(self) -> None:
        where = self._rng.choice(["lost_in", "lost_out", "stall", "stall", "unplugged"])
        setattr(self._sim, where, self._rng.randint(1, 70))

    def pass_time(self, seconds: float) -> None:
        for _ in range(round(seconds * 1e9 / self._config.tick)):
            if self._contact and self._sim.ticks % RENEWED == 0 and self._lease:
                with suppress(LrmError):
                    self._ask("rpc/lease", LeaseRequest(action="renew", lease=self._lease))
            for request in [r for due, r in self._under_way if due <= self._sim.now]:
                with suppress(LrmError):
                    self._ask(KEYS[type(request)], request)
            self._under_way = [one for one in self._under_way if one[0] > self._sim.now]
            self._sim.tick()
            self._ticked()
            self.commanded()

    def _ticked(self) -> None:
        """What else happens in a tick."""

    def _ask(self, tail: str, request: Message) -> Reply:
        key = f"lrm/{self._config.robot}/{tail}"
        if tail.startswith("cmd/"):
            self._daemon.session.put(key, pack(request))
            return Reply(boot_id="", seq=0, t_mono_ns=0, t_wall_ns=0, mode="")
        (reply,) = self._daemon.session.get(key, pack(request))
        if reply.ok is None:
            assert reply.err is not None
            raise RequestRefused(unpack_shown(ErrorReply, reply.err.payload.data))
        answer = unpack(Reply, reply.ok.payload.data)
        self._stops = answer.stops if tail in ("rpc/hold", "rpc/lease") and answer.stops is not None else self._stops
        return answer


@contextmanager
def daemon_door(seed: int) -> Iterator[DaemonDoor]:
    """A daemon and its client."""
    yield DaemonDoor(seed)


DOORS = (DoorKind("daemon client", ("lrmd.api.zenoh_server",), daemon_door, 0.5, 0.5),)
