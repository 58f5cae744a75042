"""Safety invariants of controller, ramp and simulated board together: no pulse jumps, no motion without a request."""

from __future__ import annotations

import itertools
import math
from contextlib import suppress

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from lrm_math.errors import LrmError
from lrmd.config import load_config
from lrmd.control.lease import Lease
from lrmd.control.motion_predictor import MotionPredictor
from lrmd.control.state_machine import LIVE, TABLE, Mode, Trigger, next_mode
from lrmd.messages.control import (
    LEASE_LOST,
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
from tests.support.daemon.armed_daemon import ArmedDaemon, take
from tests.support.daemon.in_memory_daemon import CONFIG, SimulatedDaemon, config_at
from tests.support.motion_models import swinging

SECOND = 1_000_000_000
TICK = 6_500_000


@pytest.fixture
def sim(config) -> ArmedDaemon:
    sim = ArmedDaemon(config)
    assert sim.ramp.link is LinkState.READY
    return sim


def armed(sim: ArmedDaemon, q: float = 0.0) -> ArmedDaemon:
    sim.arm("given", [q] * 6)
    return sim


def on_its_way(sim: ArmedDaemon, ticks: int = 0) -> ArmedDaemon:
    """Armed, and for so many ticks on a long way of joint 1."""
    armed(sim).start([1.5])
    sim.keep(ticks)
    return sim


def commanded(sim: SimulatedDaemon, joint: int) -> float:
    return sim.core.angles(sim.ramp.position)[joint - 1]


def test_it_boots_disarmed_with_outputs_off(sim: ArmedDaemon) -> None:
    assert (sim.core.mode, sim.limp) == (Mode.DISARMED, True)


def test_arming_at_an_unknown_position_is_refused(sim: ArmedDaemon) -> None:
    with pytest.raises(LrmError, match="where each servo that is off stands"):
        sim.core.handle(ArmRequest(lease=take(sim)), sim.now)


def test_arming_switches_the_servos_on_one_after_the_other_at_their_positions(sim: ArmedDaemon) -> None:
    sim.token, counts = take(sim), []
    sim.core.handle(ArmRequest(lease=sim.token, where="given", q_rad=sim.named([0.5] * 6)), sim.now)
    for _ in range(250):
        sim.keep(1)
        counts.append(sum(pulse is not None for pulse in sim.outputs.values()))
    assert counts[-1] == 6
    assert max(b - a for a, b in itertools.pairwise(counts)) == 1
    assert commanded(sim, 3) == pytest.approx(0.5, abs=1e-6)


def test_a_move_ends_at_its_target(sim: ArmedDaemon) -> None:
    armed(sim)
    request = MoveRequest(lease=sim.token, waypoints=[{"joint1": 0.4}, {"joint1": 0.1, "joint5": -0.3}])
    seconds = sim.core.handle(request, sim.now).seconds
    sim.keep(int(seconds * SECOND / TICK) + 30)
    assert sim.core.mode is Mode.ARMED
    assert sim.q == pytest.approx([0.1, 0.0, 0.0, 0.0, -0.3, 0.0], abs=1e-6)


def test_a_lost_lease_holds_within_half_a_second(sim: ArmedDaemon) -> None:
    on_its_way(sim)
    sim.core.handle(LeaseRequest(action="renew", lease=sim.token), sim.now)
    start = sim.now
    while sim.ramp.moving or sim.core.mode is Mode.MOVING:
        sim.tick()
    assert sim.now - start <= SECOND // 2
    assert sim.core.mode is Mode.HOLDING
    assert 0 < commanded(sim, 1) < 1.5


def test_a_late_client_gets_its_lease_back_unless_another_had_it(sim: ArmedDaemon) -> None:
    def acquire(token: str, take: bool = False) -> Lease:
        return sim.core.handle(LeaseRequest(action="acquire", holder="test", lease=token, take=take), sim.now).lease

    token = on_its_way(sim).token
    with pytest.raises(LrmError, match="has not expired"):
        acquire(token, take=True)
    sim.run(200)
    assert (sim.core.mode, sim.core.why) == (Mode.HOLDING, LEASE_LOST)
    stopped = commanded(sim, 1)
    again = acquire(token).token
    sim.run(20)
    assert commanded(sim, 1) == stopped
    with pytest.raises(LrmError, match="lease"):  # what was under way with the old token stays refused
        sim.start([1.5])
    sim.token = again
    sim.start([1.5])
    sim.run(200)
    sim.core.handle(LeaseRequest(action="release", lease=take(sim)), sim.now)
    with pytest.raises(LrmError, match="another client had one since"):
        acquire(again)


def test_a_jog_that_is_not_renewed_holds(sim: ArmedDaemon) -> None:
    armed(sim)
    sim.core.handle(JogRequest(lease=sim.token, rate_rad_per_s={"joint2": -0.1}), sim.now)
    sim.keep(60)
    assert sim.core.mode is Mode.MOVING
    assert commanded(sim, 2) == pytest.approx(-0.1 * 60 * TICK / SECOND, rel=0.2)
    sim.keep(40)
    assert sim.core.mode is Mode.HOLDING


def test_a_jog_stops_where_the_guard_fails(sim: ArmedDaemon) -> None:
    """A guard may fail for another reason than a collision: no equilibrium of the sagging arm."""

    def failing_guard(*_: object) -> None:
        raise LrmError("the arm does not settle")

    armed(sim)
    sim.core.handle(JogRequest(lease=sim.token, rate_rad_per_s={"joint2": -0.1}), sim.now)
    sim.keep(20)
    assert sim.core.mode is Mode.MOVING
    sim.core.motion_check.guard = failing_guard
    sim.keep(20)
    assert sim.core.mode is Mode.HOLDING
    assert [h.text for h in sim.core.events if h.code == "jog_stopped"] == ["the arm does not settle"]
    with pytest.raises(LrmError, match="does not settle"):
        sim.start([0.1])
    assert sim.core.mode is Mode.HOLDING


def test_a_jog_holds_where_a_servo_cannot_turn_so_fast(sim: ArmedDaemon) -> None:
    """A servo's table is steeper on one side of the middle. The refusal ended the daemon's loop, and the arm fell."""
    armed(sim, q=-0.2)
    request = JogRequest(lease=sim.token, rate_rad_per_s={"joint4": 0.2955})
    sim.core.handle(request, sim.now)
    while sim.core.mode is Mode.MOVING:
        sim.keep(15)
        if sim.core.orders.jog is not None:
            sim.core.handle(request, sim.now)
    assert (sim.core.mode, sim.core.why) == (Mode.HOLDING, "the jog may not go on")
    assert "at most" in next(event.text for event in sim.core.events if event.code == "jog_stopped")
    assert abs(commanded(sim, 4)) < 0.1


def test_an_emergency_stop_takes_two_ticks_at_most(sim: ArmedDaemon) -> None:
    armed(sim).estop()
    sim.run(2)
    assert sim.limp
    sim.run(10)
    assert sim.core.mode is Mode.ESTOP
    sim.core.handle(ResetRequest(lease=take(sim)), sim.now)
    sim.run(100)
    assert (sim.core.mode, sim.limp) == (Mode.DISARMED, True)


def test_a_lost_stop_frame_is_sent_again(sim: ArmedDaemon) -> None:
    armed(sim).lost_in = 5
    sim.estop()
    sim.run(8)
    assert sim.limp


def test_a_restarted_ramp_adopts_the_registers_of_the_board_without_motion(sim: ArmedDaemon) -> None:
    on_its_way(sim, 50).restart_ramp()
    sim.keep(5)
    there = commanded(sim, 1)
    assert sim.core.mode is Mode.HOLDING
    sim.keep(100)
    assert commanded(sim, 1) == there > 0
    assert sum(pulse is not None for pulse in sim.outputs.values()) == 6


@pytest.mark.parametrize("seconds", [0.3, 0.8, 3.0])
def test_a_suspended_ramp_never_switches_a_sagged_arm_on(sim: ArmedDaemon, seconds: float) -> None:
    on_its_way(sim, 50).stop_ramp(int(seconds * SECOND))
    silent = sim.limp
    sim.run(200)
    if silent:
        assert (sim.core.mode, sim.limp) == (Mode.FAULT, True)
    else:
        assert not sim.ramp.moving


def test_a_brown_out_is_a_fault_and_a_reset_moves_nothing(sim: ArmedDaemon) -> None:
    armed(sim).brown_out()
    sim.run(60)
    assert sim.core.mode is Mode.FAULT
    assert "board_restarted" in sim.core.faults
    sim.core.handle(ResetRequest(lease=take(sim)), sim.now)
    sim.run(100)
    assert (sim.core.mode, sim.limp) == (Mode.DISARMED, True)


def test_a_stall_lengthens_a_move_and_the_arm_still_arrives(sim: ArmedDaemon) -> None:
    seconds = armed(sim).start([0.4])
    sim.keep(20)
    sim.stall = 8
    sim.keep(int(seconds * SECOND / TICK) + 30)
    assert commanded(sim, 1) == pytest.approx(0.4, abs=1e-6)
    assert sim.core.mode is Mode.ARMED


@pytest.mark.long
@given(stall=st.integers(1, 70))
def test_with_the_shipped_link_times_a_stall_below_490_ms_ends_no_motion(stall: int) -> None:
    """70 ticks are 455 ms; the frame before and the answer after take two more. No pulse jumps afterwards."""
    sim = armed(ArmedDaemon(load_config(CONFIG)))
    seconds = sim.start([0.2])
    sim.keep(20)
    sim.stall = stall
    sim.keep(int(seconds * SECOND / TICK) + stall + 30)
    assert (sim.core.mode, dict(sim.core.faults)) == (Mode.ARMED, {})
    assert commanded(sim, 1) == pytest.approx(0.2, abs=1e-6)


def test_a_reconnected_board_stays_without_motion_until_a_reset(sim: ArmedDaemon) -> None:
    on_its_way(sim, 30).unplugged = 20
    sim.keep(60)
    assert (sim.core.mode, sim.ramp.link) == (Mode.FAULT, LinkState.READY)
    there = commanded(sim, 1)
    sim.core.handle(ResetRequest(lease=sim.token), sim.now)
    sim.keep(60)
    assert sim.core.mode is Mode.HOLDING
    assert commanded(sim, 1) == there


def test_a_silent_api_freezes_the_ramp(sim: ArmedDaemon) -> None:
    on_its_way(sim, 9).api_stopped = True
    sim.run(80)
    assert not sim.ramp.moving
    sim.api_stopped = False
    sim.run(9)
    assert sim.core.mode is Mode.HOLDING


def test_the_pose_of_a_pulsing_board_is_adopted_without_a_step(sim: ArmedDaemon) -> None:
    armed(sim, q=0.7)
    later = ArmedDaemon(sim.config, board=sim.board, now=sim.now)
    later.largest_step = 0.0
    later.arm("board")
    later.keep(200)
    assert later.core.mode is Mode.ARMED
    assert later.largest_step == 0.0
    assert sum(pulse is not None for pulse in later.outputs.values()) == 6


@pytest.mark.slow
def test_hot_servos_derate_then_rest_then_stop(sim: ArmedDaemon) -> None:
    armed(sim).torque = (0.0, 0.0, 0.0, 0.25, 0.0, 0.0)
    modes = []
    for _ in range(3000):
        sim.now += SECOND
        take(sim)
        sim.board._last_arm = sim.ramp._link._last_sent = sim.now
        sim.run(6)
        modes.append(sim.core.mode)
        if "too_hot" in sim.core.faults:
            break
    codes = [h.code for h in sim.core.events]
    assert codes.index("servo_warm") < codes.index("servo_hot") < codes.index("servo_too_hot")
    assert Mode.MOVING in modes
    sim.run(20)
    assert (sim.core.mode, sim.limp) == (Mode.FAULT, True)


def test_a_warm_servo_accepts_no_pose_with_more_torque(sim: ArmedDaemon) -> None:
    armed(sim)
    sim.core.thermal.temperature = (75.0, *sim.core.thermal.temperature[1:])
    sim.core.motion_check.torques = lambda q, *_: (q[0], 0, 0, 0, 0, 0)
    with pytest.raises(LrmError, match="75 degC"):
        sim.start([0.5])
    sim.start([0.0, 0.5])


def test_every_mode_can_be_left_and_only_resets_leave_fault_and_estop() -> None:
    for mode in (Mode.FAULT, Mode.ESTOP):
        for trigger in Trigger:
            if (mode, trigger) not in TABLE:
                with pytest.raises(LrmError, match=mode):
                    next_mode(mode, trigger)
                continue
            after = next_mode(mode, trigger)
            assert after in (Mode.FAULT, Mode.ESTOP) or trigger in (Trigger.RESET_OUTPUTS_OFF, Trigger.RESET_OUTPUTS_ON)
    for mode in Mode:
        assert next_mode(mode, Trigger.ESTOP) is Mode.ESTOP


ANGLE = st.floats(-2.0, 2.0)
JOINT = st.integers(1, 6).map(lambda n: f"joint{n}")


class DaemonStateMachine(RuleBasedStateMachine):
    """Random sequences of requests, faults and process restarts. `SimulatedDaemon` checks every tick."""

    @initialize(hz=st.sampled_from([50.0, 330.0]), seed=st.integers(0, 2**32))
    def begin(self, hz: float, seed: int) -> None:
        self.sim = SimulatedDaemon(CONFIGS[hz], seed=seed)
        self.sim.core.motion = MotionPredictor(CONFIGS[hz], swinging(joint1=(3.0, 0.03), joint2=(4.0, 0.05)))
        self.token = "none"
        self.sim.run(10)

    def ask(self, request) -> None:
        with suppress(LrmError):
            self.sim.core.handle(request, self.sim.now)

    @rule(ticks=st.integers(1, 120))
    def wait(self, ticks: int) -> None:
        self.sim.run(ticks)

    @rule(ticks=st.integers(1, 120))
    def wait_with_a_renewed_lease(self, ticks: int) -> None:
        for _ in range(ticks):
            if self.sim.ticks % 20 == 0:
                self.ask(LeaseRequest(action="renew", lease=self.token))
            self.sim.tick()

    @rule(take=st.booleans())
    def take_lease(self, take: bool) -> None:
        with suppress(LrmError):
            done = self.sim.core.handle(LeaseRequest(action="acquire", holder="x", take=take), self.sim.now)
            self.token = done.lease.token

    @rule(q=st.dictionaries(JOINT, ANGLE, max_size=6), where=st.sampled_from(["given", "stored", "board"]))
    def arm(self, q: dict[str, float], where) -> None:
        self.take_lease(True)
        self.ask(ArmRequest(lease=self.token, where=where, q_rad=q if where == "given" else {}))

    @rule()
    def arm_all(self) -> None:
        self.take_lease(True)
        self.ask(ArmRequest(lease=self.token, where="given", q_rad={f"joint{i}": 0.0 for i in range(1, 7)}))
        self.wait_with_a_renewed_lease(250)

    @rule(
        way=st.lists(st.dictionaries(JOINT, ANGLE, min_size=1, max_size=6), min_size=1, max_size=3),
        pace=st.sampled_from(["together", "each"]), speed=st.floats(0.05, 1.0),
        shaping=st.sampled_from([None, "zv", "zvd", "zvdd", "timed"]),
    )  # fmt: skip
    def move(self, way, pace, speed: float, shaping) -> None:
        self.take_lease(True)
        self.sim.settle()
        self.ask(MoveRequest(lease=self.token, waypoints=way, pace=pace, speed=speed, shaping=shaping))

    @rule(rates=st.dictionaries(JOINT, st.floats(-0.4, 0.4), max_size=3))
    def jog(self, rates: dict[str, float]) -> None:
        self.sim.settle()
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
        w = self.sim
        undisturbed = not (w.stall or w.lost_in or w.unplugged) and w.ramp.link is LinkState.READY
        w.estop()
        w.run(2)
        if undisturbed and w.ramp.link is LinkState.READY:
            assert w.limp

    @rule(frames=st.integers(1, 20), where=st.sampled_from(["lost_in", "lost_out", "stall", "unplugged"]))
    def disturb(self, frames: int, where: str) -> None:
        setattr(self.sim, where, frames)

    @rule()
    def brown_out(self) -> None:
        self.sim.brown_out()

    @rule(ticks=st.integers(1, 120))
    def silence_chip(self, ticks: int) -> None:
        """The chip does not acknowledge for some time, then the line is free of faults."""
        self.sim.board.chip.answers = False
        self.sim.run(ticks)
        self.restore_line()

    @rule()
    def restore_line(self) -> None:
        """Without faults on the line, the link is ready once the board has stopped pulses of which it is in doubt."""
        w = self.sim
        w.stall = w.lost_in = w.lost_out = w.unplugged = 0
        w.board.chip.answers = True
        w.run((w.config.reply + w.config.link.silence_ms * 1_000_000) // TICK + 20)
        assert w.ramp.link is LinkState.READY

    @rule()
    def kill_ramp(self) -> None:
        self.sim.restart_ramp()

    @rule(seconds=st.floats(0.01, 2.5))
    def stop_ramp(self, seconds: float) -> None:
        self.sim.stop_ramp(int(seconds * SECOND))

    @rule(jump=st.integers(-3 * SECOND, 3 * SECOND))
    def late_ticks(self, jump: int) -> None:
        """The machine was busy, for whatever time: only forward, since the clock is monotonic."""
        self.sim.now += abs(jump)
        self.sim.board.tick(self.sim.now)
        self.sim.outputs = self.sim._pulses()

    @rule(stopped=st.booleans())
    def stop_api(self, stopped: bool) -> None:
        self.sim.api_stopped = stopped

    @precondition(lambda self: hasattr(self, "sim"))
    @invariant()
    def modes_agree_with_outputs(self) -> None:
        w = self.sim
        if w.core.mode is Mode.DISARMED and not w.api_stopped and w.report.order == w.core.order.number:
            assert not (w.report.outputs and w.report.order_accepted)
        if w.core.mode in (Mode.FAULT, Mode.ESTOP, Mode.DISARMED):
            assert not w.core.orders.legs
        assert all(math.isfinite(T) for T in w.core.thermal.temperature)
        assert w.core.mode in (*LIVE, Mode.DISARMED, Mode.FAULT, Mode.ESTOP)


CONFIGS: dict[float, object] = {}


@pytest.mark.slow
def test_state_machine(tmp_path_factory) -> None:
    from hypothesis.stateful import run_state_machine_as_test

    for hz in (50.0, 330.0):
        CONFIGS[hz] = config_at(hz, tmp_path_factory.mktemp("c"))
    run_state_machine_as_test(
        DaemonStateMachine, settings=settings(stateful_step_count=25, suppress_health_check=list(HealthCheck))
    )
