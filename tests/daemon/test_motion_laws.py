"""Core, ramp and board together, on the tests' own clock: whatever happens, no jump, and nothing moves unasked."""

from __future__ import annotations

import itertools
import math
from contextlib import suppress

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from lrm_math.errors import LrmError
from lrmd.control.state_machine import LIVE, TABLE, Mode, Trigger, follow
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
from tests.support.in_memory_daemon import World, config_at

SECOND = 1_000_000_000
TICK = 6_500_000


@pytest.fixture(scope="module")
def config(tmp_path_factory):
    return config_at(330.0, tmp_path_factory.mktemp("config"))


@pytest.fixture
def world(config) -> World:
    w = World(config)
    w.run(30)
    assert w.ramp.link is LinkState.READY
    return w


def lease(w: World) -> str:
    return w.core.handle(LeaseRequest(action="acquire", holder="test", take=True), w.now).lease.token


def keep(w: World, token: str, ticks: int) -> None:
    """Lets time pass with a client that keeps its lease alive."""
    for _ in range(ticks):
        if w.ticks % 15 == 0:
            w.core.handle(LeaseRequest(action="renew", lease=token), w.now)
        w.tick()


def armed(w: World, q: float = 0.0) -> str:
    token = lease(w)
    request = ArmRequest(lease=token, where="given", q_rad={f"joint{i}": q for i in range(1, 7)})
    seconds = w.core.handle(request, w.now).seconds
    keep(w, token, int(seconds * SECOND / TICK) + 60)
    assert w.core.mode is Mode.ARMED
    return token


def commanded(w: World, joint: int) -> float:
    return w.core.angles(w.ramp.position)[joint - 1]


def test_it_boots_disarmed_with_outputs_off(world: World) -> None:
    assert world.core.mode is Mode.DISARMED
    assert all(pulse is None for pulse in world.outputs.values())


def test_arming_without_knowing_where_the_arm_stands_is_refused(world: World) -> None:
    with pytest.raises(LrmError, match="where the arm stands"):
        world.core.handle(ArmRequest(lease=lease(world)), world.now)


def test_arming_switches_one_servo_on_after_the_other_where_it_stands(world: World) -> None:
    token = lease(world)
    world.core.handle(ArmRequest(lease=token, where="given", q_rad={f"joint{i}": 0.5 for i in range(1, 7)}), world.now)
    counts = []
    for _ in range(250):
        keep(world, token, 1)
        counts.append(sum(pulse is not None for pulse in world.outputs.values()))
    assert counts[-1] == 6
    jumps = [b - a for a, b in itertools.pairwise(counts)]
    assert max(jumps) == 1
    assert commanded(world, 3) == pytest.approx(0.5, abs=1e-6)


def test_a_move_ends_at_its_target(world: World) -> None:
    token = armed(world)
    seconds = world.core.handle(
        MoveRequest(lease=token, waypoints=[{"joint1": 0.4}, {"joint1": 0.1, "joint5": -0.3}]), world.now
    ).seconds
    keep(world, token, int(seconds * SECOND / TICK) + 30)
    assert world.core.mode is Mode.ARMED
    assert commanded(world, 1) == pytest.approx(0.1, abs=1e-6)
    assert commanded(world, 5) == pytest.approx(-0.3, abs=1e-6)


def test_a_lost_lease_holds_within_half_a_second(world: World) -> None:
    token = armed(world)
    world.core.handle(MoveRequest(lease=token, waypoints=[{"joint1": 1.5}]), world.now)
    world.core.handle(LeaseRequest(action="renew", lease=token), world.now)
    start = world.now
    while world.ramp.moving or world.core.mode is Mode.MOVING:
        world.tick()
    assert world.now - start <= SECOND // 2
    assert world.core.mode is Mode.HOLDING
    assert 0 < commanded(world, 1) < 1.5


def test_a_jog_that_is_not_renewed_holds(world: World) -> None:
    token = armed(world)
    world.core.handle(JogRequest(lease=token, rate_rad_per_s={"joint2": -0.1}), world.now)
    keep(world, token, 60)
    assert world.core.mode is Mode.MOVING
    assert commanded(world, 2) == pytest.approx(-0.1 * 60 * TICK / SECOND, rel=0.2)
    keep(world, token, 40)
    assert world.core.mode is Mode.HOLDING


def test_a_jog_stops_where_nobody_can_tell_whether_the_way_is_free(world: World) -> None:
    """A guard may fail in another way than by a collision: the sagging arm does not settle, say."""
    token = armed(world)

    def unsure(*_: object) -> None:
        raise LrmError("the arm does not settle")

    world.core.handle(JogRequest(lease=token, rate_rad_per_s={"joint2": -0.1}), world.now)
    keep(world, token, 20)
    assert world.core.mode is Mode.MOVING
    world.core.way.guard = unsure
    keep(world, token, 20)
    assert world.core.mode is Mode.HOLDING
    assert [h.text for h in world.core.happenings if h.code == "jog_stopped"] == ["the arm does not settle"]
    with pytest.raises(LrmError, match="does not settle"):
        world.core.handle(MoveRequest(lease=token, waypoints=[{"joint1": 0.1}]), world.now)
    assert world.core.mode is Mode.HOLDING


def test_an_emergency_stop_takes_two_ticks_at_most(world: World) -> None:
    armed(world)
    world.rung = True
    world.core.estop(world.now, "test")
    world.run(2)
    assert all(pulse is None for pulse in world.outputs.values())
    world.run(10)
    assert world.core.mode is Mode.ESTOP
    world.core.handle(ResetRequest(lease=lease(world)), world.now)
    world.run(100)
    assert world.core.mode is Mode.DISARMED
    assert all(pulse is None for pulse in world.outputs.values())


def test_a_lost_stop_frame_is_sent_again(world: World) -> None:
    armed(world)
    world.lost_in = 5
    world.rung = True
    world.core.estop(world.now, "test")
    world.run(8)
    assert all(pulse is None for pulse in world.outputs.values())


def test_a_ramp_that_was_killed_takes_over_what_the_board_puts_out_and_stays(world: World) -> None:
    token = armed(world)
    world.core.handle(MoveRequest(lease=token, waypoints=[{"joint1": 1.5}]), world.now)
    keep(world, token, 50)
    world.restart_ramp()
    keep(world, token, 5)
    there = commanded(world, 1)
    assert world.core.mode is Mode.HOLDING
    keep(world, token, 100)
    assert commanded(world, 1) == there > 0
    assert sum(pulse is not None for pulse in world.outputs.values()) == 6


@pytest.mark.parametrize("seconds", [0.3, 0.8, 3.0])
def test_a_ramp_that_was_stopped_never_wakes_a_sagged_arm(world: World, seconds: float) -> None:
    token = armed(world)
    world.core.handle(MoveRequest(lease=token, waypoints=[{"joint1": 1.5}]), world.now)
    keep(world, token, 50)
    world.stop_ramp(int(seconds * SECOND))
    silent = [pulse is None for pulse in world.outputs.values()]
    world.run(200)
    if all(silent):
        assert world.core.mode is Mode.FAULT
        assert all(pulse is None for pulse in world.outputs.values())
    else:
        assert not world.ramp.moving


def test_a_brown_out_is_a_fault_and_a_reset_moves_nothing(world: World) -> None:
    armed(world)
    world.board.power_cycle(world.now)
    world.run(60)
    assert world.core.mode is Mode.FAULT
    assert "board_restarted" in world.core.faults
    world.core.handle(ResetRequest(lease=lease(world)), world.now)
    world.run(100)
    assert world.core.mode is Mode.DISARMED
    assert all(pulse is None for pulse in world.outputs.values())


def test_a_stall_lengthens_a_move_and_the_arm_still_arrives(world: World) -> None:
    token = armed(world)
    seconds = world.core.handle(MoveRequest(lease=token, waypoints=[{"joint1": 0.4}]), world.now).seconds
    keep(world, token, 20)
    world.stall = 8
    keep(world, token, int(seconds * SECOND / TICK) + 30)
    assert commanded(world, 1) == pytest.approx(0.4, abs=1e-6)
    assert world.core.mode is Mode.ARMED


def test_an_unplugged_board_that_comes_back_stands_still_until_it_is_reset(world: World) -> None:
    token = armed(world)
    world.core.handle(MoveRequest(lease=token, waypoints=[{"joint1": 1.5}]), world.now)
    keep(world, token, 30)
    world.unplugged = 20
    keep(world, token, 60)
    assert world.core.mode is Mode.FAULT
    assert world.ramp.link is LinkState.READY
    there = commanded(world, 1)
    world.core.handle(ResetRequest(lease=token), world.now)
    keep(world, token, 60)
    assert world.core.mode is Mode.HOLDING
    assert commanded(world, 1) == there


def test_a_silent_api_freezes_the_ramp(world: World) -> None:
    token = armed(world)
    world.core.handle(MoveRequest(lease=token, waypoints=[{"joint1": 1.5}]), world.now)
    keep(world, token, 9)
    world.api_stopped = True
    world.run(80)
    assert not world.ramp.moving
    world.api_stopped = False
    world.run(9)
    assert world.core.mode is Mode.HOLDING


def test_the_pose_of_a_pulsing_board_is_taken_over_without_a_step(world: World) -> None:
    armed(world, q=0.7)
    later = World(world.config, now=world.now)
    later.board, later.outputs = world.board, world.outputs
    later.run(10)
    token = lease(later)
    later.core.handle(ArmRequest(lease=token, where="board"), later.now)
    later.largest_step = 0.0
    keep(later, token, 200)
    assert later.core.mode is Mode.ARMED
    assert later.largest_step == 0.0
    assert sum(pulse is not None for pulse in later.outputs.values()) == 6


def test_hot_servos_derate_then_rest_then_stop(world: World) -> None:
    token = armed(world)
    world.torque = (0.0, 0.0, 0.0, 0.25, 0.0, 0.0)
    modes = []
    for _ in range(3000):
        world.now += SECOND
        world.core.handle(LeaseRequest(action="acquire", holder="test", take=True), world.now)
        world.board._heard = world.ramp._spoke = world.ramp._answered = world.now
        world.run(6)
        modes.append(world.core.mode)
        if "too_hot" in world.core.faults:
            break
    codes = [h.code for h in world.core.happenings]
    assert codes.index("servo_warm") < codes.index("servo_hot") < codes.index("servo_too_hot")
    assert Mode.MOVING in modes
    world.run(20)
    assert world.core.mode is Mode.FAULT
    assert all(pulse is None for pulse in world.outputs.values())
    assert token


def test_a_warm_servo_takes_no_pose_that_loads_it_more(world: World) -> None:
    token = armed(world)
    world.core.heat.temperature = (75.0, *world.core.heat.temperature[1:])
    world.core.way.torques = lambda q, _: (q[0], 0, 0, 0, 0, 0)
    with pytest.raises(LrmError, match="75 degC"):
        world.core.handle(MoveRequest(lease=token, waypoints=[{"joint1": 0.5}]), world.now)
    world.core.handle(MoveRequest(lease=token, waypoints=[{"joint2": 0.5}]), world.now)


def test_every_mode_can_be_left_and_only_resets_leave_fault_and_estop() -> None:
    for mode in (Mode.FAULT, Mode.ESTOP):
        for trigger in Trigger:
            if (mode, trigger) not in TABLE:
                with pytest.raises(LrmError, match=mode):
                    follow(mode, trigger)
                continue
            after = follow(mode, trigger)
            assert after in (Mode.FAULT, Mode.ESTOP) or trigger in (Trigger.RESET_LIMP, Trigger.RESET_STANDING)
    for mode in Mode:
        assert follow(mode, Trigger.ESTOP) is Mode.ESTOP


ANGLE = st.floats(-2.0, 2.0)
JOINT = st.integers(1, 6).map(lambda n: f"joint{n}")


class Daemon(RuleBasedStateMachine):
    """Anything that clients, cables, boards and processes may do, in any order. `World` checks every tick."""

    @initialize(hz=st.sampled_from([50.0, 330.0]), seed=st.integers(0, 2**32))
    def begin(self, hz: float, seed: int) -> None:
        self.world = World(CONFIGS[hz], seed=seed)
        self.token = "none"
        self.world.run(10)

    def ask(self, request) -> None:
        with suppress(LrmError):
            self.world.core.handle(request, self.world.now)

    @rule(ticks=st.integers(1, 120))
    def wait(self, ticks: int) -> None:
        self.world.run(ticks)

    @rule(ticks=st.integers(1, 120))
    def wait_with_a_living_client(self, ticks: int) -> None:
        for _ in range(ticks):
            if self.world.ticks % 20 == 0:
                self.ask(LeaseRequest(action="renew", lease=self.token))
            self.world.tick()

    @rule(take=st.booleans())
    def take_lease(self, take: bool) -> None:
        try:
            done = self.world.core.handle(LeaseRequest(action="acquire", holder="x", take=take), self.world.now)
            self.token = done.lease.token
        except LrmError:
            pass

    @rule(q=st.dictionaries(JOINT, ANGLE, max_size=6), where=st.sampled_from(["given", "stored", "board"]))
    def arm(self, q: dict[str, float], where) -> None:
        self.take_lease(True)
        self.ask(ArmRequest(lease=self.token, where=where, q_rad=q if where == "given" else {}))

    @rule()
    def arm_all(self) -> None:
        self.take_lease(True)
        self.ask(ArmRequest(lease=self.token, where="given", q_rad={f"joint{i}": 0.0 for i in range(1, 7)}))
        for _ in range(250):
            if self.world.ticks % 20 == 0:
                self.ask(LeaseRequest(action="renew", lease=self.token))
            self.world.tick()

    @rule(
        way=st.lists(st.dictionaries(JOINT, ANGLE, min_size=1, max_size=6), min_size=1, max_size=3),
        pace=st.sampled_from(["together", "each"]), speed=st.floats(0.05, 1.0),
    )  # fmt: skip
    def move(self, way, pace, speed: float) -> None:
        self.take_lease(True)
        self.ask(MoveRequest(lease=self.token, waypoints=way, pace=pace, speed=speed))

    @rule(rates=st.dictionaries(JOINT, st.floats(-0.4, 0.4), max_size=3))
    def jog(self, rates: dict[str, float]) -> None:
        self.ask(JogRequest(lease=self.token, rate_rad_per_s=rates))

    @rule(kind=st.sampled_from(["hold", "relax", "disarm", "reset"]))
    def simple(self, kind: str) -> None:
        requests = {
            "hold": HoldRequest(),
            "relax": RelaxRequest(lease=self.token),
            "disarm": DisarmRequest(lease=self.token),
            "reset": ResetRequest(lease=self.token),
        }
        self.ask(requests[kind])

    @rule()
    def estop(self) -> None:
        w = self.world
        undisturbed = not (w.stall or w.lost_in or w.unplugged) and w.ramp.link is LinkState.READY
        w.rung = True
        w.core.estop(w.now, "x")
        w.run(2)
        if undisturbed and w.ramp.link is LinkState.READY:
            assert all(pulse is None for pulse in w.outputs.values())

    @rule(frames=st.integers(1, 20), where=st.sampled_from(["lost_in", "lost_out", "stall", "unplugged"]))
    def disturb(self, frames: int, where: str) -> None:
        setattr(self.world, where, frames)

    @rule()
    def brown_out(self) -> None:
        self.world.board.power_cycle(self.world.now)
        self.world.outputs = self.world._pulses()

    @rule()
    def kill_ramp(self) -> None:
        self.world.restart_ramp()

    @rule(seconds=st.floats(0.01, 2.5))
    def stop_ramp(self, seconds: float) -> None:
        self.world.stop_ramp(int(seconds * SECOND))

    @rule(jump=st.integers(-3 * SECOND, 3 * SECOND))
    def late_ticks(self, jump: int) -> None:
        """The machine was busy, for whatever time: only forward, since the clock is monotonic."""
        self.world.now += abs(jump)
        self.world.board.tick(self.world.now)
        self.world.outputs = self.world._pulses()

    @rule(stopped=st.booleans())
    def stop_api(self, stopped: bool) -> None:
        self.world.api_stopped = stopped

    @precondition(lambda self: hasattr(self, "world"))
    @invariant()
    def modes_say_what_is_true(self) -> None:
        w = self.world
        if w.core.mode is Mode.DISARMED and not w.api_stopped and w.report.order == w.core.order.number:
            assert not (w.report.outputs and w.report.taken)
        if w.core.mode in (Mode.FAULT, Mode.ESTOP, Mode.DISARMED):
            assert not w.core.orders.waypoints
        assert all(math.isfinite(T) for T in w.core.heat.temperature)
        assert w.core.mode in (*LIVE, Mode.DISARMED, Mode.FAULT, Mode.ESTOP)


CONFIGS: dict[float, object] = {}


def test_state_machine(tmp_path_factory) -> None:
    from hypothesis.stateful import run_state_machine_as_test

    for hz in (50.0, 330.0):
        CONFIGS[hz] = config_at(hz, tmp_path_factory.mktemp("c"))
    run_state_machine_as_test(
        Daemon,
        settings=settings(
            max_examples=60, stateful_step_count=40, deadline=None, suppress_health_check=list(HealthCheck)
        ),
    )
