"""Planned paths around an obstacle: collision-free for the sagging arm, accepted by the daemon, checked by sampling."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from lrm_math.arm.collision_shapes import Box
from lrm_math.arrays import Array
from lrm_math.collision.scene import Scene, clearance, clearance_of
from lrm_math.effects import effects_at
from lrm_math.kinematics.forward import frames
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from lrm_math.model.model_file import load_model
from lrmd.config import Config, load_config
from lrmd.control.state_machine import Mode
from lrmd.errors import RequestError
from lrmd.ik.deployed_model import DeployedModel
from lrmd.ik.planner import JointPath, NoPlan
from lrmd.ik.service import IkService
from lrmd.messages.codec import MessageError
from lrmd.messages.control import ArmRequest, LeaseRequest, MoveRequest
from lrmd.messages.kinematics import GoalEntry, PlanRequest
from lrmd.safety.collision_guard import guard_of
from tests.conftest import TABLE_B2
from tests.math.collision.test_collision import sampled_distance
from tests.support.daemon.in_memory_daemon import CONFIG, SimulatedDaemon
from tests.support.link_matrices import link_matrices
from tests.support.sweep import soak

START, END = np.radians([-60.0, 40, 0, 0, 0, 0]), np.radians([60.0, 40, 0, 0, 0, 0])
LOAD = 0.0663


@dataclass(frozen=True)
class Workcell:
    """An arm with a post at its tool position half way from START to END, and a model of its sag."""

    config: Config
    model: Model
    service: IkService
    found: dict[float, Array] = field(default_factory=dict)

    def planned(self, seed: int = 0, payload: float = 0.0, end: Array = END) -> JointPath | NoPlan:
        ask = PlanRequest(from_rad=START.tolist(), to_rad=end.tolist(), seed=seed, payload_kg=payload)
        return self.service.plan(ask, limited())

    def way(self, payload: float = 0.0) -> Array:
        """The waypoints from START to END, planned once."""
        if payload not in self.found:
            path = self.planned(payload=payload)
            assert not isinstance(path, NoPlan), path
            self.found[payload] = np.array(path)
        return self.found[payload]

    def sagging(self, q: Array, payload: float) -> Array:
        """(N,), how close the closest bodies of the bent arm are (m)."""
        equilibrium = solve_equilibrium(self.model, poses_of(q, payload))
        return clearance_of(Scene.of(self.config.arm), frames(self.model.chain, equilibrium.slots, len(q))).distance


def limited(looks: int = 100_000) -> Callable[[], None]:
    """Cancels after a number of calls, not after a time: reproducible on every machine."""
    counter = itertools.count()

    def check_cancelled() -> None:
        if next(counter) >= looks:
            raise RequestError("deadline", "too many attempts", retryable=True)

    return check_cancelled


def workcell_with_post(name: str, folder: Path, size: tuple[float, float, float] = (0.03, 0.03, 0.15)) -> Workcell:
    path = folder / f"{name}.toml"
    text = CONFIG.read_text(encoding="utf-8").replace('arm = "lrm-rover"', f'arm = "{name}"')
    if name == "lrm-lab":
        text = text.replace("[servo.gripper]\nchannel = 6\n", "")
    path.write_text(text)
    config = load_config(path)
    x, y, z = link_matrices(config.arm, 0.5 * (START + END))[-1][:3, 3].tolist()
    shapes = replace(config.arm.shapes, boxes=(*config.arm.shapes.boxes, Box("post", (x, y, z), size)))
    arm = replace(config.arm, shapes=shapes)
    thesis = load_model(TABLE_B2)
    known = dict(zip(thesis.keys, thesis.values.tolist(), strict=True))
    model = model_of(arm, effects_at(arm, "offsets") + effects_at(arm, "compliance"), known)
    config = replace(config, arm=arm)
    return Workcell(config, model, IkService.of(config, DeployedModel(model, None, "model.toml", "00" * 32, ())))


@pytest.fixture(scope="module", params=["lrm-rover", *soak("lrm-lab")])
def place(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Workcell:
    return workcell_with_post(request.param, tmp_path_factory.mktemp("arm"))


def daemon_at(place: Workcell) -> tuple[SimulatedDaemon, str]:
    """The controller at START, armed, with its collision guard."""
    sim = SimulatedDaemon(place.config)
    sim.core.motion_check.guard = guard_of(place.config.arm, place.model) or sim.core.motion_check.guard
    sim.run(30)
    lease = sim.core.handle(LeaseRequest(action="acquire", holder="test"), sim.now).lease
    names = place.config.names
    stands = {name: float(q) for name, q in zip(names, START, strict=False)}
    sim.core.handle(ArmRequest(lease=lease.token, where="given", q_rad=stands), sim.now)
    while sim.core.mode is Mode.ARMING:
        sim.core.handle(LeaseRequest(action="renew", lease=lease.token), sim.now)
        sim.run(15)
    assert sim.core.mode is Mode.ARMED
    return sim, lease.token


def named(place: Workcell, q: Array) -> dict[str, float]:
    return {name: float(angle) for name, angle in zip(place.config.names, q, strict=False)}


def densely(way: Array, step: float = 0.01) -> Array:
    pieces = [np.linspace(a, b, 2 + int(np.abs(b - a).max() / step)) for a, b in pairwise(way)]
    return np.concatenate(pieces)


@pytest.mark.slow
def test_the_daemon_refuses_the_straight_move_and_accepts_the_planned_path(place: Workcell) -> None:
    sim, token = daemon_at(place)
    with pytest.raises(RequestError) as caught:
        sim.core.handle(MoveRequest(lease=token, waypoints=[named(place, END)]), sim.now)
    assert caught.value.code == "collision"
    assert "post" in caught.value.detail["bodies"]
    assert 0 < caught.value.detail["fraction"] < 1
    assert caught.value.detail["distance_m"] < place.config.arm.shapes.margin
    sim.core.handle(LeaseRequest(action="renew", lease=token), sim.now)
    waypoints = [named(place, q) for q in place.way(LOAD)[1:]]
    assert (sim.core.handle(MoveRequest(lease=token, waypoints=waypoints), sim.now).seconds or 0.0) > 0.0


@pytest.mark.slow
@pytest.mark.parametrize("payload", [0.0, LOAD])
def test_the_path_is_free_for_the_rigid_and_the_sagging_arm(place: Workcell, payload: float) -> None:
    way = place.way(payload)
    np.testing.assert_array_equal(way[[0, -1]], [START, END])
    q, margin = densely(way), place.config.arm.shapes.margin
    assert all(((q >= j.lower) & (q <= j.upper))[:, i].all() for i, j in enumerate(place.config.arm.joints))
    for load in {0.0, payload}:
        assert place.sagging(q, load).min() >= margin - 1e-3
    tools = [c.name for c in place.config.arm.shapes.capsules if c.frame > 3]
    for pose in densely(way, 0.1):
        assert min(sampled_distance(place.config.arm, pose, name, "post", 30) for name in tools) >= margin


@pytest.mark.slow
def test_every_piece_is_straight_in_angles_and_in_pulses(place: Workcell) -> None:
    """Half way between two waypoints in angles is half way in pulses, to a nanosecond."""
    tables = [servo.table for servo in place.config.servos[: place.config.dof]]
    for before, after in pairwise(place.way()):
        for table, a, b in zip(tables, before, after, strict=True):
            middle = 0.5 * (float(table.pulse_of(a)) + float(table.pulse_of(b)))
            assert float(table.pulse_of(0.5 * (a + b))) == pytest.approx(middle, abs=1e-9)


@pytest.mark.slow
def test_the_same_seed_finds_the_same_path(place: Workcell) -> None:
    again = place.planned(payload=LOAD)
    assert not isinstance(again, NoPlan)
    np.testing.assert_array_equal(again, place.way(LOAD))
    other = place.planned(5, LOAD)
    assert not isinstance(other, NoPlan)
    assert not np.array_equal(other, again)


@pytest.mark.slow
def test_a_path_to_a_goal_ends_with_the_tool_there(place: Workcell) -> None:
    equilibrium = solve_equilibrium(place.model, poses_of(END[None], LOAD))
    tool = frames(place.model.chain, equilibrium.slots, 1)[0, -1]
    goal = GoalEntry(position_m=tool[:3, 3].tolist(), approach=tool[:3, 2].tolist())
    found = place.service.plan(PlanRequest(from_rad=START.tolist(), goal=goal, payload_kg=LOAD), limited())
    assert not isinstance(found, NoPlan), found
    ends = solve_equilibrium(place.model, poses_of(np.array(found[-1:]), LOAD))
    np.testing.assert_allclose(ends.true_tcp[0], tool[:3, 3], atol=1e-6)


def test_an_impossible_path_is_refused_with_the_reason(place: Workcell) -> None:
    inside = 0.5 * (START + END)
    into = place.planned(end=inside)
    assert isinstance(into, NoPlan)
    assert "post" in into.text
    assert "goal" in into.text
    beyond = END.copy()
    beyond[1] = math.radians(179)
    outside = place.planned(end=beyond)
    assert isinstance(outside, NoPlan)
    assert "joint 2" in outside.text
    assert "limits" in outside.text
    far = PlanRequest(from_rad=START.tolist(), goal=GoalEntry(position_m=[3.0, 0.0, 0.0]))
    with pytest.raises(RequestError) as caught:
        place.service.plan(far, limited())
    assert caught.value.code == "out_of_reach"


def test_a_cancelled_search_ends(place: Workcell) -> None:
    with pytest.raises(RequestError) as caught:
        place.service.plan(PlanRequest(from_rad=START.tolist(), to_rad=END.tolist()), limited(0))
    assert caught.value.code == "deadline"


def with_margin(place: Workcell, margin: float) -> IkService:
    """The same arm and model, with another safety margin (m)."""
    shapes = replace(place.config.arm.shapes, margin=margin)
    config = replace(place.config, arm=replace(place.config.arm, shapes=shapes))
    return IkService.of(config, DeployedModel(place.model, None, "model.toml", "00" * 32, ()))


def sagging_pose(place: Workcell) -> tuple[Array, float, float]:
    """A pose where sag brings the arm much nearer to itself or to the post: angles, rigid and loaded distance (m)."""
    scene, rng = Scene.of(place.config.arm), np.random.default_rng(0)
    some = rng.uniform(*scene.limits, (300, place.config.dof))
    rigid, bent = clearance(scene, some).distance, place.sagging(some, LOAD)
    pose = some[int(np.argmax(np.where(bent > 0.0, rigid - bent, 0.0)))]
    apart, sunk = scene.closest(pose).distance, float(place.sagging(pose[None], LOAD)[0])
    assert sunk < apart - 5e-3
    return pose, apart, sunk


@pytest.mark.slow
def test_a_goal_that_only_the_sagging_arm_touches_is_refused_with_the_reason(place: Workcell) -> None:
    """Takes a margin between the distances that the rigid arm and the bent one have in some pose."""
    end, apart, sunk = sagging_pose(place)
    ask = PlanRequest(from_rad=end.tolist(), to_rad=end.tolist(), payload_kg=LOAD)
    found = with_margin(place, 0.5 * (apart + sunk)).plan(ask, limited())
    assert isinstance(found, NoPlan)
    assert "as the arm sags" in found.text


@pytest.mark.slow
@pytest.mark.parametrize("place", ["lrm-lab", *soak("lrm-rover")], indirect=True)
def test_an_arm_that_stands_within_the_margin_is_led_out_of_it(place: Workcell) -> None:
    """Happens after a new model was deployed that knows more of the sag: before, it could go nowhere."""
    pose, _, sunk = sagging_pose(place)
    margin = sunk + 2e-3
    service = with_margin(place, margin)
    found = service.plan(PlanRequest(from_rad=pose.tolist(), to_rad=START.tolist(), payload_kg=LOAD), limited())
    assert not isinstance(found, NoPlan), found
    way = np.array(found)
    np.testing.assert_allclose(way[[0, -1]], [pose, START], atol=1e-12)
    guard = guard_of(replace(place.config.arm, shapes=replace(place.config.arm.shapes, margin=margin)), place.model)
    guard(way.tolist(), LOAD)  # what the daemon allows
    clear = np.cumsum(place.sagging(way, LOAD) >= margin)
    assert clear[0] == 0, "it starts within the margin"
    assert np.all(np.diff(clear)[int(np.argmax(clear > 0)) - 1 :] == 1), "and once it has left it, it keeps it"


def test_a_plan_from_another_arm_is_refused(place: Workcell) -> None:
    with pytest.raises(MessageError, match="from_rad: 5 angles"):
        place.service.plan(PlanRequest(from_rad=[0.0] * 5, to_rad=[0.0] * 6), limited())
