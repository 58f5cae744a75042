"""Tipping over: refused exactly when the vehicle comes too near to it, off by default; plans that lead away from it."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_math.arm.vehicle import Vehicle
from lrm_math.arrays import Array
from lrm_math.collision.scene import Scene
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.deployed_model import under_gravity
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from lrm_math.model.tip_over import tip_over_angles
from lrmd.config import Config, load_config
from lrmd.control.state_machine import Mode
from lrmd.errors import RequestError
from lrmd.ik.deployed_model import deploy
from lrmd.ik.planner import NoPlan
from lrmd.ik.process import plan_content
from lrmd.ik.service import IkService
from lrmd.messages.control import PayloadRequest
from lrmd.messages.kinematics import PlanRequest
from lrmd.safety.collision_guard import CollisionGuard
from lrmd.safety.stability import Stability, stability_of
from tests.daemon.control.test_known_obstacles import AWAY
from tests.daemon.safety.test_contact import ABOVE, rigid, soft
from tests.support.daemon.in_memory_daemon import CONFIG
from tests.support.sweep import examples

pytestmark = pytest.mark.long

NARROW = Vehicle(2.0, (-0.05, 0.0, 0.1), ((0.12, 0.12, 0.0), (-0.2, 0.12, 0.0), (-0.2, -0.12, 0.0), (0.12, -0.12, 0.0)))
"""So light that the arm's pose matters: the tip-over angle changes by tens of degrees."""


def on_wheels(keep_deg: float | None = None) -> Config:
    config = replace(load_config(CONFIG), stagger=20_000_000, model=None)
    keep = None if keep_deg is None else float(np.radians(keep_deg))
    return replace(config, arm=replace(config.arm, vehicle=NARROW), tip_over=keep)


def leaning(model: Model, degrees: float) -> Model:
    """On ground that slopes to one side."""
    a = np.radians(degrees)
    return under_gravity(model, (0.0, float(np.sin(a)), float(-np.cos(a))))


def least_angle(model: Model, start: Array, end: Array, payload: float) -> tuple[float, float]:
    """Tip-over angles (rad) at the start, and the least of 400 places of a straight move."""
    q = start + np.linspace(0.0, 1.0, 400)[:, None] * (end - start)
    angles = tip_over_angles(solve_equilibrium(model, poses_of(q, payload)), payload, NARROW, model.constant_gravity)
    return float(angles[0]), float(angles.min())


@given(st.integers(0, 10_000), st.floats(0.0, 0.2), st.floats(0.0, 15.0), st.floats(0.05, 0.5))
@examples(30, 60)
def test_a_way_is_refused_exactly_when_the_angle_falls_below_what_is_kept(
    seed: int, payload: float, slope: float, keep: float
) -> None:
    """Or below that of its start; told by 400 places of it. Nearer than 0.1 deg nothing is claimed."""
    config, rng = on_wheels(), np.random.default_rng(seed)
    model = leaning(soft(config) if seed % 2 else model_of(config.arm, ()), slope)
    start, end = rng.uniform(-1.2, 1.2, (2, 6))
    here, least = least_angle(model, start, end, payload)
    spare = least - min(keep, here)
    refused = Stability(NARROW, keep, model).refused(np.array([start, end]), payload)
    if refused is not None:
        move, number = refused
        assert number == 0
        assert move.distance < move.margin
        assert 0.0 <= move.proven < move.fraction <= 1.0
    if abs(spare) > np.radians(0.1):
        assert (refused is not None) == (spare < 0.0)


def test_a_daemon_refuses_what_would_tip_it_and_only_where_it_is_told_to() -> None:
    """In words, with the angle; a jog stops before it; a load that is told under way stops a motion."""
    plain = on_wheels()
    model = model_of(plain.arm, ())
    here, least = least_angle(model, AWAY, ABOVE, 0.0)
    lowest = float(np.degrees(least))
    assert here > least + np.radians(1.0)
    assert stability_of(plain, model) is None
    config = on_wheels(lowest + 0.5)
    sim = rigid(config, AWAY)
    sim.start(ABOVE)
    sim = rigid(config, AWAY)
    keeping = CollisionGuard(Scene.of(config.arm), None, stability=stability_of(config, model))
    sim.core.adopt_guard(keeping, sim.now)
    with pytest.raises(
        RequestError, match=r"the vehicle would be .* deg from tipping over at .*must be kept"
    ) as refused:
        sim.start(ABOVE)
    assert refused.value.code == "tip_over"
    assert refused.value.detail["tip_over_rad"] < np.radians(lowest + 0.5)
    angles = stability_of(config, model).angles(sim.jogged(ABOVE - AWAY), 0.0)  # type: ignore[union-attr]
    assert angles.min() >= np.radians(lowest + 0.5) - 1e-6
    assert angles.min() < here - np.radians(0.2)
    roomy = replace(keeping, stability=replace(keeping.stability, keep=least - 1e-3))  # type: ignore[type-var]
    sim.core.adopt_guard(roomy, sim.now)
    sim.start(ABOVE)
    sim.keep(20)
    assert sim.core.mode is Mode.MOVING
    sim.core.handle(PayloadRequest(lease=sim.token, payload_kg=0.15), sim.now)
    assert sim.core.mode is Mode.HOLDING


def test_a_plan_keeps_the_angle_too() -> None:
    """Round what the straight way would come too near to, or not at all to a goal that is itself too near."""
    config, rng, keep = on_wheels(), np.random.default_rng(2), 0.0
    model, guard = model_of(config.arm, ()), CollisionGuard(Scene.of(config.arm), None)
    poses = rng.uniform(-1.2, 1.2, (400, 6))
    clear = poses[guard.separation(poses, 0.0) > guard.scene.margin + 0.005]
    for start, end in pairwise(clear):
        here, least = least_angle(model, start, end, 0.0)
        ends = min(here, least_angle(model, end, start, 0.0)[0])
        if least < ends - np.radians(3.0):
            keep = ends - np.radians(1.0)
            break
    keeping = on_wheels(float(np.degrees(keep)))
    service = IkService.of(keeping, deploy(keeping))
    path = service.plan(PlanRequest(from_rad=start.tolist(), to_rad=end.tolist()), lambda: None)
    assert not isinstance(path, NoPlan), path
    assert len(path) > 2
    CollisionGuard(guard.scene, None, stability=stability_of(keeping, model))(path, 0.0)
    angles = stability_of(keeping, model).angles(clear, 0.0)  # type: ignore[union-attr]
    low, high = clear[angles.argmin()], clear[angles.argmax()]
    strict = on_wheels(float(np.degrees(0.5 * (angles.min() + angles.max()))))
    request = PlanRequest(from_rad=high.tolist(), to_rad=low.tolist())
    refused = IkService.of(strict, deploy(strict)).plan(request, lambda: None)
    assert refused == NoPlan("no path: the vehicle would be too near to tipping over at the goal")


@pytest.mark.parametrize("seed", range(6))
def test_a_plan_that_stabilises_never_ends_nearer_to_tipping_than_it_began(seed: int) -> None:
    """It ends among the best of a thousand random poses; the guard allows its way."""
    config, rng = on_wheels(), np.random.default_rng(seed)
    service = IkService.of(config, deploy(config))
    guard, payload = CollisionGuard(Scene.of(config.arm), None), float(rng.choice([0.0, 0.1]))
    poses = rng.uniform(-1.2, 1.2, (1000, 6))
    clear = poses[guard.separation(poses, payload) > guard.scene.margin + 0.005]
    start = clear[0]
    path = service.plan(PlanRequest(from_rad=start.tolist(), stabilise=True, payload_kg=payload), lambda: None)
    assert not isinstance(path, NoPlan), path
    guard(path, payload)
    content = plan_content(service, path, payload)
    begun, ended = content["tip_over_rad"]
    assert ended > begun
    angles = Stability(NARROW, 0.0, model_of(config.arm, ())).angles(clear, payload)
    assert begun == pytest.approx(angles[0], abs=1e-9)
    assert ended > np.quantile(angles, 0.98)


def test_where_nothing_is_better_a_plan_says_so_and_without_a_vehicle_it_is_refused() -> None:
    config = on_wheels()
    service = IkService.of(config, deploy(config))
    path, q = None, ABOVE.tolist()
    for _ in range(12):
        found = service.plan(PlanRequest(from_rad=q, stabilise=True), lambda: None)
        if isinstance(found, NoPlan):
            path = found.text
            break
        q = list(found[-1])
    assert "no pose was found" in path
    bare = replace(config, arm=replace(config.arm, vehicle=None))
    with pytest.raises(RequestError, match=r"has no \[vehicle\]") as refused:
        IkService.of(bare, deploy(bare)).plan(PlanRequest(from_rad=ABOVE.tolist(), stabilise=True), lambda: None)
    assert refused.value.code == "no_vehicle"


def test_a_configuration_that_keeps_an_angle_needs_a_vehicle(tmp_path: Path) -> None:
    text = CONFIG.read_text(encoding="utf-8").replace("[safety]", "[safety]\ntip_over_deg = 5.0")
    path = tmp_path / "lrmd.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(LrmError, match=r"tip_over_deg needs a \[vehicle\]"):
        load_config(path)
