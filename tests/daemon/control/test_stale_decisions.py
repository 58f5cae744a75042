"""Decisions by a report that is not true any more: the ramp or the board has moved on, or the API process was stopped
between a decision and its order. Nothing moves or gets pulses by that."""

from __future__ import annotations

from contextlib import suppress
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
    run_state_machine_as_test,
)

from lrm_math.errors import LrmError
from lrmd.config import SECOND, Config
from lrmd.control.state_machine import Mode
from lrmd.errors import RequestError
from lrmd.messages.codec import Message
from lrmd.messages.control import (
    ArmRequest,
    DisarmRequest,
    HoldRequest,
    JogRequest,
    LeaseRequest,
    MoveRequest,
    RelaxRequest,
    ResetRequest,
)
from lrmd.ramp.shared_memory import LinkState
from tests.support.daemon.armed_daemon import take
from tests.support.daemon.in_memory_daemon import WALL, config_at
from tests.support.daemon.unpunctual_daemon import UnpunctualDaemon

NAMES = [f"joint{i}" for i in range(1, 7)]
JOINT, ANGLE = st.sampled_from(NAMES[:2]), st.floats(-1.5, 1.5)
SHORT = st.sampled_from([0, 0, 0, 0, 1, 2, 5])
LONG = st.sampled_from([0, 0, 0, 1, 1, 2, 5, 40, 85])
RENEWED = 15
CONFIGS: list[Config] = []


@dataclass(frozen=True)
class DelayedRequest:
    """A request: ticks for which the API process is stopped after its decision, and before its order is written, and
    ticks to the next one."""

    kind: Any
    joint: str
    q: float
    undecided: int
    unwritten: int
    between: int


KINDS = [
    "given", "given", "stored", "board", "hold", "relax", "relax one", "relax one", "disarm", "reset", "move", "jog",
]  # fmt: skip
STEPS = st.lists(
    st.builds(DelayedRequest, st.sampled_from(KINDS), JOINT, ANGLE, LONG, LONG, SHORT), min_size=2, max_size=5
)
EVENTS = [
    "ramp killed", "ramp stopped", "brown-out", "unplugged", "api stopped", "estop", "estop, reset", "release",
    "daemon killed", "daemon killed",
]  # fmt: skip


class StaleDecisions(RuleBasedStateMachine):
    """Requests back to back, at any tick, by an API process that is stopped anywhere; faults of ramp and board."""

    @initialize(seed=st.integers(0, 2**16))
    def begin(self, seed: int) -> None:
        self.sim = UnpunctualDaemon(CONFIGS[0], seed=seed)
        self.token = ""
        self.keep(12)
        self.arm_all(0.0)

    def keep(self, ticks: int) -> None:
        for _ in range(ticks):
            if self.token and self.sim.ticks % RENEWED == 0:
                self.ask(LeaseRequest(action="renew", lease=self.token))
            self.sim.tick()

    def ask(self, request: Message, undecided: int = 0, unwritten: int = 0) -> None:
        with suppress(LrmError):
            self.sim.ask(request, undecided, unwritten)

    def take(self) -> None:
        self.token = take(self.sim)

    @rule(ticks=st.integers(1, 100))
    def go_on(self, ticks: int) -> None:
        self.keep(ticks)

    @rule(q=ANGLE)
    def arm_all(self, q: float) -> None:
        self.take()
        self.ask(ResetRequest(lease=self.token))
        self.sim.run(2)
        self.ask(ArmRequest(lease=self.token, where="given", q_rad=dict.fromkeys(NAMES[:2], q)))
        self.keep(45)

    @rule(steps=STEPS)
    def back_to_back(self, steps: list[DelayedRequest]) -> None:
        """Requests one right after the other."""
        self.take()
        for step in steps:
            self.ask(self.request(step), step.undecided, step.unwritten)
            self.sim.run(step.between)

    def request(self, step: DelayedRequest) -> Message:
        token = self.token or "none"
        match step.kind:
            case "given" | "stored" | "board":
                q = dict.fromkeys(NAMES[:2], step.q) if step.kind == "given" else {}
                return ArmRequest(lease=token, where=step.kind, q_rad=q)
            case "hold":
                return HoldRequest()
            case "relax":
                return RelaxRequest(lease=token)
            case "relax one":
                return RelaxRequest(lease=token, servos=[step.joint])
            case "disarm":
                return DisarmRequest(lease=token)
            case "reset":
                return ResetRequest(lease=token)
            case "jog":
                return JogRequest(lease=token, rate_rad_per_s={step.joint: step.q / 5})
        return MoveRequest(lease=token, waypoints=[{step.joint: step.q}, {step.joint: 0.0}])

    @rule(event=st.sampled_from(EVENTS), ticks=st.integers(1, 200))
    def happens(self, event: str, ticks: int) -> None:
        sim = self.sim
        match event:
            case "ramp killed":
                sim.restart_ramp()
            case "ramp stopped":
                sim.stop_ramp(ticks * sim.config.tick)
            case "daemon killed":
                sim.restart(ticks * sim.config.tick if ticks % 2 else 2 * SECOND)
                sim.run(ticks % 30)
            case "brown-out":
                sim.brown_out()
            case "unplugged":
                sim.unplugged = ticks
            case "api stopped":
                sim.suspend(ticks)
            case "release":
                self.ask(LeaseRequest(action="release", lease=self.token))
            case _:
                sim.estop(ticks % 4)
                for _ in range(6 if "reset" in event else 0):
                    self.take()
                    self.ask(ResetRequest(lease=self.token))
                    self.ask(ArmRequest(lease=self.token, where="given", q_rad={"joint1": 0.5}))
                    sim.run(1)

    @rule()
    def quiet(self) -> None:
        """Without faults for a while, an arm that is disarmed or stopped has no pulses."""
        sim = self.sim
        sim.unplugged = 0
        sim.run((sim.config.reply + sim.config.link.silence_ms * 1_000_000) // sim.config.tick + 30)
        assert sim.ramp.link is LinkState.READY
        if sim.core.mode in (Mode.DISARMED, Mode.ESTOP):
            assert not any(sim.outputs.values()), sim.core.mode

    @precondition(lambda self: hasattr(self, "sim"))
    @invariant()
    def the_ramp_refuses_nothing(self) -> None:
        """What it refuses is a fault of the software: the two contradict each other."""
        assert "order_refused" not in {event.code for event in self.sim.core.events}


@pytest.mark.long
def test_no_decision_by_an_old_report_moves_anything(tmp_path_factory: pytest.TempPathFactory) -> None:
    CONFIGS[:] = [config_at(330.0, tmp_path_factory.mktemp("c"))]
    run_state_machine_as_test(
        StaleDecisions,
        settings=settings(stateful_step_count=25, suppress_health_check=list(HealthCheck), deadline=None),
    )  # type: ignore[no-untyped-call]


@pytest.fixture(scope="module")
def two_on(config: Config) -> StaleDecisions:
    """Two joints that a client has armed."""
    CONFIGS[:] = [config]
    machine = StaleDecisions()
    machine.begin(1)
    return machine


def pulses(sim: UnpunctualDaemon) -> list[float | None]:
    return list(sim.outputs.values())[:2]


GAPS = pytest.mark.parametrize("gap", range(4))
"""Ticks between a decision and its order."""


@GAPS
@pytest.mark.parametrize("where", ["given", "stored", "board"])
@pytest.mark.parametrize("end", [RelaxRequest, DisarmRequest])
def test_an_arm_whose_pulses_are_being_ended_is_not_armed(
    two_on: StaleDecisions, end: type[RelaxRequest | DisarmRequest], where: Any, gap: int
) -> None:
    """The report says that it is on, and by then it is not: it was switched on again where it had been, all at once."""
    sim, token = (machine := deepcopy(two_on)).sim, two_on.token
    sim.ask(end(lease=token))
    q = dict.fromkeys(NAMES[:2], 0.7) if where == "given" else {}
    with pytest.raises(RequestError, match="has not read") as refused:
        sim.ask(ArmRequest(lease=token, where=where, q_rad=q), 0, gap)
    assert refused.value.code == "busy"
    machine.keep(30)
    assert pulses(sim) == [None, None]


@GAPS
def test_servos_that_are_released_one_after_the_other_are_all_off(two_on: StaleDecisions, gap: int) -> None:
    sim, token = (machine := deepcopy(two_on)).sim, two_on.token
    for joint in NAMES[:2]:
        sim.ask(RelaxRequest(lease=token, servos=[joint]), 0, gap)
    machine.keep(30)
    assert pulses(sim) == [None, None]
    assert not sim.core.faults


@GAPS
def test_a_hold_in_the_middle_of_arming_is_no_fault(config: Config, gap: int) -> None:
    """The order to switch the next servo on may not have been read yet."""
    sim = UnpunctualDaemon(config)
    sim.run(30)
    sim.ask(ArmRequest(lease=take(sim), where="given", q_rad=dict.fromkeys(NAMES, 0.0)))
    for _ in range(20):
        sim.run(1)
        held = deepcopy(sim)
        held.cycle()
        held.ask(HoldRequest(), 0, gap)
        held.run(20)
        assert held.core.mode is Mode.HOLDING, held.core.why


def test_a_relax_that_a_fault_of_the_ramp_voided_is_carried_out(two_on: StaleDecisions) -> None:
    sim, token = (machine := deepcopy(two_on)).sim, two_on.token
    sim.ask(RelaxRequest(lease=token))
    sim.restart_ramp()
    machine.keep(40)
    assert (sim.core.mode, pulses(sim)) == (Mode.DISARMED, [None, None])


def test_an_emergency_stop_that_its_ramp_took_with_it_is_carried_out(two_on: StaleDecisions) -> None:
    """The ramp was killed between reading it and its frame; the API process knows of it."""
    sim = (machine := deepcopy(two_on)).sim
    sim.core.estop(sim.now, "x")
    sim.restart_ramp()
    machine.keep(40)
    assert (sim.core.mode, pulses(sim)) == (Mode.ESTOP, [None, None])


def test_a_relax_without_a_link_is_carried_out_when_it_is_back(two_on: StaleDecisions) -> None:
    sim, token = (machine := deepcopy(two_on)).sim, two_on.token
    sim.unplugged = 20
    machine.keep(10)
    sim.ask(RelaxRequest(lease=token))
    machine.keep(60)
    assert sim.ramp.link is LinkState.READY
    assert (sim.core.mode, pulses(sim)) == (Mode.FAULT, [None, None])


def test_a_reset_does_not_take_a_relax_back(two_on: StaleDecisions) -> None:
    sim, token = (machine := deepcopy(two_on)).sim, two_on.token
    sim.unplugged = 20
    machine.keep(60)
    assert sim.core.mode is Mode.FAULT
    sim.ask(RelaxRequest(lease=token))
    sim.ask(ResetRequest(lease=token))
    machine.keep(30)
    assert (sim.core.mode, pulses(sim)) == (Mode.DISARMED, [None, None])


def test_an_order_that_is_written_when_its_client_is_gone_moves_nothing(two_on: StaleDecisions) -> None:
    """The API process was stopped between its decision and its order, for longer than a lease."""
    for undecided, unwritten in ((0, 90), (90, 0), (300, 0), (0, 300)):
        sim = (machine := deepcopy(two_on)).sim
        before = pulses(sim)
        sim.ask(MoveRequest(lease=two_on.token, waypoints=[{"joint1": 1.0}]), undecided, unwritten)
        machine.keep(30)
        assert (sim.core.mode, pulses(sim)) == (Mode.HOLDING, before)


def test_the_stored_pose_is_that_at_which_the_pulses_ended(two_on: StaleDecisions) -> None:
    """Not that of the last cycle of the API process: it may come late."""
    sim, token = (machine := deepcopy(two_on)).sim, two_on.token
    sim.core.stored = sim.core.saved(WALL)
    sim.ask(MoveRequest(lease=token, waypoints=[{"joint1": 0.01}]))
    for _ in range(30):
        sim.suspend(1)
        sim.core.observe(sim.report, sim.now)
        sim.ask(LeaseRequest(action="renew", lease=token))
    there = pulses(sim)
    sim.ask(RelaxRequest(lease=token))
    sim.suspend(2)
    sim.ask(ArmRequest(lease=token, where="stored", servos=NAMES[:2]))
    machine.keep(60)
    assert pulses(sim) == there
