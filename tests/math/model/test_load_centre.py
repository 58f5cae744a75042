"""The centre of a load: its moments are the slope of its potential energy, in joints and springs, in numpy and in C."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.arm.vehicle import Vehicle
from lrm_math.arrays import ORIGIN, Array, Vector3
from lrm_math.effects import effects_at
from lrm_math.errors import LrmError
from lrm_math.ik.calibrated_arm import CalibratedArm
from lrm_math.kinematics import statics
from lrm_math.kinematics.chain import Chain, Number, chain_of, trig
from lrm_math.kinematics.forward import chain_geometry, frames
from lrm_math.kinematics.poses import poses_of
from lrm_math.kinematics.statics import joint_torques
from lrm_math.model.deployed_model import with_load_at
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from lrm_math.model.tip_over import tip_over_angles
from lrm_math.motion.modes import links_inertia

TIGHT = 1e-14
LOAD = 0.12
STEP = 1e-5
NO_SHRINK = (Phase.explicit, Phase.reuse, Phase.generate)
centres = st.tuples(*[st.floats(-0.1, 0.1)] * 3)
ASIDE = ((0.06, 0.0, 0.0), (0.0, 0.06, 0.0), (0.0, 0.0, 0.06))
ARMS = ("lrm-rover", "lrm-lab", "so101", "two-joint")


def elastic(arm: Arm, seed: int = 0) -> Model:
    """Soft joints, and links that bend and twist."""
    model = model_of(arm, effects_at(arm, "compliance") + effects_at(arm, "lateral_compliance"))
    return model.with_values(np.random.default_rng(seed).uniform(0.005, 0.03, len(model.keys)))


def some_q(arm: Arm, count: int = 4, seed: int = 0) -> Array:
    return np.random.default_rng(seed).uniform(-1.2, 1.2, (count, arm.dof))


def load_energy(chain: Chain, values: list[Number], count: int, centre: Vector3) -> Array:
    """(N,), J: -m g . x of a load alone, x = tool frame times its centre."""
    body = next(body for body in chain.bodies if body.carries_payload)
    tool = frames(chain, values, count)[:, -1]
    at = tool[:, :3, :3] @ (np.array(body.com) + centre) + tool[:, :3, 3]
    return np.asarray(-LOAD * at @ np.array(chain.gravity))


def slope(chain: Chain, values: list[Number], slot: int, count: int, centre: Vector3) -> Array:
    """(N,), -dU/ds of a load by a slot, central difference."""
    low, high = list(values), list(values)
    low[slot], high[slot] = values[slot] - STEP, values[slot] + STEP
    ends = load_energy(chain, high, count, centre), load_energy(chain, low, count, centre)
    return np.asarray((ends[1] - ends[0]) / (2 * STEP))


@pytest.mark.long
@settings(max_examples=12, deadline=None, phases=NO_SHRINK)
@given(st.sampled_from(ARMS), centres, st.integers(0, 50))
def test_moments_on_joints_and_springs_are_the_slope_of_the_loads_energy(name: str, centre: Vector3, seed: int) -> None:
    """The moment balance of the load alone, at the arm's own equilibrium: what it adds to the torque of every slot."""
    model = with_load_at(elastic(load_arm(name), seed), centre)
    q = some_q(model.arm, seed=seed)
    chain, settled = model.chain, solve_equilibrium(model, poses_of(q, LOAD), tolerance=TIGHT)

    values, slots = list(settled.slots), [k for k, slot in enumerate(chain.slots) if slot.rotates]
    with_load, without = (
        statics.loads(chain, values, trig(chain, values), model.weights(kg), chain.gravity, slots) for kg in (LOAD, 0.0)
    )
    for k, loaded, empty in zip(slots, with_load, without, strict=True):
        if chain.moved[k] != chain.counted[k]:
            continue
        expected = slope(chain, values, k, len(q), centre)
        np.testing.assert_allclose(np.broadcast_to(np.subtract(loaded, empty), len(q)), expected, atol=2e-9)


@pytest.mark.parametrize("name", ARMS)
def test_a_centre_of_zero_changes_no_bit(name: str) -> None:
    model, poses = elastic(load_arm(name)), poses_of(some_q(load_arm(name)), LOAD)
    before, after = (solve_equilibrium(one, poses) for one in (model, with_load_at(model, ORIGIN)))
    assert np.array_equal(before.tcp, after.tcp)
    assert np.array_equal(before.joint_torque, after.joint_torque)


def test_without_a_load_its_centre_does_not_count() -> None:
    model, poses = elastic(load_arm("lrm-rover")), poses_of(some_q(load_arm("lrm-rover")), 0.0)
    before, after = (solve_equilibrium(one, poses) for one in (model, with_load_at(model, (0.05, -0.03, 0.08))))
    np.testing.assert_allclose(after.tcp, before.tcp, atol=1e-12)


def test_a_load_aside_turns_the_last_joint_by_its_lever() -> None:
    """50 g, 60 mm along each axis of the tool: squares of the torques about joint 6 sum to (m r)^2 |g across it|^2."""
    arm, q = load_arm("lrm-rover"), [0.0, 1.2, -0.4, 0.3, 0.9, 0.0]
    chain, gravity = chain_of(arm), np.array(arm.gravity)
    at_tcp = joint_torques(chain, arm.gravity, q, 0.05)[5]
    shifted = [joint_torques(chain_of(arm.with_load_at(at)), arm.gravity, q, 0.05)[5] - at_tcp for at in ASIDE]
    axis = chain_geometry(chain, chain.values(q), 1).axis[chain.joint_slots[5], :, 0]
    across = np.linalg.norm(np.cross(axis, gravity))
    assert np.linalg.norm(shifted) == pytest.approx(0.05 * 0.06 * across, rel=1e-9)
    assert across > 1.0


@settings(max_examples=6, deadline=None, phases=NO_SHRINK)
@given(centres, st.integers(0, 50))
def test_the_kernel_settles_where_the_model_does(centre: Vector3, seed: int) -> None:
    rover = CalibratedArm(elastic(load_arm("lrm-rover"), 1))
    q = some_q(rover.model.arm, 6, seed)
    found = rover.with_load_at(centre).equilibria(LOAD, q)
    expected = solve_equilibrium(with_load_at(rover.model, centre), poses_of(q, LOAD), tolerance=TIGHT)
    np.testing.assert_allclose(found.tcp[:, 9:], expected.true_tcp[found.rows], atol=2e-9)
    assert len(found.rows) == len(q)


def test_inertia_and_tipping_have_the_centre_too() -> None:
    """A load that is carried further out swings more slowly, and tips a light vehicle sooner."""
    arm, q = load_arm("lrm-rover"), np.array([[0.0, 1.2, 0.0, 0.0, 0.0, 0.0]])
    further = arm.with_load_at((0.0, 0.0, 0.1))
    assert links_inertia(further, q, 0.2)[0, 1, 1] > 1.1 * links_inertia(arm, q, 0.2)[0, 1, 1]
    vehicle = Vehicle(
        1.0, (-0.15, 0.0, 0.1), ((0.05, 0.5, 0.0), (-0.4, 0.5, 0.0), (-0.4, -0.5, 0.0), (0.05, -0.5, 0.0))
    )
    angles = [
        tip_over_angles(solve_equilibrium(model_of(one, ()), poses_of(q, 0.2)), 0.2, vehicle, (0.0, 0.0, -9.81))[0]
        for one in (arm, further)
    ]
    assert angles[1] < angles[0] - 0.01


def test_an_arm_whose_load_is_not_on_its_tool_has_no_centre_to_shift() -> None:
    arm = load_arm("lrm-rover")
    bare = replace(arm, bodies=tuple(body for body in arm.bodies if not body.carries_payload))
    with pytest.raises(LrmError, match="no body on the tool carries the load"):
        bare.with_load_at((0.0, 0.0, 0.01))
    assert bare.with_load_at(ORIGIN) == bare
