"""Laws of statics that the model must obey on any arm, of the centre of a load, and of the iteration to rest."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.arm.vehicle import Vehicle
from lrm_math.arrays import ORIGIN, Array, Vector3
from lrm_math.effects import CATALOGUE, effects_at
from lrm_math.effects.base import Effect
from lrm_math.effects.compliance import Spring
from lrm_math.errors import LrmError, NoEquilibrium
from lrm_math.ik.calibrated_arm import CalibratedArm
from lrm_math.kinematics import statics
from lrm_math.kinematics.chain import Chain, Number, chain_of, trig
from lrm_math.kinematics.forward import chain_geometry, frames
from lrm_math.kinematics.poses import poses_of
from lrm_math.kinematics.statics import joint_torques
from lrm_math.model.deployed_model import with_load_at
from lrm_math.model.derivatives import parameter_jacobian
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.fixed_point import MOST_ITERATIONS, Relaxation
from lrm_math.model.model import Model, model_of
from lrm_math.model.tip_over import tip_over_angles
from lrm_math.motion.modes import links_inertia
from tests.support.central_differences import stepped
from tests.support.random_arms import arms, some_poses
from tests.support.sweep import examples

TIGHT = 1e-14


def elastic(arm: Arm, seed: int, softness: float = 0.1) -> Model:
    """The arm with springs at base, joints and links, of random compliance up to `softness` rad/Nm."""
    effects = effects_at(arm, "compliance") + effects_at(arm, "lateral_compliance")
    model = model_of(arm, effects)
    return model.with_values(np.random.default_rng(seed).uniform(0.2, 1.0, len(model.keys)) * softness)


def gravity_energy(arm: Arm, slots: list[object], payload: Array, chain: Chain | None = None) -> Array:
    """(N,), potential energy of all bodies (J)."""
    chain = chain or chain_of(arm)
    bodies = chain_geometry(chain, slots, len(payload)).body  # type: ignore[arg-type]
    weights = statics.weights(chain, payload)
    heights = np.einsum("c,bcn->bn", -np.array(arm.gravity), bodies)
    return np.sum([w.mass * h for w, h in zip(weights, heights, strict=True)], axis=0)


@pytest.mark.slow
@given(arms, st.integers(0, 100))
def test_load_is_the_slope_of_the_energy(arm: Arm, seed: int) -> None:
    poses = some_poses(arm, seed)
    chain = chain_of(arm)
    slots = chain.values([poses.angle(i) for i in range(arm.dof)])
    load_slots = [k for k, slot in enumerate(chain.slots) if slot.rotates]
    loads = statics.loads(
        chain, slots, trig(chain, slots), statics.weights(chain, poses.payload), chain.gravity, load_slots
    )
    h = 1e-6
    payload = np.tile(poses.payload, len(load_slots))
    up, down = (gravity_energy(arm, [*stepped(slots, load_slots, len(poses), s)], payload) for s in (h, -h))
    for load, slope in zip(loads, ((up - down) / (2 * h)).reshape(-1, len(poses)), strict=True):
        np.testing.assert_allclose(load, -slope, atol=1e-8)


@pytest.mark.slow
@examples(15, 30)
@given(arms, st.integers(0, 100))
def test_equilibrium_is_a_stationary_point_of_elastic_and_gravitational_energy(arm: Arm, seed: int) -> None:
    model, poses = elastic(arm, seed, 0.05), some_poses(arm, seed)
    equilibrium = solve_equilibrium(model, poses, tolerance=TIGHT)
    chain = model.chain
    nominal = chain.values([poses.angle(i) for i in range(arm.dof)])
    stiffness = {
        chain.index[key]: 1.0 / k
        for effect, values in model.parts()
        if isinstance(effect, Spring)
        for key, k in zip(effect.targets, effect.compliances(values), strict=True)
        if k
    }

    def energy(slots: list[object]) -> Array:
        spring = sum(0.5 * c * (slots[k] - nominal[k]) ** 2 for k, c in stiffness.items())  # type: ignore[operator]
        return spring + gravity_energy(arm, slots, poses.payload, chain)

    slots, h = list(equilibrium.slots), 1e-5
    for k in stiffness:
        up, down = ([*slots[:k], slots[k] + s, *slots[k + 1 :]] for s in (h, -h))
        np.testing.assert_allclose((energy(up) - energy(down)) / (2 * h), 0.0, atol=1e-8)


@pytest.mark.slow
@given(arms, st.integers(0, 100))
def test_load_derivatives_against_central_differences(arm: Arm, seed: int) -> None:
    poses = some_poses(arm, seed, 2)
    chain = chain_of(arm)
    slots = chain.values([poses.angle(i) for i in range(arm.dof)])
    load_slots = [k for k, slot in enumerate(chain.slots) if slot.rotates]
    weights = statics.weights(chain, poses.payload)
    H = statics.load_derivatives(chain, chain_geometry(chain, slots, 2), weights, chain.gravity, load_slots)
    h = 1e-6
    every = range(len(chain.slots))
    steps = [stepped(slots, every, 2, s) for s in (h, -h)]
    all_weights = statics.weights(chain, np.tile(poses.payload, len(every)))
    plus, minus = (
        np.array(
            np.broadcast_arrays(*statics.loads(chain, some, trig(chain, some), all_weights, chain.gravity, load_slots))
        )
        for some in steps
    )
    for j in every:
        np.testing.assert_allclose(H[:, j], (plus - minus)[:, 2 * j : 2 * j + 2] / (2 * h), atol=1e-8)


def test_load_derivatives_with_bodies_that_load_other_joints(lab: Arm) -> None:
    chain = chain_of(lab)
    poses = some_poses(lab, 3, 20)
    slots = chain.values([poses.angle(i) for i in range(6)])
    rng = np.random.default_rng(0)
    for i in range(1, 6):
        slots[chain.index[f"link{i}.x"]], slots[chain.index[f"link{i}.y"]] = rng.normal(0, 0.05, 2).tolist()
    felt_keys = ("base.beta", "link2.x", "link2.y", "link4.y", *(f"joint{i}.theta" for i in range(1, 7)))
    load_slots = sorted(chain.index[key] for key in felt_keys)
    weights = statics.weights(chain, poses.payload)
    H = statics.load_derivatives(chain, chain_geometry(chain, slots, 20), weights, chain.gravity, load_slots)
    h = 1e-6
    for j in range(len(chain.slots)):
        up, down = ([*slots[:j], slots[j] + s, *slots[j + 1 :]] for s in (h, -h))
        plus = np.array(
            np.broadcast_arrays(*statics.loads(chain, up, trig(chain, up), weights, chain.gravity, load_slots))
        )
        minus = np.array(
            np.broadcast_arrays(*statics.loads(chain, down, trig(chain, down), weights, chain.gravity, load_slots))
        )
        np.testing.assert_allclose(H[:, j], (plus - minus) / (2 * h), atol=1e-9)


@pytest.mark.slow
@given(arms, st.integers(0, 100), st.floats(1e-3, 1.0))
def test_stiff_limit_is_the_rigid_arm(arm: Arm, seed: int, scale: float) -> None:
    poses = some_poses(arm, seed)
    rigid = solve_equilibrium(model_of(arm, ()), poses).tcp
    sag = [
        np.linalg.norm(
            solve_equilibrium(elastic(arm, seed, 1e-6 * s), poses, tolerance=TIGHT).tcp - rigid, axis=1
        ).max()
        for s in (scale, 10 * scale)
    ]
    assert sag[0] <= 1e-5 * scale * 10
    assert sag[1] == pytest.approx(10 * sag[0], rel=1e-3, abs=1e-12)


@pytest.mark.slow
@given(arms, st.integers(0, 100), st.floats(-3.0, 3.0))
def test_turning_the_base_and_gravity_together_changes_no_load(arm: Arm, seed: int, angle: float) -> None:
    """Base and gravity rotated together about the vertical axis: torques are invariant, positions rotate."""
    if arm.base.alpha or arm.base.beta:
        arm = replace(arm, base=replace(arm.base, alpha=0.0, beta=0.0))
    c, s = np.cos(angle), np.sin(angle)
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    x, y, z = (R @ [arm.base.x, arm.base.y, arm.base.z]).tolist()
    turned = replace(
        arm,
        gravity=tuple((R @ arm.gravity).tolist()),
        base=replace(arm.base, x=x, y=y, z=z, gamma=arm.base.gamma + angle),
    )
    poses = some_poses(arm, seed)
    before, after = (solve_equilibrium(_joints_only(a, seed), poses, tolerance=TIGHT) for a in (arm, turned))
    np.testing.assert_allclose(after.joint_torque, before.joint_torque, atol=1e-9)
    np.testing.assert_allclose(after.tcp, before.tcp @ R.T, atol=1e-9)


def _joints_only(arm: Arm, seed: int) -> Model:
    effects = [e for e in effects_at(arm, "compliance") if e.place != "base"]
    model = model_of(arm, effects)
    return model.with_values(np.random.default_rng(seed).uniform(0.01, 0.05, len(model.keys)))


@given(arms, st.integers(0, 100))
def test_without_gravity_nothing_bends(arm: Arm, seed: int) -> None:
    weightless = replace(arm, gravity=(0.0, 0.0, 0.0))
    poses = some_poses(arm, seed)
    bent = solve_equilibrium(elastic(weightless, seed), poses)
    np.testing.assert_allclose(bent.tcp, solve_equilibrium(model_of(arm, ()), poses).tcp, atol=1e-15)
    np.testing.assert_array_equal(bent.joint_torque, 0.0)


@pytest.mark.slow
@given(st.integers(0, 50))
def test_poses_of_a_batch_are_independent(lab: Arm, seed: int) -> None:
    """Batches do not mix poses: any subset gives the same result."""
    model, poses = elastic(lab, seed, 0.08), some_poses(lab, seed, 6)
    whole = solve_equilibrium(model, poses, tolerance=TIGHT).tcp
    rows = np.random.default_rng(seed).permutation(6)[:3]
    np.testing.assert_allclose(solve_equilibrium(model, poses.take(rows), tolerance=TIGHT).tcp, whole[rows], atol=1e-12)


@pytest.mark.parametrize("kind", CATALOGUE, ids=lambda kind: kind.id)
def test_one_pose_alone_is_as_the_same_pose_twice(lab: Arm, kind: type[Effect]) -> None:
    """One pose is computed with floats, many with arrays, whatever an effect depends on."""
    rng, effects = np.random.default_rng(0), effects_at(lab, kind.id)
    model = model_of(lab, effects)
    model = model.with_values([p.default or rng.uniform(0.1, 0.4) * p.typical for p in model.parameters])
    given = {"direction": np.ones((1, 6)), "t": np.full(1, 900.0), "session": np.full(1, 2.0)}
    one = replace(some_poses(lab, 0, 1), temperature=np.full(1, 31.0), **given)
    alone, twice = solve_equilibrium(model, one), solve_equilibrium(model, one.take([0, 0]))
    np.testing.assert_allclose(alone.tcp, twice.tcp[:1], atol=1e-12)
    np.testing.assert_allclose(parameter_jacobian(alone), parameter_jacobian(twice)[:1], atol=1e-9)


def test_a_warm_start_ends_at_the_same_place(lab: Arm) -> None:
    poses = some_poses(lab, 1, 50)
    soft, softer = elastic(lab, 1, 0.08), elastic(lab, 1, 0.085)
    cold = solve_equilibrium(softer, poses)
    warm = solve_equilibrium(softer, poses, start=solve_equilibrium(soft, poses))
    np.testing.assert_allclose(warm.tcp, cold.tcp, atol=1e-8)
    assert warm.iterations < cold.iterations


def test_backlash_is_taken_up_towards_gravity(lab: Arm) -> None:
    poses = some_poses(lab, 2, 200)
    rigid = solve_equilibrium(model_of(lab, ()), poses)
    play = {"backlash.joint2.b_rad": 0.04, "backlash.joint2.tau0_Nm": 0.001}
    loose = solve_equilibrium(model_of(lab, effects_at(lab, "backlash@joint2"), play), poses)
    k = loose.model.chain.index["joint2.theta"]
    turned = np.asarray(loose.slots[k]) - poses.q[:, 1]
    strong = np.abs(rigid.joint_torque[:, 1]) > 0.1
    np.testing.assert_allclose(turned[strong], 0.02 * np.sign(loose.joint_torque[strong, 1]), atol=1e-9)


def test_no_equilibrium_is_an_error_that_names_the_pose(lab: Arm) -> None:
    limp = model_of(lab, effects_at(lab, "compliance"), {"compliance.joint2.k_rad_per_Nm": 5.0})
    poses = poses_of([[0.1, 1.0, 0, 0, 0, 0], [0, 0.9, 0, 0, 0, 0]])
    with pytest.raises(NoEquilibrium, match=r"pose 1 and 1 more.*rad/Nm") as caught:
        solve_equilibrium(limp, poses)
    assert caught.value.poses == (1, 2)


@given(st.integers(0, 200), st.integers(1, 6))
def test_a_very_compliant_joint_gives_an_error_or_a_valid_equilibrium(lab: Arm, seed: int, joint: int) -> None:
    """At any pose: an error, or an equilibrium with small deflections."""
    limp = model_of(lab, effects_at(lab, "compliance"), {f"compliance.joint{joint}.k_rad_per_Nm": 5.0})
    poses = some_poses(lab, seed, 1)
    try:
        equilibrium = solve_equilibrium(limp, poses)
    except NoEquilibrium:
        return
    turned = (
        float(np.asarray(equilibrium.slots[limp.chain.index[f"joint{joint}.theta"]]).item()) - poses.q[0, joint - 1]
    )
    turned -= lab.joints[joint - 1].theta
    assert abs(turned) <= 0.5
    assert turned == pytest.approx(5.0 * equilibrium.joint_torque[0, joint - 1], abs=1e-7)


def iterations(step_at: Callable[[float], float], x: float) -> tuple[float, int]:
    """The fixed point from x, and how many relaxed steps lead there."""
    relaxed: Relaxation | None = None
    for number in range(1, MOST_ITERATIONS + 1):
        step = np.array([[step_at(x)]])
        if abs(step[0, 0]) < 1e-9:
            return x, number
        relaxed = Relaxation.after(relaxed, step)
        x += float(relaxed.factor[0] * step[0, 0])
    return x, MOST_ITERATIONS + 1


@given(st.floats(-8.0, 0.99), st.floats(-3.0, 3.0))
def test_a_line_is_settled_in_a_few_steps(slope: float, x: float) -> None:
    """Slope of the fixed-point map: it overshoots below -1, and creeps near 1."""
    found, number = iterations(lambda at: (slope - 1.0) * at, x)
    assert abs(found) < 1e-6
    assert number < 200


@pytest.mark.parametrize("gap", [1e-4, 1e-5, 1e-6])
def test_where_two_ends_of_a_play_have_just_become_one_is_passed(gap: float) -> None:
    """A plain iteration takes some pi / sqrt(gap) steps past the point that hardly moves, to where it rests."""
    found, number = iterations(lambda at: (at * at + gap) * (1.0 - at), -0.5)
    assert found == pytest.approx(1.0, abs=1e-6)
    assert number <= MOST_ITERATIONS


LOAD = 0.12
STEP = 1e-5
NO_SHRINK = (Phase.explicit, Phase.reuse, Phase.generate)
centres = st.tuples(*[st.floats(-0.1, 0.1)] * 3)
ASIDE = ((0.06, 0.0, 0.0), (0.0, 0.06, 0.0), (0.0, 0.0, 0.06))
ARMS = ("lrm-rover", "lrm-lab", "so101", "two-joint")


def elastic_under_load(arm: Arm, seed: int = 0) -> Model:
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
    model = with_load_at(elastic_under_load(load_arm(name), seed), centre)
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
    model, poses = elastic_under_load(load_arm(name)), poses_of(some_q(load_arm(name)), LOAD)
    before, after = (solve_equilibrium(one, poses) for one in (model, with_load_at(model, ORIGIN)))
    assert np.array_equal(before.tcp, after.tcp)
    assert np.array_equal(before.joint_torque, after.joint_torque)


def test_without_a_load_its_centre_does_not_count() -> None:
    model, poses = elastic_under_load(load_arm("lrm-rover")), poses_of(some_q(load_arm("lrm-rover")), 0.0)
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
    rover = CalibratedArm(elastic_under_load(load_arm("lrm-rover"), 1))
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
