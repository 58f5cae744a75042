"""A program on an open router that answers in the daemon's place, and what our client accepts of it."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import msgpack
import zenoh

from lrm_math.errors import LrmError
from lrmd.client import GoalEntry, IkRequest, Rover
from lrmd.messages.control import JointsState
from lrmd.messages.zenoh_session import client
from tests.support.daemon.daemon_process import DaemonSetup

FORGED = "f"
"""Mark of everything forged: the lease's token, the model and the servo that no daemon has."""
ANSWER = {"verdict": "solved", "text": FORGED, "q_rad": [1.0] * 6, "elapsed_ms": 0.0}
TRIES, STATES_S = 8, 1.0


@dataclass
class Accepted:
    """Forged messages that a client took for the daemon's, of `tries` queries of each kind, and of one second's states.

    `refused`: queries that ended in an error.
    """

    ik: int = 0
    lease: int = 0
    mode: int = 0
    states: int = 0
    refused: int = 0


@dataclass
class Forger:
    """Answers `rpc/ik`, `rpc/lease` and `state/mode`, and puts `state/joints`, in the name of `boot_id`.

    `complete`: it says to zenoh that its answer is the whole one, so that nobody else is asked by default.
    """

    session: zenoh.Session
    setup: DaemonSetup
    boot_id: str
    complete: bool = False
    ended: threading.Event = field(default_factory=threading.Event)

    def header(self) -> dict[str, Any]:
        """The fields that all messages begin with."""
        now = time.monotonic_ns()
        return {"v": 1, "boot_id": self.boot_id, "seq": now, "t_mono_ns": now, "t_wall_ns": time.time_ns()}

    def contents(self) -> dict[str, dict[str, Any]]:
        """Forged contents by key."""
        model = {"model": FORGED, "model_sha256": "", "left_out": [], "elapsed_ms": 0.0}
        mode = {"mode": "armed", "why": FORGED, "since_mono_ns": 0, "holder": None, "link": "ready", "payload_kg": 0.0}
        return {
            "rpc/ik": {**model, "answers": [ANSWER]},
            "rpc/lease": {"mode": "armed", "lease": FORGED, "lease_ms": 400.0},
            "state/mode": {**mode, "troubles": []},
        }

    def joints(self) -> dict[str, Any]:
        """A state of the joints with one servo that no arm has."""
        one = {"q_rad": [0.0], "target_rad": [0.0], "pulse_us": [0.0], "on": [True], "moving": False}
        return {**self.header(), "names": [FORGED], **one, "remaining_s": 0.0}

    def answer(self) -> None:
        """Declares what it answers."""
        for tail, content in self.contents().items():

            def reply(query: zenoh.Query, content: dict[str, Any] = content) -> None:
                with query:
                    query.reply(query.key_expr, msgpack.packb(self.header() | content))

            self.session.declare_queryable(self.setup.key(tail), reply, complete=self.complete)

    def publish(self) -> None:
        """Puts states until it is ended, twice as often as the daemon."""
        while not self.ended.wait(0.01):
            self.session.put(self.setup.key("state/joints"), msgpack.packb(self.joints()))


@contextmanager
def forged(setup: DaemonSetup, boot_id: str, complete: bool = False) -> Iterator[None]:
    """A forger at work while the block runs."""
    with zenoh.open(client([setup.endpoint])) as session:
        forger = Forger(session, setup, boot_id, complete)
        forger.answer()
        publisher = threading.Thread(target=forger.publish)
        publisher.start()
        time.sleep(0.3)
        try:
            yield
        finally:
            forger.ended.set()
            publisher.join()


def accepted(rover: Rover) -> Accepted:
    """Messages that a client takes from a forger that is at work."""
    found, states = Accepted(), list[JointsState]()
    subscriber = rover.watch(JointsState, "state/joints", states.append)
    request = IkRequest(goals=[GoalEntry(position_m=[0.4, 0.0, 0.3])])
    for _ in range(TRIES):
        try:
            found.ik += rover.ik(request).model == FORGED
        except LrmError:
            found.refused += 1
        try:
            with rover.control("client"):
                found.lease += rover.renew() == FORGED
        except LrmError:
            found.refused += 1
        try:
            found.mode += rover.mode().why == FORGED
        except LrmError:
            found.refused += 1
    time.sleep(STATES_S)
    subscriber.undeclare()  # type: ignore[no-untyped-call]
    assert any(state.names != [FORGED] for state in states), "the daemon's own states arrive meanwhile"
    found.states = sum(state.names == [FORGED] for state in states)
    return found
