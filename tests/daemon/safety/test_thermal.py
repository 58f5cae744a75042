"""Properties of the thermal model and of the thermal monitor."""

from __future__ import annotations

import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from lrmd.config import Config, load_config
from lrmd.errors import RequestError
from lrmd.persistence.state_file import StoredState
from lrmd.safety.thermal_model import ThermalLevel, ThermalModel, ThermalMonitor
from tests.support.daemon.in_memory_daemon import CONFIG

SECOND = 1_000_000_000
MODEL = ThermalModel.of(load_config(CONFIG))
N = len(MODEL.rise)
TEMPERATURES = st.lists(st.floats(-20, 150), min_size=N, max_size=N)
TORQUES = st.lists(st.floats(-2, 2), min_size=N, max_size=N)
SECONDS = st.floats(0, 1e5)


@given(TEMPERATURES, TORQUES, SECONDS, SECONDS)
def test_two_steps_are_one_step_of_their_sum(T: list[float], tau: list[float], a: float, b: float) -> None:
    assert MODEL.after(b, MODEL.after(a, T, tau), tau) == pytest.approx(MODEL.after(a + b, T, tau), rel=1e-9, abs=1e-9)


@given(TEMPERATURES, TORQUES, SECONDS)
def test_temperature_is_even_and_monotonic_in_the_torque(T: list[float], tau: list[float], s: float) -> None:
    here = MODEL.after(s, T, tau)
    assert MODEL.after(s, T, [-t for t in tau]) == here
    assert all(b >= a - 1e-9 for a, b in zip(here, MODEL.after(s, T, [1.1 * t for t in tau]), strict=True))


@given(TEMPERATURES, TORQUES)
def test_it_solves_its_differential_equation(T: list[float], tau: list[float]) -> None:
    """dT/dt = (T_ambient + rise tau^2 - T) / T_c, by a central difference."""
    h = 1e-2
    later, now = MODEL.after(2 * h, T, tau), MODEL.after(h, T, tau)
    for T0, T1, T2, t, rise in zip(T, now, later, tau, MODEL.rise, strict=True):
        slope = (MODEL.ambient + rise * t * t - T1) / MODEL.time_constant
        assert (T2 - T0) / (2 * h) == pytest.approx(slope, rel=1e-4, abs=1e-6)


@given(TEMPERATURES, TORQUES, SECONDS)
def test_a_temperature_stays_between_its_start_and_its_limit(T: list[float], tau: list[float], s: float) -> None:
    for was, now, t, rise in zip(T, MODEL.after(s, T, tau), tau, MODEL.rise, strict=True):
        final = MODEL.ambient + rise * t * t
        assert min(was, final) - 1e-9 <= now <= max(was, final) + 1e-9


@given(TEMPERATURES, TORQUES)
def test_no_time_changes_nothing_and_long_times_reach_the_steady_state(T: list[float], tau: list[float]) -> None:
    assert MODEL.after(0.0, T, tau) == pytest.approx(T)
    assert MODEL.after(-5.0, T, tau) == pytest.approx(T), "a wall clock that was set back heats nothing"
    final = [MODEL.ambient + rise * t * t for rise, t in zip(MODEL.rise, tau, strict=True)]
    assert MODEL.after(1e6, T, tau) == pytest.approx(final)


@given(st.floats(25, 140), st.floats(25, 140), st.floats(-1, 1))
def test_the_time_to_a_limit_is_when_it_is_reached(limit: float, T: float, tau: float) -> None:
    rise = 1490.0
    one = ThermalModel(25.0, 900.0, (rise,), (70.0, 85.0, 95.0))
    seconds = one.seconds_to(limit, T, tau, rise)
    assert seconds >= 0
    assert (seconds == 0) is (limit <= T)
    if math.isinf(seconds):
        assert one.after(1e7, [T], [tau])[0] <= limit + 1e-9
    elif seconds:
        assume(seconds < 1e5)
        assert one.after(seconds, [T], [tau])[0] == pytest.approx(limit, abs=1e-6)


def test_each_limit_means_one_level_more(config: Config) -> None:
    t = config.thermal
    for limit, below, level in [
        (t.derate_c, ThermalLevel.COOL, ThermalLevel.WARM), (t.rest_c, ThermalLevel.WARM, ThermalLevel.HOT),
        (t.off_c, ThermalLevel.HOT, ThermalLevel.TOO_HOT),
    ]:  # fmt: skip
        assert MODEL.level(limit - 1e-9) is below
        assert MODEL.level(limit) is level


def test_the_melted_mount_of_the_source_would_not_have_melted() -> None:
    """Conenna 2024, section 5.4: joint 4 at 0.31 Nm RMS passed 150 degC after about 30 minutes. Rest comes before."""
    joint4 = MODEL.rise[3]
    alone = MODEL.after(1800.0, MODEL.cold(), [0.0, 0.0, 0.0, 0.31, 0.0, 0.0] + [0.0] * (N - 6))
    assert alone[3] == pytest.approx(150.0, abs=5.0)
    rest = MODEL.seconds_to(MODEL.limits[1], MODEL.ambient, 0.31, joint4)
    assert 0 < rest < 1800 / 2
    melts = MODEL.seconds_to(100.0, MODEL.ambient, 0.31, joint4)
    assert MODEL.seconds_to(MODEL.limits[2], MODEL.ambient, 0.31, joint4) < melts, "ASA softens near 100 degC"


def stored(T: float, seconds_ago: float) -> StoredState:
    return StoredState(
        saved_wall_ns=int(1e18 - seconds_ago * SECOND), boots=1, mode="armed", still=True, pulse_ns={},
        temperature_c={"joint4": T},
    )  # fmt: skip


def test_temperatures_survive_a_restart(config: Config) -> None:
    at_once = ThermalMonitor(config, stored(90.0, 0.0), 0, 10**18).temperature
    later = ThermalMonitor(config, stored(90.0, 900.0), 0, 10**18).temperature
    clock_set_back = ThermalMonitor(config, stored(90.0, -9e5), 0, 10**18).temperature
    assert at_once[3] == clock_set_back[3] == 90.0
    assert later[3] == pytest.approx(25 + 65 / math.e)
    assert at_once[0] == config.thermal.ambient_c


@pytest.mark.slow
@given(st.lists(st.floats(0.05, 50), min_size=1, max_size=20))
def test_the_monitor_agrees_with_the_model_at_any_interval(steps: list[float]) -> None:
    monitor = ThermalMonitor(load_config(CONFIG), None, 0, 0)
    tau, now = [0.3] * N, 0
    for step in steps:
        now += int(step * SECOND)
        monitor.update(now, tau)
    assert monitor.temperature == pytest.approx(MODEL.after(now / SECOND, MODEL.cold(), tau), abs=1e-6)


@pytest.mark.slow
def test_every_level_change_is_reported_once(config: Config) -> None:
    monitor, now, seen = ThermalMonitor(config, None, 0, 0), 0, []
    for tau in (0.31, 0.0):
        for _ in range(4000):
            now += SECOND
            assert monitor.due(now)
            seen += [c.after for c in monitor.update(now, [0, 0, 0, tau] + [0] * (N - 4))]
    up = [ThermalLevel.WARM, ThermalLevel.HOT, ThermalLevel.TOO_HOT]
    assert seen == [*up, ThermalLevel.HOT, ThermalLevel.WARM, ThermalLevel.COOL]


def test_a_warm_servo_may_be_loaded_less_but_not_more(config: Config) -> None:
    monitor = ThermalMonitor(config, stored(75.0, 0.0), 0, 10**18)
    now = [0.0, 0.0, 0.0, -0.2] + [0.0] * (N - 4)
    for load, allowed in [(-0.2, True), (0.2, True), (0.1, True), (0.21, False), (-0.3, False)]:
        then = [5.0, 0.0, 0.0, load] + [0.0] * (N - 4)
        if allowed:
            monitor.check_load(now, then)
            continue
        with pytest.raises(RequestError, match="joint4") as caught:
            monitor.check_load(now, then)
        assert caught.value.retryable


def test_time_to_hot_counts_down(config: Config) -> None:
    monitor = ThermalMonitor(config, None, 0, 0)
    tau = [0, 0, 0, 0.31] + [0] * (N - 4)
    monitor.update(SECOND, tau)
    first = monitor.time_to_hot
    monitor.update(101 * SECOND, tau)
    assert first[3] - monitor.time_to_hot[3] == pytest.approx(100.0)
    assert math.isinf(first[0])
