"""A request that says how many stops its sender knows of moves nothing after a stop that it does not know of."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrmd.config import Config
from lrmd.control.state_machine import InvalidTransition
from lrmd.errors import RequestError
from lrmd.messages.control import (
    ArmRequest,
    DisarmRequest,
    HoldRequest,
    JogRequest,
    MotionRequest,
    MoveRequest,
    RelaxRequest,
)
from tests.support.daemon.armed_daemon import ArmedDaemon, take
from tests.support.daemon.in_memory_daemon import SimulatedDaemon, config_at

HOME = {f"joint{i}": 0.0 for i in range(1, 7)}


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> Config:
    folder: Path = tmp_path_factory.mktemp("config")
    return config_at(330.0, folder)


@pytest.fixture(scope="module")
def armed(config: Config) -> ArmedDaemon:
    sim = ArmedDaemon(config)
    sim.arm("given", [0.0] * 6)
    return sim


def estop(sim: SimulatedDaemon, _: str) -> None:
    sim.estop_requested = True
    sim.core.estop(sim.now, "x")


def brown_out(sim: SimulatedDaemon, _: str) -> None:
    sim.board.power_cycle(sim.now)
    sim.outputs = sim._pulses()
    sim.run(10)


STOPS: dict[str, Callable[[SimulatedDaemon, str], object]] = {
    "hold": lambda sim, _: sim.core.handle(HoldRequest(), sim.now),
    "estop": estop,
    "relax": lambda sim, token: sim.core.handle(RelaxRequest(lease=token), sim.now),
    "relax one": lambda sim, token: sim.core.handle(RelaxRequest(lease=token, servos=["joint6"]), sim.now),
    "disarm": lambda sim, token: sim.core.handle(DisarmRequest(lease=token), sim.now),
    "brown-out": brown_out,
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
    late=st.integers(0, 20),
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
