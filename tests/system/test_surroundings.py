"""Obstacles, straight lines, contacts, loads and gravity over zenoh, against the simulated board."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest

from lrm_math.kinematics.poses import poses_of
from lrm_math.model.deployed_model import under_gravity
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model_file import load_model
from lrmd.client import RequestRefused, Rover
from lrmd.messages.kinematics import FkRequest, GoalEntry, IkRequest, PlanRequest
from lrmd.messages.surroundings import ContactEntry, ObstacleEntry
from tests.conftest import TABLE_B2
from tests.support.daemon.daemon_harness import arm_when_ready
from tests.support.daemon.daemon_process import SLOW_BOARD, DaemonSetup, running_daemon, wait_for

START = [0.2, 0.3, -0.4, 0.9, 0.3, 0.2]


@pytest.fixture(scope="module")
def rover(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rover]:
    model = {'# model = "/etc/lrm/model.toml"': f'model = "{TABLE_B2}"', "max_age_s = 10.0": "max_age_s = 2.0"}
    setup = DaemonSetup.make(tmp_path_factory.mktemp("daemon"), {**SLOW_BOARD, **model})
    with running_daemon(setup) as (_, _), setup.rover() as rover, rover.control("test"):
        arm_when_ready(rover, "given", {f"joint{i}": q for i, q in enumerate(START, start=1)})
        yield rover


def tip(rover: Rover) -> list[float]:
    return rover.fk(FkRequest(q_rad=[rover.commanded_q()])).places[0].tcp_m


def names(rover: Rover) -> list[str]:
    return [obstacle.name for obstacle in rover.scene().obstacles]


def test_kinematics_and_moves_know_an_obstacle_until_it_is_gone(rover: Rover) -> None:
    place = [x + d for x, d in zip(tip(rover), (0.0, 0.12, 0.0), strict=True)]
    goal = IkRequest(goals=[GoalEntry(position_m=place)], near_rad=rover.commanded_q())
    free = rover.ik(goal).answers[0]
    assert free.q_rad is not None
    rover.tell_obstacles("map", ObstacleEntry(name="rock", shape="sphere", position_m=place, radius_m=0.02))
    wait_for(lambda: names(rover) == ["rock"], "the obstacle is known")
    found = rover.ik(goal).answers[0]
    assert found.verdict == "collision"
    assert "rock" in (found.bodies or [])
    with pytest.raises(RequestRefused, match="rock") as refused:
        rover.move(dict(zip(rover.info().names, free.q_rad, strict=False)))
    assert refused.value.code == "collision"
    rover.tell_obstacles("map", remove=["rock"])
    wait_for(lambda: not names(rover), "the obstacle is gone")
    assert rover.ik(goal).answers[0].verdict == "solved"


def test_an_obstacle_inside_the_arm_is_an_event(rover: Rover) -> None:
    def refused() -> bool:  # told again: what comes too soon after another change of the scene is refused as `busy`
        rover.tell_obstacles("map", ObstacleEntry(name="hand", shape="sphere", position_m=tip(rover), radius_m=0.05))
        return any(event.code == "refused" and event.detail["why"] == "obstacle" for event in rover.events())

    wait_for(refused, "the refusal is told")
    assert not names(rover)


def test_a_line_is_planned_and_walked(rover: Rover) -> None:
    begin = tip(rover)
    goal = GoalEntry(position_m=[*begin[:2], begin[2] + 0.03])
    line = rover.plan(PlanRequest(from_rad=rover.commanded_q(), goal=goal, line=True))
    assert line.found, line.text
    tips = np.array([place.tcp_m for place in rover.fk(FkRequest(q_rad=line.waypoints_rad)).places])
    assert np.abs(tips[:, :2] - begin[:2]).max() < 1e-3
    rover.move(*(dict(zip(rover.info().names, q, strict=False)) for q in line.waypoints_rad[1:]))
    assert tip(rover)[2] == pytest.approx(begin[2] + 0.03, abs=5e-4)
    far = GoalEntry(position_m=[*begin[:2], begin[2] + 3.0])
    ended = rover.plan(PlanRequest(from_rad=rover.commanded_q(), goal=far, line=True))
    assert not ended.found
    assert ended.ends_at_m is not None
    assert "ends after" in ended.text


def test_a_contact_names_shapes_of_the_arm_file_and_a_load_is_a_state(rover: Rover) -> None:
    box = {"low_m": [-1.0, -1.0, -1.0], "high_m": [1.0, 1.0, 1.0]}
    there = dict(zip(rover.info().names, rover.commanded_q(), strict=False))
    there["joint1"] += 0.02
    parts = ContactEntry(first="link 1", second="palm", **box)
    with pytest.raises(RequestRefused, match="moon"):
        rover.move(there, may_touch=[ContactEntry(first="fingers", second="moon", **box)])
    with pytest.raises(RequestRefused, match="both of the arm"):
        rover.move(there, may_touch=[parts])
    before = tip(rover)
    rover.carry(0.06)
    assert rover.mode().payload_kg == 0.06
    wait_for(lambda: tip(rover)[2] < before[2] - 1e-4, "the arm sags under it")
    at_tcp = tip(rover)
    rover.carry(0.06, (0.0, 0.03, 0.1))
    assert rover.mode().payload_centre_m == [0.0, 0.03, 0.1]
    wait_for(lambda: math.dist(tip(rover), at_tcp) > 1e-4, "it sags in another way under one that is further out")
    rover.carry(0.0)
    assert rover.mode().payload_centre_m == [0.0, 0.0, 0.0]
    wait_for(lambda: np.allclose(tip(rover), before, atol=1e-9), "and stands as before without")


def test_a_skill_is_planned_by_the_ik_process_and_a_hold_ends_it(rover: Rover) -> None:
    here = rover.commanded_q()
    there = [q + 0.05 for q in here]
    state = rover.skill("stow", q_rad=there)
    assert (state.outcome, state.text) == ("reached", "stowed")
    assert rover.commanded_q() == pytest.approx(there, abs=1e-3)
    rover.carry(0.0)
    refused = rover.skill("approach", goal=GoalEntry(position_m=[5.0, 0.0, 0.1]), height_m=0.05)
    assert refused.outcome == "refused"
    begun = rover.skill("stow", q_rad=[0.3 + here[0], *here[1:]], wait=False)
    wait_for(lambda: rover.mode().mode == "moving", "the skill moves the arm")
    rover.hold()
    stood = rover.commanded_q()
    assert rover.await_skill(begun).outcome == "stopped"
    assert rover.commanded_q() == stood


LEAN = math.radians(10.0)
DOWN = (math.sin(LEAN), 0.0, -math.cos(LEAN))
Q = [0.2, 0.4, 0.3, 0.1, 0.4, 0.0]


def tip_at_q(rover: Rover) -> list[float]:
    return rover.fk(FkRequest(q_rad=[Q])).places[0].tcp_m


def codes(rover: Rover) -> list[str]:
    return [event.code for event in rover.events()]


def test_an_imu_tells_the_slope_and_falls_silent(rover: Rover) -> None:
    model = load_model(TABLE_B2)
    level, tilted = (solve_equilibrium(one, poses_of(Q)).true_tcp[0] for one in (model, under_gravity(model, DOWN)))
    assert np.linalg.norm(tilted - level) > 5e-4
    np.testing.assert_allclose(tip_at_q(rover), level, atol=1e-9)
    assert rover.gravity().source == "model"
    assert rover.gravity().age_s is None

    rover.tell_gravity([9.7 * x for x in DOWN])
    wait_for(lambda: rover.gravity().source == "told", "the direction is adopted")
    np.testing.assert_allclose(rover.gravity().gravity_m_per_s2, [9.81 * x for x in DOWN], atol=1e-6)
    np.testing.assert_allclose(tip_at_q(rover), tilted, atol=1e-9)
    assert "gravity_known" in codes(rover)

    wait_for(lambda: rover.gravity().source == "model", "the direction is forgotten")
    np.testing.assert_allclose(tip_at_q(rover), level, atol=1e-9)
    assert (rover.gravity().age_s or 0.0) >= 2.0
    assert "gravity_lost" in codes(rover)


def test_what_is_no_gravity_is_refused_by_an_event(rover: Rover) -> None:
    rover.tell_gravity([0.0, 0.0, -5.0])

    def refused() -> bool:
        return any(event.code == "refused" and event.detail["why"] == "gravity" for event in rover.events())

    wait_for(refused, "the refusal is told")
    assert rover.gravity().source == "model"
