"""Direction of gravity that `cmd/gravity` tells: what is used when, and what is refused."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_math.arrays import ORIGIN, Vector3
from lrmd.config import SECOND, Config, load_config
from lrmd.control.gravity import PERIOD, STEP, KnownGravity, angle_between
from lrmd.errors import RequestError
from lrmd.messages.control import GravityCommand
from lrmd.safety.thermal_model import gravity_torques
from tests.support.daemon.in_memory_daemon import CONFIG, SimulatedDaemon

AGE = 10 * SECOND


@pytest.fixture(scope="module")
def config() -> Config:
    return load_config(CONFIG)


def leaning(degrees: float, size: float = 9.81) -> list[float]:
    """Gravity that leans towards x."""
    return [size * math.sin(math.radians(degrees)), 0.0, -size * math.cos(math.radians(degrees))]


def adopted(known: KnownGravity, now: int) -> Vector3 | None:
    return known.adopt(now) if known.due(now) else known.used


def test_it_follows_what_is_told_and_forgets_what_is_old(config: Config) -> None:
    known = KnownGravity(config)
    assert (known.due(0), known.used, known.age_s(0)) == (False, None, None)
    known.tell(leaning(5.0, 9.6), SECOND)
    assert adopted(known, SECOND) == pytest.approx(np.array(leaning(5.0)) / 9.81)
    assert known.age_s(3 * SECOND) == 2.0
    assert adopted(known, SECOND + AGE) is not None
    assert adopted(known, SECOND + AGE + 1) is None
    known.tell(leaning(-5.0), 20 * SECOND)
    assert adopted(known, 20 * SECOND) == pytest.approx(np.array(leaning(-5.0)) / 9.81)


def test_it_may_keep_the_last_one(config: Config) -> None:
    known = KnownGravity(replace(config, gravity_keeps_last=True))
    known.tell(leaning(5.0), 0)
    assert adopted(known, 0) is not None
    assert adopted(known, 1000 * AGE) == pytest.approx(np.array(leaning(5.0)) / 9.81)


@given(st.lists(st.tuples(st.integers(0, SECOND), st.floats(-8, 8)), max_size=40))
def test_it_is_adopted_in_steps_and_not_too_often(told: list[tuple[int, float]]) -> None:
    known, now, changes = KnownGravity(load_config(CONFIG)), 0, list[tuple[int, Vector3]]()
    for pause, degrees in told:
        now += pause
        known.tell(leaning(degrees), now)
        if known.due(now):
            before, after = known.used, known.adopt(now)
            assert after is not None
            assert before is None or angle_between(before, after) > STEP
            changes.append((now, after))
    assert all(b[0] - a[0] >= PERIOD for a, b in itertools.pairwise(changes))
    if told:
        now += PERIOD
        last = adopted(known, now)
        assert last is not None
        assert known.told is not None
        assert angle_between(last, known.told) <= STEP


@pytest.mark.parametrize(
    ("gravity", "said"),
    [
        ([0.0, 0.0, -9.2], r"length is 9\.20 m/s2; gravity's is 9\.3 to 10\.3"),
        ([0.0, 0.0, -1.0], "length is 1.00"),
        ([3.0, 3.0, -10.0], "length is 10.86"),
        ([0.0, 0.0, 9.81], "an accelerometer at rest reads upwards"),
    ],
)
def test_what_cannot_be_gravity_is_refused(config: Config, gravity: list[float], said: str) -> None:
    known = KnownGravity(config)
    with pytest.raises(RequestError, match=said) as caught:
        known.tell(gravity, 0)
    assert caught.value.code == "gravity"
    assert known.told is None
    with pytest.raises(RequestError, match="states no gravity"):
        KnownGravity(replace(config, arm=replace(config.arm, gravity=(0.0, 0.0, 0.0)))).tell(leaning(1.0), 0)


def test_the_command_needs_no_lease_and_heat_follows_it(config: Config) -> None:
    sim = SimulatedDaemon(config)
    sim.run(30)
    sim.core.handle(GravityCommand(gravity_m_per_s2=leaning(20.0)), sim.now)
    assert sim.core.gravity.due(sim.now)
    upright, level = [0.0] * 6, config.arm.gravity
    x, y, z = leaning(20.0)
    tau = gravity_torques(config.arm, (x, y, z))(upright, 0.0, ORIGIN)
    sim.core.motion_check.torques = gravity_torques(config.arm, (x, y, z))
    assert sim.core.motion_check.servo_torques(sim.core.position, 0.0)[:6] == pytest.approx(
        tuple(gravity_torques(config.arm, (x, y, z))(sim.core.angles(sim.core.position)[:6], 0.0, ORIGIN))
    )
    assert np.abs(np.array(tau) - gravity_torques(config.arm, level)(upright, 0.0, ORIGIN)).max() > 0.1
