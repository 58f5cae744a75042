"""Thermal protection follows from the level, whatever happened before: the arm's own torques, a fast time constant."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_math.errors import LrmError
from lrmd.config import Config, load_config
from lrmd.control.state_machine import Mode
from lrmd.errors import RequestError
from lrmd.messages.codec import Message
from lrmd.messages.control import (
    ArmRequest,
    HoldRequest,
    JogRequest,
    LeaseRequest,
    MoveRequest,
    RelaxRequest,
    ResetRequest,
)
from lrmd.persistence.state_file import StoredState
from lrmd.ramp.shared_memory import LinkState
from lrmd.safety.thermal_model import gravity_torques
from tests.support.daemon.armed_daemon import ArmedDaemon, take
from tests.support.daemon.in_memory_daemon import CONFIG, CYCLE, WALL
from tests.support.sweep import examples

SECOND = 1_000_000_000
TIME_CONSTANT = 10.0
STRETCHED = [0.0] * 6
"""rad: joint 2 carries 0.89 N m and would reach 327 degC, joint 4 173 degC."""
LEANING = [0.0, -0.6, 0.0, 0.0, 0.0, 0.0]
"""rad: joint 2 carries 0.43 N m and would stay at 94 degC: hot, never too hot."""


@pytest.fixture(scope="module")
def config() -> Config:
    shipped = load_config(CONFIG)
    thermal = shipped.thermal.model_copy(update={"time_constant_s": TIME_CONSTANT})
    return replace(shipped, thermal=thermal, stagger=20_000_000)


class HeatingDaemon(ArmedDaemon):
    """A simulated daemon with the arm's own torques, and a client that keeps its lease while `keeps_lease`."""

    def __init__(self, config: Config, stored: StoredState | None = None) -> None:
        self.keeps_lease = False
        super().__init__(config, stored)
        self.core.motion_check.torques = gravity_torques(self.config.arm, self.config.arm.gravity)
        assert self.ramp.link is LinkState.READY
        self.keeps_lease, self.token = True, take(self)

    def request(self, message: Message) -> None:
        self.core.handle(message, self.now)

    def tick(self) -> None:
        if self.keeps_lease and self.ticks % 20 == 0:
            with suppress(LrmError):
                self.request(LeaseRequest(action="renew", lease=self.token))
        super().tick()

    def seconds(self, seconds: float) -> None:
        self.run(math.ceil(seconds * SECOND / self.config.tick))

    def switch_on(self, q: list[float], *others: str) -> None:
        angles = self.named(q) | dict.fromkeys(others, 0.0)
        self.request(ArmRequest(lease=self.token, where="given", q_rad=angles))

    def heat(self, degrees: float, joint: int = 2) -> None:
        T = list(self.core.thermal.temperature)
        T[joint - 1] = degrees
        self.core.thermal.temperature = tuple(T)

    @property
    def hottest(self) -> float:
        """degC, of the servos that have pulses."""
        pulsing = [i for i, pulse in self.outputs.items() if pulse is not None]
        return max((self.core.thermal.temperature[i] for i in pulsing), default=25.0)

    @property
    def at_rest(self) -> bool:
        assert self.config.rest is not None
        now = self.core.angles(self.ramp.position)
        return all(a == pytest.approx(b, abs=1e-3) for a, b in zip(self.config.rest, now, strict=False))

    def codes(self) -> list[str]:
        return [event.code for event in self.core.events]


def stored_at(degrees: float) -> StoredState:
    return StoredState(
        saved_wall_ns=WALL, boots=1, mode="armed", still=True, pulse_ns={}, temperature_c={"joint2": degrees}
    )


@pytest.fixture
def sim(config: Config) -> HeatingDaemon:
    return HeatingDaemon(config)


@pytest.fixture
def leaning(sim: HeatingDaemon) -> HeatingDaemon:
    """With pulses for a second."""
    sim.switch_on(LEANING)
    sim.seconds(1)
    return sim


def armed_hot(config: Config, degrees: float) -> HeatingDaemon:
    """Heated while it was disarmed: no level changes while it is armed."""
    sim = HeatingDaemon(config)
    sim.heat(degrees)
    sim.seconds(0.2)
    return sim


def restarted_hot(config: Config, degrees: float) -> HeatingDaemon:
    return HeatingDaemon(config, stored=stored_at(degrees))


def reset_hot(config: Config, degrees: float) -> HeatingDaemon:
    """Heated by its own weight until the pulses stopped, then reset."""
    sim = HeatingDaemon(config)
    sim.switch_on(STRETCHED)
    sim.seconds(8)
    assert sim.core.mode is Mode.FAULT
    assert sim.limp
    sim.request(ResetRequest(lease=sim.token))
    sim.heat(degrees)
    return sim


WAYS = [armed_hot, restarted_hot, reset_hot]


@pytest.mark.long
@pytest.mark.parametrize("way", WAYS)
def test_a_servo_that_is_too_hot_is_not_switched_on_and_the_refusal_says_when_it_is_cool_enough(config, way) -> None:
    sim = way(config, 120.0)
    with pytest.raises(RequestError, match=r"joint2 is at 1\d\d degC .* below 85 degC, in \d+ s") as refused:
        sim.switch_on(STRETCHED)
    assert (refused.value.code, refused.value.retryable) == ("too_warm", True)
    assert sim.core.mode is Mode.DISARMED
    seconds = refused.value.detail["seconds"]
    assert seconds == pytest.approx(TIME_CONSTANT * math.log(95 / 60), rel=0.1)
    sim.seconds(seconds - 0.5)
    with pytest.raises(RequestError, match="too hot to be switched on"):
        sim.switch_on(STRETCHED)
    sim.seconds(0.6)
    sim.switch_on(STRETCHED)


@pytest.mark.long
@pytest.mark.parametrize("way", WAYS)
def test_a_servo_that_is_armed_just_below_the_limit_stops_at_it(config, way) -> None:
    """The weight of the stretched arm heats it by 27 degC in a second: faster than it can go to rest."""
    sim = way(config, 96.0)
    while sim.core.thermal.temperature[1] >= 84.9:
        sim.tick()
    sim.switch_on(STRETCHED)
    highest = 0.0
    for _ in range(600):
        sim.tick()
        highest = max(highest, sim.hottest)
    assert sim.core.mode is Mode.FAULT
    assert "too_hot" in sim.core.faults
    assert sim.limp
    assert 85 < highest < 98, "it stops within one update of the model"


@pytest.mark.parametrize("way", WAYS)
def test_a_hot_arm_is_not_armed_since_it_would_move_at_once(config, way) -> None:
    sim = way(config, 92.0)
    with pytest.raises(RequestError, match="below 85 degC"):
        sim.switch_on(LEANING)
    sim.seconds(1)
    assert sim.limp


@pytest.mark.slow
def test_an_arm_that_gets_hot_goes_to_rest_and_cools_down_there(leaning: HeatingDaemon) -> None:
    leaning.heat(92.0)
    leaning.seconds(4)
    assert leaning.core.mode is Mode.ARMED
    assert leaning.at_rest
    assert not leaning.limp
    leaning.seconds(3 * TIME_CONSTANT)
    assert leaning.hottest < 40
    leaning.request(MoveRequest(lease=leaning.token, waypoints=[{"joint1": 0.05}]))
    leaning.seconds(1)
    assert leaning.core.mode is Mode.ARMED
    assert not leaning.at_rest


def test_a_start_with_a_stored_heat_is_reported(config) -> None:
    assert "servo_hot" in restarted_hot(config, 90.0).codes()
    assert "servo_too_hot" in restarted_hot(config, 120.0).codes()
    assert "servo_hot" not in restarted_hot(config, 60.0).codes()


def unplugged(sim: HeatingDaemon) -> HeatingDaemon:
    """For so long that the link is lost; the pulses stay."""
    sim.unplugged = 20
    sim.seconds(0.5)
    assert (sim.core.mode, sim.limp) == (Mode.FAULT, False)
    return sim


def test_pulses_that_a_fault_left_on_stop_when_the_servo_is_too_hot(leaning: HeatingDaemon) -> None:
    assert "too_hot" not in unplugged(leaning).core.faults
    leaning.heat(96.0)
    leaning.seconds(0.3)
    assert "too_hot" in leaning.core.faults
    assert leaning.limp


def test_the_pulses_stop_as_soon_as_the_link_is_back(leaning: HeatingDaemon) -> None:
    leaning.unplugged = 60
    leaning.seconds(0.1)
    leaning.heat(96.0)
    while leaning.unplugged:
        leaning.tick()
    assert not leaning.limp
    leaning.seconds(0.3)
    assert leaning.limp
    assert leaning.codes().count("servo_too_hot") == 1


def under_way_to_rest(sim: HeatingDaemon) -> None:
    sim.switch_on(STRETCHED, "gripper")
    sim.seconds(1)
    sim.heat(30.0)
    sim.heat(93.0, joint=1)
    sim.seconds(0.5)
    assert sim.core.mode is Mode.MOVING


def keep_hot(sim: HeatingDaemon, seconds: float) -> Iterator[None]:
    """Time passes while joint 1, which carries nothing, stays hot and the others cool."""
    end = sim.now + int(seconds * SECOND)
    while sim.now < end:
        sim.heat(86.0, joint=1)
        sim.heat(30.0, joint=2)
        sim.heat(30.0, joint=4)
        sim.tick()
        yield


@pytest.mark.long
def test_a_client_that_dies_or_fights_for_the_lease_does_not_stop_the_way_to_rest(sim: HeatingDaemon) -> None:
    under_way_to_rest(sim)
    sim.keeps_lease = False
    for step in keep_hot(sim, 6):
        assert step is None
        if sim.ticks % 2:
            sim.token = take(sim)
    assert sim.at_rest
    assert "a hot servo goes to rest" in [e.text.partition(": ")[2] for e in sim.core.events if e.code == "mode"]


def test_requests_to_move_are_refused_while_the_arm_goes_to_rest(sim: HeatingDaemon) -> None:
    under_way_to_rest(sim)
    for request in (
        MoveRequest(lease=sim.token, waypoints=[{"gripper": 0.1}]),
        JogRequest(lease=sim.token, rate_rad_per_s={"gripper": 0.1}),
    ):
        with pytest.raises(RequestError, match=r"joint1 is at 90 degC .* below 85 degC") as refused:
            sim.request(request)
        assert refused.value.code == "too_warm"


@pytest.mark.slow
def test_a_hold_stops_the_way_to_rest_for_ten_seconds(sim: HeatingDaemon) -> None:
    """Somebody may be in the way; the documentation says so."""
    under_way_to_rest(sim)
    sim.request(HoldRequest())
    list(keep_hot(sim, 0.2))
    there = sim.ramp.position
    for _ in keep_hot(sim, 9.5):
        assert sim.ramp.position == there
    assert sim.core.mode is Mode.HOLDING
    list(keep_hot(sim, 6))
    assert sim.at_rest


def test_an_arm_whose_way_to_rest_is_blocked_says_so_once_and_may_be_moved(leaning: HeatingDaemon) -> None:
    blocked = True

    def guard(path: list[list[float]], *_: object) -> None:
        if blocked and path[-1][1] < -0.7:
            raise LrmError("a wall")

    leaning.core.motion_check.guard = guard
    leaning.heat(90.0)
    leaning.seconds(3)
    assert leaning.core.mode is Mode.ARMED
    assert leaning.codes().count("rest_blocked") == 1
    assert "waypoint" not in next(e.text for e in leaning.core.events if e.code == "rest_blocked")
    leaning.request(MoveRequest(lease=leaning.token, waypoints=[{"joint2": -0.65}]))
    leaning.seconds(1)
    assert leaning.core.angles(leaning.ramp.position)[1] == pytest.approx(-0.65, abs=1e-3)
    blocked = False
    leaning.heat(90.0)
    leaning.seconds(4)
    assert leaning.at_rest
    assert leaning.codes().count("rest_blocked") == 1


def test_a_reset_of_a_hot_arm_moves_nothing_and_the_next_motion_brings_it_to_rest(leaning: HeatingDaemon) -> None:
    leaning.heat(90.0)
    there = unplugged(leaning).ramp.position
    leaning.request(ResetRequest(lease=leaning.token))
    leaning.heat(90.0)
    leaning.seconds(0.5)
    assert (leaning.core.mode, leaning.ramp.position) == (Mode.HOLDING, there)
    assert leaning.codes().count("rest_waits") == 1
    with pytest.raises(RequestError, match=r"would hold 0\.89 instead of 0\.43 Nm"):
        leaning.request(MoveRequest(lease=leaning.token, waypoints=[{"joint2": 0.0}]))
    leaning.request(MoveRequest(lease=leaning.token, waypoints=[{"joint2": -0.65}]))
    leaning.seconds(4)
    assert leaning.at_rest


def test_an_arm_that_cooled_after_a_reset_goes_to_rest_when_it_is_hot_again(leaning: HeatingDaemon) -> None:
    unplugged(leaning).request(ResetRequest(lease=leaning.token))
    leaning.seconds(0.2)
    assert "rest_waits" not in leaning.codes()
    leaning.heat(90.0)
    leaning.seconds(4)
    assert leaning.at_rest


ACTIONS = st.sampled_from(["arm", "move", "hold", "relax", "reset", "estop", "lease", "no lease", "ramp", "unplug"])


@pytest.mark.slow
@examples(4, 8)
@given(st.lists(st.tuples(ACTIONS, st.integers(0, 200)), min_size=5, max_size=15), st.floats(25.0, 140.0))
def test_no_sequence_of_requests_and_faults_heats_a_servo_with_pulses_beyond_the_limit(actions, degrees) -> None:
    sim = HeatingDaemon(CONFIGS[0], stored=stored_at(degrees))
    too_hot = 0
    for action, ticks in itertools.chain([("arm", 100)], actions):
        with suppress(LrmError):
            match action:
                case "arm":
                    sim.switch_on(STRETCHED)
                case "move":
                    sim.request(MoveRequest(lease=sim.token, waypoints=[{"joint2": 0.3}, {"joint2": -0.5}]))
                case "hold":
                    sim.request(HoldRequest())
                case "relax":
                    sim.request(RelaxRequest(lease=sim.token, servos=["joint1"]))
                case "reset":
                    sim.request(ResetRequest(lease=sim.token))
                case "estop":
                    sim.estop()
                case "lease" | "no lease":
                    sim.keeps_lease = action == "lease"
                    sim.token = take(sim)
                case "ramp":
                    sim.restart_ramp()
                case "unplug":
                    sim.unplugged = ticks // 10
        for _ in range(ticks):
            sim.tick()
            linked = sim.ramp.link is LinkState.READY
            too_hot = too_hot + 1 if linked and sim.hottest >= 95.0 else 0
            assert too_hot <= 3 * CYCLE, "a servo that is too hot has pulses although the board could be told"


CONFIGS: list[Config] = []


@pytest.fixture(scope="module", autouse=True)
def _configs(config: Config) -> None:
    CONFIGS.append(config)
