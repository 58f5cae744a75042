"""An order that waits, in the daemon or on the way, moves nothing once whoever gave it has given up."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import Any

import pytest

from lrmd.api.zenoh_server import ZenohServer
from lrmd.client import NoReply, Rover
from lrmd.config import SECOND
from lrmd.control.requests import PATIENCE
from lrmd.control.state_machine import Mode
from lrmd.errors import RequestError
from lrmd.messages.codec import Message, pack
from lrmd.messages.control import ArmRequest, JogRequest, MotionRequest, MoveRequest, Reply
from lrmd.messages.inbox import Inbox
from lrmd.messages.skills import SkillRequest
from tests.support.daemon.armed_daemon import ArmedDaemon
from tests.support.daemon.in_memory_zenoh import FakeZenohSession
from tests.support.daemon.losing_daemon import LosingDaemon

NEAR = {"joint1": 0.1}


@pytest.fixture
def sim(config: Any) -> ArmedDaemon:
    made = ArmedDaemon(config)
    made.arm("given", [0.0] * 6)
    return made


ORDERS: dict[str, tuple[type[MotionRequest], dict[str, Any]]] = {
    "move": (MoveRequest, {"waypoints": [NEAR]}),
    "jog": (JogRequest, {"rate_rad_per_s": {"joint1": 0.1}}),
    "skill": (SkillRequest, {"skill": "stow", "q_rad": [0.1] * 6}),
    "arm": (ArmRequest, {"where": "given", "q_rad": {"gripper": 0.0}}),
}


@pytest.mark.parametrize("order", ORDERS)
def test_what_waited_for_longer_than_its_sender_is_refused(sim: ArmedDaemon, order: str) -> None:
    kind, fields = ORDERS[order]
    request, before = kind(lease=sim.token, **fields), sim.core.order
    most = sim.config.command if kind is JogRequest else PATIENCE
    with pytest.raises(RequestError, match=r"this waited for \d\.\d s in the daemon") as refused:
        sim.core.handle(request, sim.now, sim.now - most)
    assert (refused.value.code, refused.value.retryable) == ("late", True)
    assert (sim.core.order, sim.core.mode, sim.core.skill) == (before, Mode.ARMED, None)
    sim.core.handle(request, sim.now, sim.now - most // 2)


def test_a_jog_lives_from_when_it_came(sim: ArmedDaemon) -> None:
    came = sim.now - sim.config.command // 2
    sim.core.handle(JogRequest(lease=sim.token, rate_rad_per_s={"joint1": 0.1}), sim.now, came)
    while sim.core.mode is Mode.MOVING:
        sim.keep(1)
    assert sim.core.mode is Mode.HOLDING
    assert 0 <= sim.core.since - (came + sim.config.command) < SECOND // 20


class SlowHandler:
    """Works on a message until it is told to go on; `came`: times of all."""

    boot_id = "b"

    def __init__(self) -> None:
        self.go_on, self.came = threading.Event(), list[int]()
        self.both = threading.Event()

    def handle(self, _: str, __: Message, came: int) -> Message:
        self.go_on.wait(30.0)
        self.came.append(came)
        if len(self.came) == 2:
            self.both.set()
        return Reply(boot_id="b", seq=0, t_mono_ns=0, t_wall_ns=0, mode="")

    def report_refusal(self, _: str, error: Exception) -> None:
        raise error


def test_a_message_that_waits_behind_another_counts_from_when_it_came() -> None:
    session, handler = FakeZenohSession(), SlowHandler()
    ZenohServer(session, "rover", handler, (), Inbox)  # type: ignore[arg-type]
    jog = pack(JogRequest(lease="a", rate_rad_per_s={"joint1": 0.1}))
    for _ in range(2):
        session.put("lrm/rover/cmd/jog", jog)
    inbox = Inbox()
    inbox.put(0, lambda: lambda: None)
    while not inbox.came:
        threading.Event().wait(0.001)
    handler.go_on.set()
    assert handler.both.wait(30.0)
    assert handler.came[0] <= handler.came[1] <= inbox.came


@pytest.fixture
def losing(sim: ArmedDaemon) -> LosingDaemon:
    return LosingDaemon(sim)


@pytest.fixture
def rover(losing: LosingDaemon) -> Iterator[Rover]:
    with losing.reachable(), Rover(losing.sim.config.robot) as rover, rover.control("me", take=True):
        yield rover


def ask(rover: Rover, what: str) -> None:
    """Asks for a motion."""
    if what == "rpc/skill":
        rover.skill("stow", wait=False, q_rad=[0.1] * 6)
    elif what == "rpc/arm":
        rover.arm("given", {"gripper": 0.0})
    else:
        rover.move(NEAR)


@pytest.mark.parametrize("lost", ["rpc/move", "rpc/skill", "rpc/arm", "state/skill", "state/mode"])
def test_where_a_reply_is_lost_the_arm_holds(losing: LosingDaemon, rover: Rover, lost: str) -> None:
    """Of the request, or to the question what came of it."""
    losing.lost = lost
    with pytest.raises(NoReply):
        ask(rover, "rpc/skill" if lost == "state/skill" else lost)
    losing.lost = ""
    losing.sim.run(5)
    there = losing.sim.ramp.position
    losing.sim.run(300)
    assert losing.sim.core.mode is Mode.HOLDING
    assert losing.sim.ramp.position == there


def test_the_reply_to_a_move_is_waited_for_while_its_swing_is_predicted(losing: LosingDaemon, rover: Rover) -> None:
    """On a busy computer that takes seconds; a client that gave up would hold the arm, and no move would end."""
    losing.lost, losing.late = "rpc/move", 4.0
    assert rover.move(NEAR) > 0.0
    assert losing.sim.core.mode is Mode.ARMED


@pytest.mark.parametrize("tail", ["rpc/move", "rpc/skill", "rpc/arm"])
def test_an_order_that_comes_after_its_sender_gave_up_is_refused(losing: LosingDaemon, rover: Rover, tail: str) -> None:
    losing.lost, losing.delays = tail, True
    with pytest.raises(NoReply):
        ask(rover, tail)
    (reply,) = losing.arrives()
    assert reply.ok is None
    losing.sim.run(300)
    assert losing.sim.core.mode is Mode.HOLDING
