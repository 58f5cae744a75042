"""The bridge to ROS 2 without processes: its own door, action, services and order of arrivals, in real time, between a
simulated daemon and a stand-in for ROS 2's network.

A stalled bridge is one that hears and says nothing for a while: what was sent to it comes in order when it goes on.
Its own threads run on, which a frozen process does not allow: what they do between is one more thing to be right in.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from types import SimpleNamespace
from typing import Any

from lrm_math.errors import LrmError
from lrm_ros2.action import FollowAction
from lrm_ros2.arrivals import Arrivals
from lrm_ros2.bridge import TrajectoryDoor, stop_service
from lrm_ros2.sender_watch import SenderEnd, SenderWatch
from lrmd.client import Rover
from lrmd.messages.codec import Message
from lrmd.messages.control import HoldRequest
from tests.support.daemon.in_memory_daemon import SimulatedDaemon
from tests.support.daemon.in_memory_zenoh import FakeZenohSession, InMemoryDaemon

PATIENCE_S, STATE_S = 20.0, 0.02
CLIENT = "@ros2_lv/0/c11e47/1/2/SC/%/%/tester/%lrm%goal"
PUBLISHER = "@ros2_lv/0/b011d/1/2/MP/%/%/tester/%lrm%joint_trajectory"
"""Tokens of the client of the action, and of the publisher."""
TOPIC_END, CLIENT_END = SenderEnd("MP", "/lrm/joint_trajectory"), SenderEnd("SC", "/lrm/goal")


class LiveDaemon(InMemoryDaemon):
    """A daemon whose time is real: a thread lets its ticks pass, and no look at its state does."""

    def handle(self, tail: str, request: Message, came: int) -> Message:
        """A hold is answered when the ramp has read it, as by the api process."""
        answer = super().handle(tail, request, came)
        if isinstance(request, HoldRequest):
            self.sim.settle()
        return answer

    def state(self, tail: str) -> Message:
        return self._publisher.states[tail]()

    @contextmanager
    def ticking(self) -> Iterator[None]:
        """While the block runs. A busy machine makes its time slower, never faster."""
        ended, tick = threading.Event(), self.sim.config.tick / 1e9

        def run() -> None:
            due = time.monotonic()
            while not ended.wait(max(0.0, due - time.monotonic())):
                due = max(due + tick, time.monotonic() - tick)
                with self.session.lock:
                    self.sim.tick()
                    self._flush()

        with _running(run):
            try:
                yield
            finally:
                ended.set()


class Gate:
    """Passage between the bridge and everybody else: shut, nothing passes in either direction."""

    def __init__(self) -> None:
        self._open, self._for_good = threading.Event(), False
        self._open.set()

    def shut(self, seconds: float | None = None) -> None:
        """Shuts it for some seconds, or for good."""
        self._for_good |= seconds is None
        self._open.clear()
        if seconds is not None:
            timer = threading.Timer(seconds, self._again)
            timer.daemon = True
            timer.start()

    def _again(self) -> None:
        if not self._for_good:
            self._open.set()

    def open(self) -> None:
        """Opens it, whatever it was shut for."""
        self._open.set()

    def passed(self) -> None:
        """Waits until it is open."""
        self._open.wait(PATIENCE_S)

    @property
    def is_open(self) -> bool:
        """Whether something passes now."""
        return self._open.is_set()


class GatedSession:
    """The bridge's session with the daemon."""

    def __init__(self, session: FakeZenohSession, gate: Gate) -> None:
        self._session, self._gate = session, gate

    def get(self, *arguments: Any, **named: Any) -> list[Any]:
        self._gate.passed()
        answers = self._session.get(*arguments, **named)
        self._gate.passed()
        return answers

    def put(self, *arguments: Any, **named: Any) -> None:
        self._gate.passed()
        self._session.put(*arguments, **named)


class SessionOnly(Rover):
    """A client over a session that is there."""

    def __init__(self, session: FakeZenohSession | GatedSession) -> None:
        super().__init__("rover", ["tcp/127.0.0.1:1"])
        self._session = session  # type: ignore[assignment]


class RosSide:
    """ROS 2's network as the bridge has it, and whether the client of the action answers.

    `on_the_way`: takes in what was sent to the bridge, one after the other.
    """

    def __init__(self, gate: Gate, arrivals: Arrivals, on_the_way: deque[Callable[[], object]]) -> None:
        self._gate, self._arrivals, self._on_the_way, self.client_runs = gate, arrivals, on_the_way, True

    def ask_session(self, session: str, answered: Callable[[], None]) -> None:
        """See `RosNode`. The answer comes after what was sent before it."""
        if self._gate.is_open and (self.client_runs or session not in CLIENT):
            self._on_the_way.append(partial(self._arrivals.taken_by(lambda *_: answered()), None))

    def stamp(self, t: float) -> float:
        return t

    def result(self, *parts: Any) -> tuple[Any, ...]:
        return parts

    goal_info = result

    def publish_feedback(self, *_: Any) -> None:
        """See `RosNode`."""

    publish_goals = publish_feedback


class InProcessBridge:
    """The bridge, put together as `lrm_ros2.command` does it, and what ROS 2 sends to it."""

    def __init__(self, sim: SimulatedDaemon) -> None:
        self.gate, self.daemon = Gate(), LiveDaemon(sim)
        self._on_the_way: deque[Callable[[], object]] = deque()
        self.arrivals = Arrivals()
        self.person, self.ros = SessionOnly(self.daemon.session), RosSide(self.gate, self.arrivals, self._on_the_way)
        rover = SessionOnly(GatedSession(self.daemon.session, self.gate))
        self.senders = SenderWatch(self.ros.ask_session, (TOPIC_END, CLIENT_END))
        self.door = TrajectoryDoor(rover, self.arrivals, self.senders, TOPIC_END)
        self.action = FollowAction(self.door, self.ros, CLIENT_END)  # type: ignore[arg-type]
        taken = self.arrivals.taken_by
        self._ends: dict[str, Callable[[Any], None]] = {
            "topic": taken(self.door.take),
            "token": taken(lambda token, _: self._token(*token)),
            "hold": taken(self._service(stop_service(lambda: self.door.stop(rover.hold), "the arm holds")), stops=True),
            "estop": taken(self._service(stop_service(lambda: rover.estop("ROS 2"), "pulses are off")), stops=True),
            "send_goal": taken(self._service(self.action.send_goal)),
            "cancel_goal": taken(self._service(self.action.cancel_goal)),
        }

    def send(self, end: str, message: Any) -> threading.Event:
        """Sends a message, or a request; set when the bridge has taken it, or answered."""
        known = threading.Event()
        taken = self._ends[end]

        def arrive() -> None:
            if end == "topic":
                taken(namespace(message))
                known.set()
            else:
                taken((namespace(message), known))

        self._on_the_way.append(arrive)
        return known

    def client(self, there: bool) -> None:
        """The client of the action comes, or goes."""
        self._on_the_way.append(partial(self._ends["token"], (CLIENT, there)))

    def _token(self, token: str, there: bool) -> None:
        self.senders.token(token, there)
        self.action.client(token, there)

    @contextmanager
    def running(self) -> Iterator[None]:
        """At work while the block runs."""
        ended = threading.Event()

        def deliver() -> None:
            while not ended.wait(0.001):
                while self._on_the_way and self.gate.is_open:
                    self._on_the_way.popleft()()

        def follow() -> None:
            while not ended.is_set():
                self.door.follow_next(0.05)

        def tell() -> None:
            while not ended.wait(STATE_S):
                with suppress(LrmError):
                    self.senders.counted(self.door.rover.mode())
                    self.action.on_state(self.door.rover.joints())

        def ask() -> None:
            self.senders.run(ended)

        works = (follow, deliver, tell, ask)
        with self.daemon.ticking(), self.arrivals, ExitStack() as stack:
            for work in works:
                stack.enter_context(_running(work))
            self._on_the_way.append(partial(self._ends["token"], (PUBLISHER, True)))
            try:
                yield
            finally:
                ended.set()
                self.gate.open()
                self.person.estop()

    @staticmethod
    def _service(handler: Callable[[Any, Any, int], object]) -> Callable[[Any, int], object]:
        def asked(request: tuple[Any, threading.Event], number: int) -> None:
            message, known = request
            handler(message, lambda **_: known.set(), number)

        return asked


def namespace(message: Any) -> Any:
    """A message as an object, from nested dictionaries."""
    if isinstance(message, dict):
        return SimpleNamespace(**{key: namespace(value) for key, value in message.items()})
    return [namespace(value) for value in message] if isinstance(message, list) else message


@contextmanager
def _running(work: Callable[[], None]) -> Iterator[None]:
    """A thread at work, which ends by itself after the block."""
    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    try:
        yield
    finally:
        thread.join(PATIENCE_S)
