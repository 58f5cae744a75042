"""Straight lines: the commanded tip keeps to them or says where they end."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from lrm_math.arrays import Array
from lrm_math.ik.calibrated import CalibratedSolver
from lrm_math.ik.goal import point, pose
from lrm_math.kinematics.motion import Motion
from lrmd.config import Config, load_config
from lrmd.ik.deployed_model import deploy
from lrmd.ik.planner import NoPlan
from lrmd.ik.service import IkService
from lrmd.ik.straight_line import TOLERANCE, LineEnd, Waypoint, line_path, rotation_of, rotation_vector
from lrmd.messages.kinematics import GoalEntry, PlanRequest
from lrmd.safety.collision_guard import CollisionGuard
from tests.daemon.safety.test_contact import GROUND
from tests.support.daemon.in_memory_daemon import CONFIG
from tests.support.daemon.random_lines import random_lines, soft_lab

BENT = np.array([0.2, 0.5, 0.4, 0.9, -0.3, 0.4])


@pytest.fixture(scope="module")
def solver() -> CalibratedSolver:
    return CalibratedSolver.of(soft_lab()[1])


@pytest.fixture(scope="module")
def service() -> IkService:
    config: Config = replace(load_config(CONFIG), model=None)
    return IkService.of(config, deploy(config))


@pytest.mark.long
def test_the_commanded_tip_keeps_to_its_line_by_an_independent_model() -> None:
    """Every `EVERY` ticks of the ramp, loads and turns among them; the ramp's law holds in every tick."""
    walked = list(itertools.islice((line for line in random_lines(3) if not line.ended), 5))
    assert max(line.deviation for line in walked) <= TOLERANCE
    assert max(line.turn for line in walked) <= 0.025
    assert max(line.largest_step for line in walked) <= soft_lab()[0].step


def test_a_line_keeps_its_branch_and_begins_where_the_arm_stands(solver: CalibratedSolver) -> None:
    tool = solver.forward(BENT.tolist())
    goal = point([x + d for x, d in zip(tool.tcp, (0.0, 0.0, -0.04), strict=True)])
    found = line_path(Waypoint.of(solver, Motion.at(BENT)), 0.0, goal, free)
    assert not isinstance(found, LineEnd), found
    path = np.array(found)
    assert np.array_equal(path[0], BENT)
    assert np.abs(np.diff(path, axis=0)).max() < 0.3


def free() -> None:
    """Never cancelled."""


def test_a_line_that_leaves_the_reach_says_where_it_ends_and_why(solver: CalibratedSolver) -> None:
    tool = solver.forward(BENT.tolist())
    x, y, z = tool.tcp
    found = line_path(Waypoint.of(solver, Motion.at(BENT)), 0.0, pose((x, y, z + 2.0), np.array(tool.rotation)), free)
    assert isinstance(found, LineEnd)
    assert found.at[:2] == pytest.approx((x, y), abs=1e-9)
    assert z < found.at[2] < z + 1.0
    assert "no straight line: it ends after" in found.text
    assert "of 2000.0 mm" in found.text


def test_a_line_into_the_ground_is_refused_where_it_collides_and_found_where_that_is_permitted(service) -> None:
    """The rover's tool, pointing down over the ground."""
    config = service.config
    down = np.diag([1.0, -1.0, -1.0])
    goal = GoalEntry(position_m=[0.2, 0.05, 0.008])
    for branch in service.solver.solve(pose((0.2, 0.05, 0.06), down)).branches:
        line = PlanRequest(from_rad=list(branch.q), goal=goal, line=True)
        path = service.plan(line.model_copy(update={"may_touch": [GROUND]}), free)
        if not isinstance(path, NoPlan):
            break
    assert not isinstance(path, NoPlan), path
    refused = service.plan(line, free)
    assert isinstance(refused, LineEnd)
    assert "fingers and ground" in refused.text
    tips = np.array([service.solver.forward(q).tcp for q in path])
    assert np.abs(tips[:, :2] - [0.2, 0.05]).max() < TOLERANCE
    assert tips[-1, 2] == pytest.approx(0.008, abs=1e-4)
    assert len(path[0]) == config.dof


def test_a_line_is_checked_with_the_corners_it_has(service: IkService, monkeypatch: pytest.MonkeyPatch) -> None:
    """Across the middle, where the table of the first servo bends."""
    checked: list[Array] = []
    check = CollisionGuard.check
    monkeypatch.setattr(CollisionGuard, "check", lambda at, way, *rest: (checked.append(way), check(at, way, *rest))[1])
    start = pose((0.2, 0.03, 0.1), np.diag([1.0, -1.0, -1.0]))
    goal = GoalEntry(position_m=[0.2, -0.03, 0.1])
    lines = (PlanRequest(from_rad=list(one.q), goal=goal, line=True) for one in service.solver.solve(start).branches)
    path = next(path for path in (service.plan(line, free) for line in lines) if not isinstance(path, NoPlan))
    assert np.abs(np.array(path)[1:-1, 0]).min() < 1e-12, "a corner of the table"
    assert np.array_equal(checked[-1], path)


@pytest.mark.parametrize("angle", [0.0, 1e-6, 0.3, 2.0, math.pi])
def test_a_rotation_vector_is_that_of_its_rotation(angle: float) -> None:
    axis: Array = np.array([0.6, -0.48, 0.64])
    R = rotation_of(angle * axis)
    assert rotation_of(rotation_vector(R)) == pytest.approx(R, abs=1e-9)
    assert np.linalg.norm(rotation_vector(R)) == pytest.approx(angle, abs=1e-9)
