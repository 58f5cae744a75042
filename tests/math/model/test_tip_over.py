"""Tip-over angle: that of plane geometry, a slope uses it up, and the daemon's answers have it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_math.arm.arm_file import load_arm
from lrm_math.arm.vehicle import Vehicle
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from lrm_math.model.tip_over import smallest_edge_angle, tip_over_angles
from lrmd.config import load_config
from lrmd.ik.deployed_model import deploy
from lrmd.ik.service import IkService
from lrmd.messages.kinematics import FkRequest, GoalEntry, IkRequest
from tests.conftest import ROOT
from tests.support.daemon.in_memory_daemon import CONFIG

G = 9.81
CORNERS = ((0.2, 0.1, 0.0), (-0.2, 0.1, 0.0), (-0.2, -0.1, 0.0), (0.2, -0.1, 0.0))
ROVER = Vehicle(10.0, (0.0, 0.0, 0.1), CORNERS)


@given(st.floats(-0.25, 0.25), st.floats(-0.15, 0.15), st.floats(0.02, 0.5), st.booleans())
def test_on_level_ground_it_is_that_of_the_nearest_edge(x: float, y: float, z: float, other_way: bool) -> None:
    corners = CORNERS[::-1] if other_way else CORNERS
    found = smallest_edge_angle(np.array([[x, y, z]]), replace(ROVER, contacts=corners), (0.0, 0.0, -G))
    nearest = min(np.arctan2(0.2 - abs(x), z), np.arctan2(0.1 - abs(y), z))
    assert found == pytest.approx([nearest], abs=1e-9)


def test_a_slope_uses_it_up() -> None:
    for degrees in (0.0, 10.0, 44.0, 50.0):
        a = np.radians(degrees)
        found = smallest_edge_angle(np.array([[0.0, 0.0, 0.1]]), ROVER, (0.0, G * np.sin(a), -G * np.cos(a)))
        assert np.degrees(found) == pytest.approx([45.0 - degrees], abs=1e-6)


def test_a_load_held_out_tips_a_light_vehicle_sooner() -> None:
    model = model_of(load_arm("lrm-rover"), ())
    settled = solve_equilibrium(model, poses_of(np.array([[0.0, 1.2, 0.0, 0.0, 0.0, 0.0]])))
    wide = ((0.05, 0.5, 0.0), (-0.4, 0.5, 0.0), (-0.4, -0.5, 0.0), (0.05, -0.5, 0.0))
    light = Vehicle(1.0, (-0.15, 0.0, 0.1), wide)
    assert settled.tcp[0, 0] > 0.2  # beyond the front wheels
    angles = [float(tip_over_angles(settled, load, light, (0.0, 0.0, -G))[0]) for load in (0.0, 0.2, 1.0)]
    assert angles == sorted(angles, reverse=True)
    assert angles[0] > angles[2] + 0.05


def test_contacts_on_a_line_are_refused() -> None:
    with pytest.raises(LrmError, match="lie on one line"):
        Vehicle(1.0, (0.0, 0.0, 0.1), ((0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.2, 0.0, 0.0)))


def test_an_arm_file_states_what_the_arm_stands_on(tmp_path: Path) -> None:
    text = (ROOT / "config" / "arms" / "lrm-rover.toml").read_text(encoding="utf-8")
    contacts = [[1e3 * x for x in corner] for corner in CORNERS]
    path = tmp_path / "arm.toml"
    path.write_text(f"{text}\n[vehicle]\nmass_g = 10000\ncom_mm = [0, 0, 100]\ncontacts_mm = {contacts}\n")
    found = load_arm(str(path)).vehicle
    assert found is not None
    assert found.mass == pytest.approx(10.0)
    assert np.allclose(found.contacts, CORNERS)


def test_answers_have_it_where_the_arm_file_has_a_vehicle() -> None:
    config = load_config(CONFIG)
    q = [0.0, 0.3, 0.4, 0.0, 0.5, 0.0]
    plain = IkService.of(config, deploy(config))
    assert next(plain.forward(FkRequest(q_rad=[q]))).tip_over_rad is None
    on_wheels = replace(config, arm=replace(config.arm, vehicle=ROVER))
    service = IkService.of(on_wheels, deploy(on_wheels))
    level = next(service.forward(FkRequest(q_rad=[q])))
    a = np.radians(10.0)
    sloped = next(service.under_gravity((0.0, float(np.sin(a)), float(-np.cos(a)))).forward(FkRequest(q_rad=[q])))
    assert level.tip_over_rad is not None
    assert sloped.tip_over_rad is not None
    assert sloped.tip_over_rad < level.tip_over_rad - 0.5 * a
    answer = next(service.inverse(IkRequest(goals=[GoalEntry(position_m=level.tcp_m)], near_rad=q)))
    assert answer.tip_over_rad == pytest.approx(level.tip_over_rad, abs=0.05)
