"""An arm whose pulses ended in motion or under load is not armed where it stood: read from the counts of the board."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrmd.config import Config
from lrmd.control.state_machine import Mode
from lrmd.errors import RequestError
from lrmd.messages.control import (
    ArmRequest,
    DisarmRequest,
    HoldRequest,
    MoveRequest,
    PayloadRequest,
    RelaxRequest,
    ResetRequest,
)
from tests.support.daemon.armed_daemon import ArmedDaemon, take
from tests.support.daemon.in_memory_daemon import SimulatedDaemon

LOADED, BALANCED = (0.0, 0.4, 0.0, 0.0, 0.0, 0.0), (0.0, -0.03, 0.0, 0.01, 0.0, 0.0)


def armed(config: Config, torque: tuple[float, ...]) -> ArmedDaemon:
    sim = ArmedDaemon(config, torque=torque)
    sim.arm("given", [0.0] * 6)
    sim.core.stored = sim.core.saved(1)
    return sim


ENDS: dict[str, Callable[[SimulatedDaemon], object]] = {
    "estop": SimulatedDaemon.estop,
    "relax": lambda sim: sim.core.handle(RelaxRequest(lease=take(sim)), sim.now),
    "relax joint 2": lambda sim: sim.core.handle(RelaxRequest(lease=take(sim), servos=["joint2"]), sim.now),
    "disarm": lambda sim: sim.core.handle(DisarmRequest(lease=take(sim)), sim.now),
    "silence": lambda sim: sim.stop_ramp(1_200_000_000),
}


def arm_at_stored(sim: SimulatedDaemon) -> None:
    if sim.core.mode in (Mode.ESTOP, Mode.FAULT):
        sim.core.handle(ResetRequest(lease=take(sim)), sim.now)
        sim.run(6)
    sim.core.stored = sim.core.saved(2)
    try:
        sim.core.handle(ArmRequest(lease=take(sim), where="stored"), sim.now)
    finally:
        sim.run(30)


def on(sim: SimulatedDaemon) -> int:
    return sum(pulse is not None for pulse in sim._pulses().values())


@pytest.mark.parametrize("end", ENDS)
def test_pulses_that_end_under_load_leave_no_stored_pose(config: Config, end: str) -> None:
    sim = armed(config, LOADED)
    ENDS[end](sim)
    sim.run(90)
    before = on(sim)
    with pytest.raises(RequestError, match="its pulses ended in motion or under load") as refused:
        arm_at_stored(sim)
    assert refused.value.code == "pose_needed"
    assert "lrm arm --at SERVO ANGLE" in str(refused.value), "what to type"
    assert on(sim) == before


def test_of_an_armed_arm_it_is_not_said_that_no_pulses_are_there(config: Config) -> None:
    sim = armed(config, BALANCED)
    servos = sim.report.outputs
    with pytest.raises(RequestError, match="only pulses of this daemon, which go on"):
        sim.core.handle(ArmRequest(lease=take(sim), where="board"), sim.now)
    assert sim.report.outputs == servos


@pytest.mark.parametrize("end", ["estop", "relax", "disarm"])
def test_an_arm_in_balance_stays_where_it_was(config: Config, end: str) -> None:
    sim = armed(config, BALANCED)
    ENDS[end](sim)
    sim.run(30)
    arm_at_stored(sim)
    assert on(sim) > 0


@pytest.mark.parametrize("end", ["estop", "relax"])
def test_pulses_that_end_in_motion_leave_none_either(config: Config, end: str) -> None:
    sim = armed(config, BALANCED)
    sim.core.handle(MoveRequest(lease=take(sim), waypoints=[{"joint1": 0.5}]), sim.now)
    sim.run(30)
    ENDS[end](sim)
    sim.run(90)
    with pytest.raises(RequestError, match="its pulses ended in motion"):
        arm_at_stored(sim)
    assert on(sim) == 0


@pytest.mark.long
@given(at=st.integers(0, 12), held=st.booleans())
def test_at_whatever_tick_of_a_motion(config: Config, at: int, held: bool) -> None:
    """Known only if no step was made, or the motion had ended before."""
    sim = armed(config, BALANCED)
    sim.core.handle(MoveRequest(lease=take(sim), waypoints=[{"joint1": 0.5}]), sim.now)
    before = sim.core.position
    sim.run(at)
    if held:
        sim.core.handle(HoldRequest(), sim.now)
        sim.run(6)
    moved = sim.ramp.position != before[: len(sim.ramp.position)]
    sim.estop()
    sim.run(6)
    assert bool(sim.core.fallen.bits) == (moved and not held)


def another_joint_moves(sim: SimulatedDaemon) -> None:
    sim.core.handle(MoveRequest(lease=take(sim), waypoints=[{"joint1": 0.02}]), sim.now)


def another_load(sim: SimulatedDaemon) -> None:
    sim.core.handle(PayloadRequest(lease=take(sim), payload_kg=0.05), sim.now)


def the_rover_leans(sim: SimulatedDaemon) -> None:
    sim.core.motion_check.torques = lambda *_: LOADED


LATER = {"another joint moves": another_joint_moves, "another load": another_load, "the rover leans": the_rover_leans}


@pytest.mark.parametrize("later", LATER)
@pytest.mark.parametrize("bears_more", [False, True])
def test_a_joint_that_stayed_may_fall_later(config: Config, later: str, bears_more: bool) -> None:
    """Released in balance; then it bears more, and nobody has told."""
    sim = armed(config, BALANCED)
    sim.core.handle(RelaxRequest(lease=take(sim), servos=["joint2"]), sim.now)
    sim.run(30)
    assert not sim.core.fallen.bits
    if bears_more:
        sim.torque = LOADED
    if bears_more or later != "the rover leans":
        LATER[later](sim)
    sim.run(60)
    joint2 = 1 << config.names.index("joint2")
    assert bool(sim.core.fallen.bits & joint2) == bears_more
    stored = sim.core.saved(2)
    assert ("joint2" in stored.fallen) == bears_more
    if bears_more:
        sim.core.stored = stored
        with pytest.raises(RequestError, match="the arm fell"):
            sim.core.handle(ArmRequest(lease=take(sim), where="stored", servos=["joint2"]), sim.now)


def test_it_is_stored_for_the_next_start_also_of_servos_that_still_have_pulses(config: Config) -> None:
    sim = armed(config, LOADED)
    stored = sim.core.saved(3)
    assert stored.fallen == list(config.names)
    assert stored.still
    later = SimulatedDaemon(config, stored=stored)
    later.run(30)
    with pytest.raises(RequestError, match="the arm fell"):
        arm_at_stored(later)
    later.core.handle(ArmRequest(lease=take(later), where="given", q_rad={"joint2": 0.1}), later.now)
    later.run(30)
    assert later.core.fallen.names(later.core.fallen.bits) == [n for n in config.names if n != "joint2"]


def test_a_state_file_that_does_not_say_it_is_no_pose(config: Config) -> None:
    stored = armed(config, BALANCED).core.saved(3)
    assert stored.fallen == []
    older = SimulatedDaemon(config, stored=stored.model_copy(update={"fallen": None}))
    older.run(30)
    with pytest.raises(RequestError, match="the arm fell"):
        arm_at_stored(older)


def test_the_bound_is_that_of_the_configuration(config: Config) -> None:
    sim = armed(replace(config, unpowered=0.5), LOADED)
    ENDS["relax"](sim)
    sim.run(6)
    arm_at_stored(sim)
    assert on(sim) > 0
