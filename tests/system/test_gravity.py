"""`cmd/gravity` over zenoh: an IMU tells which way gravity pulls, and kinematics follow within a second."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest

from lrm_math.kinematics.poses import poses_of
from lrm_math.model.deployed_model import under_gravity
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model_file import load_model
from lrmd.client import Rover
from lrmd.messages.kinematics import FkRequest
from tests.conftest import TABLE_B2
from tests.support.daemon.daemon_process import SLOW_BOARD, DaemonSetup, running_daemon, wait_for

LEAN = math.radians(10.0)
DOWN = (math.sin(LEAN), 0.0, -math.cos(LEAN))
Q = [0.2, 0.4, 0.3, 0.1, 0.4, 0.0]


@pytest.fixture(scope="module")
def rover(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rover]:
    model = {'# model = "/etc/lrm/model.toml"': f'model = "{TABLE_B2}"', "max_age_s = 10.0": "max_age_s = 2.0"}
    setup = DaemonSetup.make(tmp_path_factory.mktemp("daemon"), {**SLOW_BOARD, **model})
    with running_daemon(setup) as (_, _), setup.rover() as rover:
        yield rover


def tip(rover: Rover) -> list[float]:
    return rover.fk(FkRequest(q_rad=[Q])).places[0].tcp_m


def codes(rover: Rover) -> list[str]:
    return [event.code for event in rover.events()]


def test_an_imu_tells_the_slope_and_falls_silent(rover: Rover) -> None:
    model = load_model(TABLE_B2)
    level, tilted = (solve_equilibrium(one, poses_of(Q)).true_tcp[0] for one in (model, under_gravity(model, DOWN)))
    assert np.linalg.norm(tilted - level) > 5e-4
    np.testing.assert_allclose(tip(rover), level, atol=1e-9)
    assert rover.gravity().source == "model"
    assert rover.gravity().age_s is None

    rover.tell_gravity([9.7 * x for x in DOWN])
    wait_for(lambda: rover.gravity().source == "told", "the direction is adopted")
    np.testing.assert_allclose(rover.gravity().gravity_m_per_s2, [9.81 * x for x in DOWN], atol=1e-6)
    np.testing.assert_allclose(tip(rover), tilted, atol=1e-9)
    assert "gravity_known" in codes(rover)

    wait_for(lambda: rover.gravity().source == "model", "the direction is forgotten")
    np.testing.assert_allclose(tip(rover), level, atol=1e-9)
    assert (rover.gravity().age_s or 0.0) >= 2.0
    assert "gravity_lost" in codes(rover)


def test_what_is_no_gravity_is_refused_by_an_event(rover: Rover) -> None:
    rover.tell_gravity([0.0, 0.0, -5.0])

    def refused() -> bool:
        return any(event.code == "refused" and event.detail["why"] == "gravity" for event in rover.events())

    wait_for(refused, "the refusal is told")
    assert rover.gravity().source == "model"
