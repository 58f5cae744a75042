"""What rover software imports: one class that speaks to one daemon.

with Rover("rover") as rover, rover.control("my program"):
    rover.arm(where="stored")
    rover.move({"joint2": 0.5, "joint3": -0.2})
    print(rover.joints().q_rad)
"""

from __future__ import annotations

import os
import re
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import TracebackType
from typing import Literal, Self, TypeVar

import zenoh

from lrm_math.errors import LrmError
from lrmd.messages.control import (
    ArmRequest,
    DisarmRequest,
    ErrorReply,
    EstopCommand,
    Event,
    FaultsState,
    Header,
    HoldRequest,
    InfoState,
    JogRequest,
    JointsState,
    LeaseRequest,
    Message,
    MetricsState,
    ModeState,
    MoveRequest,
    RelaxRequest,
    ReloadReply,
    ReloadRequest,
    Reply,
    ResetRequest,
    ThermalState,
    field_named,
    pack,
    unpack,
)
from lrmd.messages.kinematics import CancelRequest, FkReply, FkRequest, IkReply, IkRequest, PlanReply, PlanRequest
from lrmd.messages.zenoh_session import client, key

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
ROBOT_NAME = r"[A-Za-z0-9_-]+"
STANDING = ("armed", "holding")
RELOAD_MS = 10_000.0
S = TypeVar("S", bound=Header)


class NoAnswer(LrmError):
    """Nobody answers: no daemon of that name, or no permission to ask it."""


class RequestRefused(LrmError):
    """The daemon said no; carries `code`, `retryable` and `detail`."""

    def __init__(self, reply: ErrorReply) -> None:
        self.code, self.retryable, self.detail = reply.code, reply.retryable, reply.detail
        super().__init__(reply.msg)


class Interrupted(LrmError):
    """A motion that ended before its goal; carries the `mode` it ended in."""

    def __init__(self, mode: str, why: str) -> None:
        self.mode = mode
        super().__init__(f"the motion ended before its goal: {mode} ({why})")


class Rover:
    """A session with one daemon.

    `connect`: zenoh endpoints, by default those of the environment variable LRM_CONNECT (comma between them), or this
    machine. `config`: a zenoh file with a password or certificates, by default LRM_ZENOH_CONFIG.
    """

    def __init__(
        self,
        robot: str = "rover",
        connect: Sequence[str] | None = None,
        config: str | None = None,
        timeout: float = 2.0,
    ) -> None:
        if not re.fullmatch(ROBOT_NAME, robot):
            raise LrmError(f"robot '{robot}': a name has letters, digits, _ and - only")
        endpoints = connect or os.environ.get("LRM_CONNECT", DEFAULT_ENDPOINT).split(",")
        self.robot = robot
        self._timeout = timeout
        self._where = ", ".join(endpoints)
        try:
            self._config = client(list(endpoints), config or os.environ.get("LRM_ZENOH_CONFIG"))
        except zenoh.ZError:
            raise LrmError(f"{self._where}: should be zenoh endpoints like {DEFAULT_ENDPOINT}") from None
        self._lease: str | None = None

    def __enter__(self) -> Self:
        try:
            self._session = zenoh.open(self._config)
        except zenoh.ZError as error:
            reason = str(error).split(" at /")[0]
            raise NoAnswer(f"no connection to {self._where} ({reason}); is lrmd running, and allowed?") from None
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._session.close()  # type: ignore[no-untyped-call]

    # ---- the lease

    @contextmanager
    def control(self, holder: str, take: bool = False) -> Iterator[Self]:
        """The right to command, kept alive in a thread as long as the block lasts, and given back after it.

        Raises `RequestRefused` if somebody else has it (unless `take`). Losing it ends a motion in hold.
        """
        with field_named():
            request = LeaseRequest(action="acquire", holder=holder, take=take)
        reply = self._ask("rpc/lease", request)
        self._lease = reply.lease
        ended = threading.Event()
        beat = threading.Thread(target=self._keep_alive, args=(ended, (reply.lease_ms or 400.0) / 4000), daemon=True)
        beat.start()
        try:
            yield self
        finally:
            ended.set()
            beat.join()
            lease, self._lease = self._lease, None
            if lease is not None:
                self._ask_quietly(LeaseRequest(action="release", lease=lease))

    def _keep_alive(self, ended: threading.Event, period: float) -> None:
        while not ended.wait(period):
            lease = self._lease
            if lease is not None:
                self._ask_quietly(LeaseRequest(action="renew", lease=lease))

    def _ask_quietly(self, request: LeaseRequest) -> None:
        try:
            self._ask("rpc/lease", request, timeout=0.3)
        except (RequestRefused, NoAnswer):
            return

    def _token(self) -> str:
        if self._lease is None:
            raise LrmError("commands need the lease: use `with rover.control('who I am'):`")
        return self._lease

    # ---- commands

    def arm(
        self,
        where: Literal["given", "stored", "board"] = "board",
        q: Mapping[str, float] | None = None,
        servos: Sequence[str] | None = None,
    ) -> None:
        """Switches servos on where they stand (`q`, rad), and waits until they are. Raises `RequestRefused`."""
        chosen = None if servos is None else list(servos)
        with field_named():
            request = ArmRequest(lease=self._token(), where=where, q_rad=dict(q or {}), servos=chosen)
        reply = self._ask("rpc/arm", request)
        self._wait(("armed",), ("arming",), (reply.seconds or 0.0) + 2.0)

    def move(
        self,
        *waypoints: Mapping[str, float],
        pace: Literal["together", "each"] = "together",
        speed: float = 1.0,
        payload_kg: float | None = None,
        wait: bool = True,
    ) -> float:
        """Moves servos (rad by name) through the waypoints. Returns the seconds it takes.

        Raises `RequestRefused`; while waiting `Interrupted` if the motion ends before its goal.
        """
        way = [dict(w) for w in waypoints]
        with field_named():
            request = MoveRequest(lease=self._token(), waypoints=way, pace=pace, speed=speed, payload_kg=payload_kg)
        seconds = self._ask("rpc/move", request).seconds or 0.0
        if wait:
            self._wait(("armed",), ("moving",), 2 * seconds + 5.0)
        return seconds

    def jog(self, rates: Mapping[str, float]) -> None:
        """Turns servos at rates (rad/s) for at most half a second: call it again to go on. Never waits."""
        with field_named():
            request = JogRequest(lease=self._token(), rate_rad_per_s=dict(rates))
        self._session.put(key(self.robot, "cmd/jog"), pack(request), express=True)

    def hold(self) -> None:
        """Stops where it is, with pulses on. Needs no lease."""
        self._ask("rpc/hold", HoldRequest())

    def relax(self, servos: Sequence[str] | None = None) -> None:
        """Stops the pulses of some servos, or of all: what they carried falls."""
        with field_named():
            request = RelaxRequest(lease=self._token(), servos=None if servos is None else list(servos))
        self._ask("rpc/relax", request)

    def disarm(self) -> None:
        """Stops all pulses of an arm that stands still."""
        self._ask("rpc/disarm", DisarmRequest(lease=self._token()))

    def reset_fault(self) -> None:
        """Leaves fault or estop. Nothing moves."""
        self._ask("rpc/reset_fault", ResetRequest(lease=self._token()))

    def reload(self) -> ReloadReply:
        """Has the daemon take the model's file as it is now. Needs no lease; nothing moves. Raises `RequestRefused`."""
        return self._question("rpc/reload", ReloadRequest(), ReloadReply, RELOAD_MS)

    def estop(self, why: str = "") -> None:
        """Stops all pulses at the next tick. Needs no lease."""
        command = EstopCommand(why="".join(c for c in why if c.isprintable())[:64])
        self._session.put(key(self.robot, "cmd/estop"), pack(command), express=True)
        self._ask("rpc/estop", command)

    # ---- kinematics

    def ik(self, request: IkRequest) -> IkReply:
        """Commands for goals. Raises `RequestRefused`."""
        return self._question("rpc/ik", request, IkReply, request.deadline_ms)

    def fk(self, request: FkRequest) -> FkReply:
        """Where the bent arm's tool is. Raises `RequestRefused`."""
        return self._question("rpc/fk", request, FkReply, 1000.0)

    def plan(self, request: PlanRequest) -> PlanReply:
        """A way round what is between. Raises `RequestRefused`."""
        return self._question("rpc/plan", request, PlanReply, request.deadline_ms)

    def cancel(self, name: str) -> None:
        """Gives up a query or plan that was asked with this `id`; whoever waits for it gets `cancelled`."""
        with field_named():
            request = CancelRequest(id=name)
        self._replies("rpc/cancel", pack(request), self._timeout)

    def standing(self) -> list[float]:
        """Angles (rad) that the arm's joints were last told."""
        return self.joints().q_rad[: self.info().joints]

    # ---- state

    def joints(self) -> JointsState:
        """Where every servo was told to be."""
        return self._state("state/joints", JointsState)

    def mode(self) -> ModeState:
        """What the daemon is at."""
        return self._state("state/mode", ModeState)

    def faults(self) -> FaultsState:
        """Faults that were not reset yet."""
        return self._state("state/faults", FaultsState)

    def thermal(self) -> ThermalState:
        """How hot the servos are, by the model."""
        return self._state("state/thermal", ThermalState)

    def metrics(self) -> MetricsState:
        """How well the ramp keeps its time."""
        return self._state("state/metrics", MetricsState)

    def info(self) -> InfoState:
        """Names, limits and rates of the servos."""
        return self._state("info", InfoState)

    def events(self) -> list[Event]:
        """The last events, oldest first."""
        return [unpack(Event, data) for data in self._replies("rpc/events", b"", self._timeout)]

    def watch(self, kind: type[S], tail: str, callback: Callable[[S], None]) -> zenoh.Subscriber[None]:
        """Calls back with every message of a key, for instance `watch(JointsState, "state/joints", print)`."""
        return self._session.declare_subscriber(
            key(self.robot, tail), lambda sample: callback(unpack(kind, sample.payload.to_bytes()))
        )

    # ---- how it asks

    def _wait(self, wanted: Sequence[str], meanwhile: Sequence[str], limit: float) -> None:
        end = time.monotonic() + limit
        while (state := self.mode()).mode not in wanted:
            if state.mode not in meanwhile:
                raise Interrupted(state.mode, state.why)
            if time.monotonic() > end:
                raise Interrupted(state.mode, f"not there after {limit:.0f} s")
            time.sleep(0.02)

    def _state(self, tail: str, kind: type[S]) -> S:
        return unpack(kind, self._replies(tail, b"", self._timeout)[0])

    def _question(self, tail: str, request: Message, kind: type[S], deadline_ms: float) -> S:
        return unpack(kind, self._replies(tail, pack(request), self._timeout + deadline_ms / 1000)[0])

    def _ask(self, tail: str, request: Message, timeout: float | None = None) -> Reply:
        return unpack(Reply, self._replies(tail, pack(request), timeout or self._timeout)[0])

    def _replies(self, tail: str, payload: bytes, timeout: float) -> list[bytes]:
        """Payloads of all replies. Raises `RequestRefused` on an error reply, `NoAnswer` without any."""
        whole = key(self.robot, tail)
        found: list[bytes] = []
        for reply in self._session.get(
            whole, payload=payload, timeout=timeout, consolidation=zenoh.ConsolidationMode.NONE
        ):
            if reply.ok is not None:
                found.append(reply.ok.payload.to_bytes())
            elif reply.err is not None and not found:
                raise self._refusal(reply.err.payload.to_bytes())
        if not found and tail != "rpc/events":
            raise NoAnswer(f"no answer from {whole} at {self._where}: no daemon of that name, or no permission")
        return found

    def _refusal(self, data: bytes) -> LrmError:
        try:
            return RequestRefused(unpack(ErrorReply, data))
        except LrmError:
            return NoAnswer(f"no answer from {self.robot} in time ({data.decode(errors='replace')})")
