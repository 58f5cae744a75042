"""A request that says how many stops its sender knows of moves nothing after a stop that it does not know of."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from copy import deepcopy

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrmd.api.children import board_settings
from lrmd.config import Config
from lrmd.control.state_machine import InvalidTransition, Mode
from lrmd.errors import RequestError
from lrmd.messages.control import (
    ArmRequest,
    DisarmRequest,
    HoldRequest,
    JogRequest,
    MotionRequest,
    MoveRequest,
    RelaxRequest,
    ResetRequest,
)
from lrmd.ramp.core import RampCore
from lrmd.ramp.process import last_report
from lrmd.ramp.shared_memory import CHECK, RampFault, SharedRecords
from tests.support.daemon.armed_daemon import ArmedDaemon, take
from tests.support.daemon.in_memory_daemon import SimulatedDaemon

HOME = {f"joint{i}": 0.0 for i in range(1, 7)}


@pytest.fixture(scope="module")
def armed(config: Config) -> ArmedDaemon:
    sim = ArmedDaemon(config)
    sim.arm("given", [0.0] * 6)
    return sim


STOPS: dict[str, Callable[[SimulatedDaemon, str], object]] = {
    "hold": lambda sim, _: sim.core.handle(HoldRequest(), sim.now),
    "estop": lambda sim, _: sim.estop(),
    "relax": lambda sim, token: sim.core.handle(RelaxRequest(lease=token), sim.now),
    "relax one": lambda sim, token: sim.core.handle(RelaxRequest(lease=token, servos=["joint6"]), sim.now),
    "disarm": lambda sim, token: sim.core.handle(DisarmRequest(lease=token), sim.now),
    "brown-out": lambda sim, _: (sim.brown_out(), sim.run(10)),
    "the ramp restarts": lambda sim, _: (sim.restart_ramp(), sim.run(6)),
}
ORDERS: dict[str, Callable[[str, int], MotionRequest]] = {
    "move": lambda token, stops: MoveRequest(lease=token, stops=stops, waypoints=[{"joint1": 1.0}]),
    "jog": lambda token, stops: JogRequest(lease=token, stops=stops, rate_rad_per_s={"joint1": 0.2}),
    "arm": lambda token, stops: ArmRequest(lease=token, stops=stops, where="given", q_rad=HOME),
}


@pytest.mark.long
@given(
    stop=st.sampled_from(sorted(STOPS)), order=st.sampled_from(sorted(ORDERS)), moving=st.integers(0, 20),
    late=st.integers(0, 15),
)  # fmt: skip
def test_what_was_asked_for_before_a_stop_moves_nothing_after_it(
    armed: ArmedDaemon, stop: str, order: str, moving: int, late: int
) -> None:
    sim, token = deepcopy(armed), armed.token
    asked = ORDERS[order](token, sim.core.stops)
    if moving and stop != "disarm":
        sim.core.handle(MoveRequest(lease=token, stops=sim.core.stops, waypoints=[{"joint2": 0.3}]), sim.now)
        sim.run(moving)
    STOPS[stop](sim, token)
    sim.run(3)
    pulses = sim._pulses()
    sim.run(late)
    with pytest.raises(RequestError, match="stopped since") as refused:
        sim.core.handle(asked, sim.now)
    assert refused.value.code == "overtaken"
    sim.run(30)
    assert sim._pulses() == pulses


def test_a_hold_that_the_mode_refuses_counts_as_well(config: Config) -> None:
    sim = SimulatedDaemon(config)
    sim.run(30)
    token, before = take(sim), sim.core.stops
    with pytest.raises(InvalidTransition) as refused:
        sim.core.handle(HoldRequest(), sim.now)
    assert refused.value.detail["stops"] == before + 1
    with pytest.raises(RequestError, match="stopped since"):
        sim.core.handle(ORDERS["arm"](token, before), sim.now)
    sim.core.handle(ORDERS["arm"](token, before + 1), sim.now)


def test_an_order_that_the_ramp_reads_after_its_fault_moves_nothing(armed: ArmedDaemon) -> None:
    """The fault comes between the report that a request was answered by and the tick that reads its order."""
    sim = deepcopy(armed)
    sim.core.observe(sim.report, sim.now)
    sim.ramp._freeze(RampFault.REFUSED)
    sim.report = sim._report()
    sim.core.handle(MoveRequest(lease=sim.token, stops=sim.core.stops, waypoints=[{"joint1": 1.0}]), sim.now)
    pulses = sim._pulses()
    sim.cycle()
    sim.run(30)
    assert sim.core.mode is Mode.FAULT
    assert (sim._pulses(), sim.ramp.moving) == (pulses, False)


def killed_while_it_reports(sim: SimulatedDaemon) -> RampCore:
    """The next ramp process, after one that was killed in the middle of writing its report."""
    shared = SharedRecords.create()
    shared.write_order(sim.core.order)
    shared.write_report(sim.report)
    shared.values.report[CHECK] ^= 0xFF
    return RampCore(board_settings(sim.config), last_report(shared))


def test_a_ramp_killed_while_it_reports_moves_no_servo(armed: ArmedDaemon) -> None:
    """Nor does one lose its pulses, by a hold, a reset, or the release of another: the board's are taken over."""
    sim = deepcopy(armed)
    sim.go([0.5] + [0.0] * 5)
    sim.ramp, sim.held_out = killed_while_it_reports(sim), b""
    pulses = sim._pulses()
    sim.keep(40)
    assert sim.core.mode is Mode.FAULT
    with suppress(InvalidTransition):
        STOPS["hold"](sim, sim.token)
    sim.keep(10)
    with pytest.raises(RequestError, match="still pulsing"):
        STOPS["relax one"](sim, sim.token)
    sim.core.handle(ResetRequest(lease=sim.token), sim.now)
    sim.keep(10)
    assert sim.core.mode is Mode.DISARMED
    sim.arm("board")
    assert sim._pulses() == pulses


def test_an_order_that_is_not_to_arm_switches_nothing_on(armed: ArmedDaemon) -> None:
    """Whatever the two processes believe of each other: only the order of an arming has first pulses."""
    sim = deepcopy(armed)
    sim.go([0.5] + [0.0] * 5)
    sim.ramp.outputs = 0
    pulses = sim.ramp.position
    sim.core.handle(HoldRequest(), sim.now)
    sim.run(6)
    assert (sim.ramp.outputs, sim.ramp.position, sim.ramp.fault) == (0, pulses, RampFault.REFUSED)


@pytest.mark.parametrize("interrupted", ["the ramp restarts", "the cable is pulled"])
def test_a_released_servo_is_not_switched_on_where_it_once_was(armed: ArmedDaemon, interrupted: str) -> None:
    """What was read from the board when the link came back is not true any more after a move."""
    sim = deepcopy(armed)
    if interrupted == "the ramp restarts":
        sim.restart_ramp()
    else:
        sim.unplugged = 80
    sim.keep(150)
    if sim.core.mode is Mode.FAULT:
        sim.core.handle(ResetRequest(lease=sim.token), sim.now)
    sim.go([0.0] * 5 + [0.5])
    STOPS["relax one"](sim, sim.token)
    sim.settle()
    for _ in range(6):
        with suppress(RequestError):
            sim.core.handle(ArmRequest(lease=sim.token, where="board"), sim.now)
        sim.keep(1)
    sim.keep(30)
    assert sim._pulses()[5] is None
    sim.core.handle(ArmRequest(lease=sim.token, where="given", q_rad={"joint6": 0.5}), sim.now)
    sim.until(Mode.ARMED)
    assert sim.q[5] == pytest.approx(0.5, abs=1e-5)
