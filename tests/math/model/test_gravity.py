"""Gravity that leans: as an effect of the installation, as poses state it, and the angle at which a vehicle tips."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from lrm_ident.data.rigid_motion import to_xyz_angles
from lrm_math.arm.arm import Arm, Placement
from lrm_math.arm.arm_file import load_arm
from lrm_math.arm.vehicle import Vehicle
from lrm_math.arrays import Array
from lrm_math.effects import ModelPart, compensable, effects_at
from lrm_math.errors import LrmError
from lrm_math.ik.packed_arm import PackedArm
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.model.deployed_model import deployed_part
from lrm_math.model.derivatives import parameter_jacobian
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from lrm_math.model.tip_over import smallest_edge_angle, tip_over_angles
from lrmd.config import load_config
from lrmd.ik.deployed_model import deploy
from lrmd.ik.service import IkService
from lrmd.messages.kinematics import FkRequest, GoalEntry, IkRequest
from tests.conftest import ROOT
from tests.support.daemon.in_memory_daemon import CONFIG
from tests.support.random_arms import arms, some_poses
from tests.support.sweep import examples

TIGHT = 1e-14
ELASTIC = ("compliance", "lateral_compliance")
LEAN = {"gravity.base.x_rad": 0.07, "gravity.base.y_rad": -0.04}


def elastic(arm: Arm, seed: int, lean: dict[str, float] | None = None, softness: float = 0.03) -> Model:
    """The arm with soft joints and links, on a rigid base that leans."""
    effects = [each for name in ELASTIC for each in effects_at(arm, name) if each.place != "base"]
    model = model_of(arm, (*effects, *effects_at(arm, "gravity")))
    soft = dict(zip(model.keys, np.random.default_rng(seed).uniform(0.2, 1.0, len(model.keys)) * softness, strict=True))
    return model_of(arm, model.effects, {key: soft[key] for key in model.keys if "compliance" in key} | (lean or {}))


def stating(poses: Poses, down: Array) -> Poses:
    """The poses with gravity's direction, (3,) or (N, 3), stated."""
    return replace(poses, gravity=np.broadcast_to(down / np.linalg.norm(down), (len(poses), 3)).copy())


def turned(arm: Arm, R: Array) -> Arm:
    """The arm with base and gravity rotated."""
    b = arm.base
    own = Rotation.from_euler("XYZ", [b.alpha, b.beta, b.gamma]).as_matrix()
    (x, y, z), angles = (R @ np.array([b.x, b.y, b.z])).tolist(), to_xyz_angles(R @ own)
    return with_gravity(replace(arm, base=Placement(x, y, z, *angles)), R @ np.array(arm.gravity))


def with_gravity(arm: Arm, gravity: Array) -> Arm:
    x, y, z = gravity.tolist()
    return replace(arm, gravity=(x, y, z))


@pytest.mark.long
@examples(12, 25)
@given(arms, st.integers(0, 100))
def test_an_arm_turned_with_its_gravity_is_the_same_arm(arm: Arm, seed: int) -> None:
    R = Rotation.random(random_state=seed).as_matrix()
    poses = some_poses(arm, seed)
    here = solve_equilibrium(elastic(arm, seed), poses, tolerance=TIGHT)
    there = solve_equilibrium(elastic(turned(arm, R), seed), poses, tolerance=TIGHT)
    np.testing.assert_allclose(there.tcp, here.tcp @ R.T, atol=1e-10)
    np.testing.assert_allclose(there.joint_torque, here.joint_torque, atol=1e-10)


@pytest.mark.long
@examples(12, 25)
@given(arms, st.integers(0, 100))
def test_effect_poses_and_arm_file_state_gravity_alike(arm: Arm, seed: int) -> None:
    down = effects_at(arm, "gravity")[0]
    lean = dict(zip(down.keys, np.random.default_rng(seed).uniform(-0.2, 0.2, 2).tolist(), strict=True))
    poses, by_effect = some_poses(arm, seed), elastic(arm, seed, lean)
    g = np.array(by_effect.constant_gravity)
    assert np.linalg.norm(g) == pytest.approx(np.linalg.norm(arm.gravity), rel=1e-12)
    expected = solve_equilibrium(elastic(with_gravity(arm, g), seed), poses, tolerance=TIGHT).tcp
    np.testing.assert_allclose(solve_equilibrium(by_effect, poses, tolerance=TIGHT).tcp, expected, atol=1e-12)
    for model in (by_effect, elastic(arm, seed)):  # a direction that is stated is known: the effect adds nothing to it
        stated = solve_equilibrium(model, stating(poses, g), tolerance=TIGHT)
        np.testing.assert_allclose(stated.tcp, expected, atol=1e-11)


@pytest.mark.parametrize("count", [1, 7])
def test_a_level_base_gives_the_very_same_numbers(lab: Arm, count: int) -> None:
    poses, level = some_poses(lab, 3, count), elastic(lab, 0)
    without = model_of(lab, level.effects[:-1], {key: level.value(key) for key in level.keys if "compliance" in key})
    expected = solve_equilibrium(without, poses)
    for found in (solve_equilibrium(level, poses), solve_equilibrium(without, stating(poses, np.array([0, 0, -1])))):
        np.testing.assert_array_equal(found.tcp, expected.tcp)
        np.testing.assert_array_equal(found.joint_torque, expected.joint_torque)


def test_each_pose_has_its_own_gravity(lab: Arm) -> None:
    """An arm on a vehicle that was tilted between poses; derivatives follow."""
    rng, poses = np.random.default_rng(5), some_poses(lab, 5, 6)
    several = stating(poses, np.array([0, 0, -1]) + rng.normal(0, 0.2, (6, 3)))
    model = elastic(lab, 1)
    together = solve_equilibrium(model, several, tolerance=TIGHT)
    alone = [solve_equilibrium(model, several.take([row]), tolerance=TIGHT) for row in range(6)]
    np.testing.assert_allclose(together.tcp, np.concatenate([one.tcp for one in alone]), atol=1e-12)
    derivatives = [parameter_jacobian(one) for one in alone]
    np.testing.assert_allclose(parameter_jacobian(together), np.concatenate(derivatives), atol=1e-10)
    assert np.abs(together.tcp - solve_equilibrium(model, poses).tcp).max() > 1e-4


@pytest.mark.parametrize("arm_lies", [False, True])
def test_derivatives_by_the_lean(lab: Arm, arm_lies: bool) -> None:
    """Against central differences, where it already leans; an arm mounted sideways leans about its other axes."""
    arm = replace(lab, gravity=(9.81, 0.0, 0.0)) if arm_lies else lab
    lean = {f"gravity.base.{axis}_rad": 0.06 for axis in ("yz" if arm_lies else "xy")}
    model, poses, h = elastic(arm, 2, lean), some_poses(arm, 2), 1e-5
    J = parameter_jacobian(solve_equilibrium(model, poses, tolerance=TIGHT), [*lean])
    for column, key in enumerate(lean):
        up, down = (
            solve_equilibrium(model.with_values_of([key], lean[key] + step), poses, tolerance=TIGHT).tcp
            for step in (h, -h)
        )
        np.testing.assert_allclose(J[:, :, column], (up - down) / (2 * h), rtol=1e-6, atol=1e-9)
    assert np.abs(J).max() > 1e-3


def test_the_rover_gets_it(lab: Arm) -> None:
    """It belongs to the installation, is deployed, and the compiled kernel has it."""
    (effect,) = effects_at(lab, "gravity")
    assert effect.part is ModelPart.INSTALLATION
    assert compensable(effect)
    model, poses = elastic(lab, 3, LEAN), some_poses(lab, 3)
    assert deployed_part(model) is model
    arm = PackedArm(model)
    assert arm.complete
    kernel = arm.packed.with_(moment=arm.errors.moving.moments(model.weights(0.05)))
    q = poses.q
    slots, tcp, iterations = kernel.settle(q, np.zeros_like(q), arm.unloaded_slots(q), 1e-14)
    assert (iterations > 0).all()
    settled = solve_equilibrium(model, poses_of(q, 0.05), tolerance=TIGHT)
    np.testing.assert_allclose(tcp[:, 9:], settled.tcp, atol=1e-12)
    level = solve_equilibrium(elastic(lab, 3), poses_of(q, 0.05))
    assert np.abs(settled.tcp - level.tcp).max() > 1e-4
    loads = kernel.forward(slots)[1]
    np.testing.assert_allclose(loads, settled.loads_on(arm.errors.moving.slots.tolist()), atol=1e-11)


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
    assert sloped.tip_over_rad < level.tip_over_rad - 0.5 * a
    answer = next(service.inverse(IkRequest(goals=[GoalEntry(position_m=level.tcp_m)], near_rad=q)))
    assert answer.tip_over_rad == pytest.approx(level.tip_over_rad, abs=0.05)
