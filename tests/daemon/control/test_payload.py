"""Payload: what the gripper carries is one figure for the move, the guard, the jog, the way to rest and the planner."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from lrm_math.arm.arm import Arm
from lrm_math.arrays import ORIGIN, Array
from lrm_math.collision.scene import Scene, clearance_of
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.forward import frames
from lrm_math.kinematics.poses import poses_of
from lrm_math.kinematics.statics import joint_torques
from lrm_math.model.deployed_model import with_load_at
from lrm_math.model.equilibrium import solve_equilibrium
from lrmd.config import Config, load_config
from lrmd.control.requests import Controller
from lrmd.control.state_machine import Mode
from lrmd.errors import RequestError
from lrmd.ik.deployed_model import DeployedModel, deploy
from lrmd.ik.planner import NoPlan, Planner
from lrmd.messages.control import JogRequest, PayloadRequest, SceneCommand
from lrmd.messages.surroundings import ObstacleEntry
from lrmd.persistence.state_file import StoredState
from lrmd.safety.collision_guard import CollisionGuard, guard_of
from lrmd.safety.thermal_model import gravity_torques
from tests.conftest import TABLE_B2
from tests.support.daemon.armed_daemon import ArmedDaemon, take
from tests.support.daemon.in_memory_daemon import CONFIG, SimulatedDaemon

HEAVY = 0.5
ABOVE = {"joint1": 0.57, "joint2": 1.15, "joint3": -0.75, "joint4": -0.14, "joint5": -0.76, "joint6": -1.12}
LOW = {"joint1": 0.85, "joint2": 1.29, "joint3": -0.72, "joint4": 0.12, "joint5": -0.96, "joint6": -0.98}
"""rad: just above the ground; with a load the palm sags onto it."""


@pytest.fixture(scope="module")
def config() -> Config:
    return replace(load_config(CONFIG), model=TABLE_B2, stagger=20_000_000)


@pytest.fixture(scope="module")
def deployed(config: Config) -> DeployedModel:
    return deploy(config)


def loaded(config: Config, deployed: DeployedModel) -> ArmedDaemon:
    """Armed at ABOVE, with the collision guard of its arm and model."""
    return ArmedDaemon.among(config, guard_of(config.arm, deployed.model), [*ABOVE.values()])


def move(sim: ArmedDaemon, *waypoints: dict[str, float], payload: float | None = None) -> None:
    sim.start(*([*way.values()] for way in waypoints), payload_kg=payload)


@pytest.fixture
def sim(config: Config, deployed: DeployedModel) -> ArmedDaemon:
    return loaded(config, deployed)


def nearest(config: Config, deployed: DeployedModel, q: Array, payload: float) -> float:
    """Smallest distance (m) of two bodies of the sagging arm in poses (N, n): the model's own equilibrium, no guard."""
    equilibrium = solve_equilibrium(deployed.model, poses_of(q, payload))
    scene = Scene.of(config.arm)
    return float(clearance_of(scene, frames(deployed.model.chain, equilibrium.slots, len(q))).distance.min())


def straight(count: int = 200) -> Array:
    a, b = (np.array([pose[f"joint{i}"] for i in range(1, 7)]) for pose in (ABOVE, LOW))
    return a + np.linspace(0.0, 1.0, count)[:, None] * (b - a)


def test_the_load_makes_the_difference_between_clear_and_colliding(config, deployed) -> None:
    assert nearest(config, deployed, straight(), 0.0) > 0.0
    assert nearest(config, deployed, straight(), HEAVY) < 0.0


def test_a_move_that_is_clear_empty_and_collides_with_its_load_is_refused(sim: ArmedDaemon) -> None:
    with pytest.raises(RequestError, match="palm and ground would come to") as refused:
        move(sim, LOW, payload=HEAVY)
    assert refused.value.code == "collision"
    assert sim.core.mode is Mode.ARMED
    assert sim.core.payload == 0.0, "a refused request changes nothing"
    move(sim, LOW)
    assert sim.core.mode is Mode.MOVING


def test_the_load_of_an_earlier_move_counts_for_the_next_one(sim: ArmedDaemon) -> None:
    move(sim, ABOVE, payload=HEAVY)
    sim.keep(30)
    assert sim.core.mode is Mode.ARMED
    with pytest.raises(RequestError, match="palm and ground"):
        move(sim, LOW)


@pytest.mark.long
def test_a_jog_stops_higher_above_the_ground_with_a_load(config, deployed) -> None:
    ends = {}
    for payload in (0.0, HEAVY):
        sim = loaded(config, deployed)
        move(sim, {**ABOVE, "joint2": 0.6}, payload=payload)
        sim.keep(600)
        assert sim.core.mode is Mode.ARMED
        while sim.core.mode is not Mode.HOLDING:
            sim.core.handle(JogRequest(lease=sim.token, rate_rad_per_s={"joint2": 0.2}), sim.now)
            sim.keep(10)
        assert "jog_stopped" in [event.code for event in sim.core.events]
        q = np.array([sim.core.angles(sim.ramp.position)[:6]])
        assert nearest(config, deployed, q, payload) > 0.0
        ends[payload] = q[0, 1]
    assert ends[HEAVY] < ends[0.0] - 0.02


def test_the_way_to_rest_is_checked_with_the_load(config, deployed) -> None:
    """From ABOVE to a rest pose that is LOW: clear empty, on the ground with the load."""
    low = replace(config, rest=tuple(LOW.values()))
    for payload, blocked in ((0.0, False), (HEAVY, True)):
        sim = loaded(low, deployed)
        move(sim, ABOVE, payload=payload)
        sim.keep(30)
        sim.core.thermal.temperature = (90.0, *sim.core.thermal.temperature[1:])
        sim.keep(30)
        assert (sim.core.mode is Mode.MOVING) is not blocked
        assert ("rest_blocked" in [event.code for event in sim.core.events]) is blocked


@pytest.mark.slow
def test_the_planner_refuses_what_the_guard_refuses_and_its_path_is_accepted(config, deployed) -> None:
    planner = Planner(config, CollisionGuard(Scene.of(config.arm), deployed.model), HEAVY)
    high, side, low = ({**ABOVE, "joint2": 0.7}, {**ABOVE, "joint1": -0.3, "joint2": 0.7}, LOW)
    checks = itertools.count()

    def limited() -> None:
        if next(checks) > 1000:
            raise RequestError("deadline", "too many moves", retryable=True)

    refused = planner.find(list(high.values()), [list(low.values())], 0, limited)
    assert isinstance(refused, NoPlan)
    assert "palm and ground" in refused.text
    path = planner.find(list(high.values()), [list(side.values())], 0, limited)
    assert not isinstance(path, NoPlan), path
    sim = loaded(config, deployed)
    move(sim, high)
    sim.keep(400)
    move(sim, *(dict(zip(ABOVE, q, strict=True)) for q in path[1:]), payload=HEAVY)
    assert sim.core.mode is Mode.MOVING


def carry(sim: ArmedDaemon, payload: float, centre: Sequence[float] = ORIGIN) -> None:
    request = PayloadRequest(lease=sim.token, payload_kg=payload, payload_centre_m=list(centre))
    sim.core.handle(request, sim.now)


def test_a_load_is_a_state_that_the_guard_follows_at_once(sim: ArmedDaemon) -> None:
    carry(sim, HEAVY)
    assert sim.core.mode is Mode.ARMED
    assert sim.core.payload == HEAVY
    with pytest.raises(RequestError, match="palm and ground"):
        move(sim, LOW)
    carry(sim, 0.0)
    move(sim, LOW)


def test_a_load_that_is_told_under_way_stops_a_motion_whose_rest_collides(sim: ArmedDaemon) -> None:
    move(sim, LOW)
    sim.keep(10)
    carry(sim, HEAVY)
    assert sim.core.mode is Mode.HOLDING
    assert "motion_stopped" in [event.code for event in sim.core.events]


def test_a_load_that_the_servos_cannot_bear_is_refused_and_changes_nothing(sim: ArmedDaemon) -> None:
    sim.core.motion_check.torques = lambda _, payload, __: (0.0, 10.0 * payload, 0.0, 0.0, 0.0, 0.0)
    with pytest.raises(RequestError, match=r"joint2 would hold 20\.00 Nm") as refused:
        carry(sim, 2.0)
    assert refused.value.code == "too_heavy"
    assert sim.core.payload == 0.0
    assert sim.core.mode is Mode.ARMED


OUTWARDS = (0.0, 0.0, 0.15)
LIGHTER = 0.4


def test_the_guard_follows_the_centre_of_a_load_at_once(sim: ArmedDaemon, config: Config, deployed) -> None:
    """The same mass, held further out, sags onto the ground; dropped and grasped at the TCP again it does not."""
    far = replace(deployed, model=with_load_at(deployed.model, OUTWARDS))
    assert nearest(config, deployed, straight(), LIGHTER) > nearest(config, far, straight(), LIGHTER) + 0.002
    carry(sim, HEAVY, OUTWARDS)
    assert sim.core.load_at == OUTWARDS
    guard = sim.core.motion_check.guard
    assert isinstance(guard, CollisionGuard)
    assert guard.model.arm == config.arm.with_load_at(OUTWARDS)
    with pytest.raises(RequestError, match="palm and ground"):
        move(sim, LOW)
    carry(sim, 0.0)
    assert sim.core.load_at == ORIGIN
    move(sim, LOW)


def test_the_centre_outlives_a_new_model_obstacles_and_a_restart(sim: ArmedDaemon, config: Config, deployed) -> None:
    carry(sim, 0.1, OUTWARDS)
    expected = config.arm.with_load_at(OUTWARDS)

    def guarded(core: Controller) -> Arm:
        guard = core.motion_check.guard
        assert isinstance(guard, CollisionGuard)
        return guard.model.arm

    sim.core.adopt_guard(guard_of(config.arm, deployed.model), sim.now)
    assert guarded(sim.core) == expected
    box = ObstacleEntry.model_validate(
        {"name": "stone", "shape": "sphere", "position_m": [0, 0.9, 0.9], "radius_m": 0.01}
    )
    sim.core.handle(SceneCommand(owner="test", put=[box]), sim.now)
    assert guarded(sim.core) == expected
    move(sim, ABOVE, payload=0.15)
    assert sim.core.load_at == OUTWARDS
    stored = StoredState.model_validate_json(sim.core.saved(0).model_dump_json(by_alias=True))
    again = Controller(config, gravity_torques(config.arm, config.arm.gravity), stored, sim.core.guard, sim.now, 1)
    assert (again.payload, again.load_at) == (0.15, OUTWARDS)
    assert guarded(again) == expected


def test_torques_of_the_thermal_model_have_the_centre(sim: ArmedDaemon, config: Config) -> None:
    sim.core.motion_check.torques = gravity_torques(config.arm, config.arm.gravity)
    q = sim.core.angles(sim.core.position)[: config.dof]
    for centre in (ORIGIN, OUTWARDS, (0.05, -0.02, 0.0)):
        carry(sim, 0.1, centre)
        found = sim.core.motion_check.servo_torques(sim.core.position, sim.core.payload)
        expected = joint_torques(chain_of(config.arm.with_load_at(centre)), config.arm.gravity, q, 0.1)
        assert found[:6] == pytest.approx(expected, abs=1e-12)


def test_a_centre_that_the_servos_cannot_bear_is_refused_and_changes_nothing(sim: ArmedDaemon) -> None:
    """The same mass at the TCP is borne; further out joint 2 would be too hot."""
    sim.core.motion_check.torques = lambda _, payload, at: (0.0, payload * (1.0 + 200.0 * at[2]), 0.0, 0.0, 0.0, 0.0)
    carry(sim, 0.5)
    with pytest.raises(RequestError, match="joint2 would hold") as refused:
        carry(sim, 0.5, OUTWARDS)
    assert refused.value.code == "too_heavy"
    assert (sim.core.payload, sim.core.load_at) == (0.5, ORIGIN)
    carry(sim, 0.0, OUTWARDS)
    assert sim.core.load_at == ORIGIN


def test_an_arm_that_carries_no_load_on_its_tool_has_no_centre_to_state(config: Config) -> None:
    bodies = tuple(body for body in config.arm.bodies if not body.carries_payload)
    sim = SimulatedDaemon(replace(config, arm=replace(config.arm, bodies=bodies)))
    sim.run(30)
    token = take(sim)
    with pytest.raises(RequestError, match="no body on the tool of lrm-"):
        sim.core.handle(PayloadRequest(lease=token, payload_kg=0.1, payload_centre_m=[0.01, 0, 0]), sim.now)
    sim.core.handle(PayloadRequest(lease=token, payload_kg=0.1), sim.now)
