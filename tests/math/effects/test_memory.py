"""Effects with a memory: what is left of a load that was held before, and what rows of a file mean for it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.effects.base import Effect
from lrm_math.effects.derivatives import STEP, by_loads, by_parameters
from lrm_math.effects.memory.creep import LONG_S
from lrm_math.kinematics.history import history_of
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.model.deployed_model import as_deployed, as_deployed_when_read
from lrm_math.model.derivatives import parameter_jacobian
from lrm_math.model.equilibrium import solve_equilibrium, with_borne_loads
from lrm_math.model.model import Model, model_of
from lrm_math.model.state_after_session import state_after_session
from tests.support.sweep import examples

COUNT = 30
K, T, SOUND = 0.05, 60.0, 1e-12


def some_poses(arm: Arm, seed: int = 0, t: Array | None = None) -> Poses:
    """Poses with a history; a reading every 5 to 60 s if no times are given."""
    rng = np.random.default_rng(seed)
    poses = poses_of(rng.uniform(-1.2, 1.2, (COUNT, arm.dof)))
    time = np.cumsum(rng.uniform(5.0, 60.0, COUNT)) if t is None else t
    return with_history(replace(poses, t=time, number=np.arange(1, COUNT + 1)))


def with_history(poses: Poses, session: Array | None = None) -> Poses:
    assert poses.number is not None
    return replace(poses, history=history_of(poses.q, poses.payload, poses.t, session, poses.number))


def torque(effect: Effect, poses: Poses) -> Array:
    """(N,), torque of the nominal arm on the effect's joint at poses in the order measured."""
    rigid = model_of(effect.arm, effects_at(effect.arm, "offsets"))
    return solve_equilibrium(rigid, poses).joint_torque[:, 1]


def crept(arm: Arm, poses: Poses, stood: float = LONG_S, rest: float = LONG_S, late: float = 0.0) -> Array:
    """(N,), creep of joint 2 under the nominal loads."""
    [effect] = effects_at(arm, "creep@joint2")
    bare = replace(poses, history=None)
    return np.asarray(effect.amounts(poses, (torque(effect, bare),), (K, T, stood, rest, late))[0])


@pytest.mark.parametrize(("stood", "late"), [(0.0, 0.0), (10.0, 0.0), (LONG_S, 0.0), (LONG_S, 0.6), (LONG_S, 1.0)])
def test_creep_follows_its_differential_equation(lab: Arm, stood: float, late: float) -> None:
    """Against many small steps of T dc/dt = τ − c, with the load of the pose that the arm stands at."""
    poses = some_poses(lab)
    assert poses.t is not None
    [effect] = effects_at(lab, "creep@joint2")
    tau = torque(effect, replace(poses, history=None))
    state, expected, parts = tau[0], [tau[0]], 4000
    for row in range(1, COUNT):
        step = poses.t[row] - poses.t[row - 1]
        for part in range(parts):
            there = (parts - part) * step / parts <= min(stood, (1.0 - late) * step)
            state += step / parts / T * (tau[row if there else row - 1] - state)
        expected.append(state)
    np.testing.assert_allclose(crept(lab, poses, stood, late=late), K * np.array(expected), rtol=0.0, atol=1e-3 * K)


def test_where_nothing_is_known_of_before_it_is_a_spring(lab: Arm) -> None:
    poses = replace(some_poses(lab), history=None)
    [effect] = effects_at(lab, "creep@joint2")
    np.testing.assert_allclose(crept(lab, poses), K * torque(effect, poses))


def test_after_hours_it_is_the_same_spring(lab: Arm) -> None:
    poses = some_poses(lab, t=1e6 * np.arange(1.0, COUNT + 1))
    np.testing.assert_allclose(crept(lab, poses), crept(lab, replace(poses, history=None)), atol=SOUND)


def test_rows_in_another_order_are_put_in_that_of_their_times(lab: Arm) -> None:
    poses = some_poses(lab)
    shuffled = np.random.default_rng(1).permutation(COUNT)
    again = with_history(poses.take(shuffled))
    np.testing.assert_allclose(crept(lab, again), crept(lab, poses)[shuffled], atol=SOUND)


def test_what_was_before_stays_when_rows_are_left_out(lab: Arm) -> None:
    poses = some_poses(lab)
    np.testing.assert_allclose(crept(lab, poses.take([3, 17])), crept(lab, poses)[[3, 17]], atol=SOUND)


def test_a_session_begins_with_nothing_known(lab: Arm) -> None:
    poses = some_poses(lab)
    later = with_history(poses, np.repeat([1.0, 2.0], COUNT // 2))
    spring = crept(lab, replace(poses, history=None))
    assert crept(lab, later)[COUNT // 2] == pytest.approx(spring[COUNT // 2])


def test_poses_measured_at_once_do_not_creep_between_them(lab: Arm) -> None:
    poses = some_poses(lab)
    q, t = poses.q.copy(), np.array(poses.t)
    q[11], t[11] = q[10], t[10]
    found = crept(lab, with_history(replace(poses, q=q, t=t)))
    assert found[11] == pytest.approx(found[10])


def test_a_repeated_pose_goes_on_creeping_towards_its_load(lab: Arm) -> None:
    q = np.repeat(np.random.default_rng(0).uniform(-1.2, 1.2, (2, lab.dof)), COUNT // 2, axis=0)
    poses = with_history(replace(some_poses(lab), q=q))
    left = np.abs(crept(lab, poses) - crept(lab, replace(poses, history=None)))[COUNT // 2 :]
    assert (np.diff(left) < 0.0).all()


def test_without_times_poses_follow_in_equal_steps_and_a_missing_number_takes_one(lab: Arm) -> None:
    poses = replace(some_poses(lab), t=None, number=np.delete(np.arange(1, COUNT + 2), 7))
    timed = replace(poses, t=10.0 * np.delete(np.arange(1.0, COUNT + 2), 7))
    np.testing.assert_allclose(crept(lab, with_history(poses)), crept(lab, with_history(timed)), atol=SOUND)


@pytest.mark.parametrize(
    "name", ["creep@joint2", "creep@base", "creep_spectrum@joint3", "self_heating@joint3", "slip@joint2"]
)
@examples(5, 10)
@given(seed=st.integers(0, 1000))
def test_derivatives_are_those_of_the_amounts(lab: Arm, name: str, seed: int) -> None:
    [effect], rng, poses = effects_at(lab, name), np.random.default_rng(seed), some_poses(lab, seed)
    tau = tuple(rng.normal(0.0, 0.3, COUNT) for _ in effect.load_slots)
    shapes = {"T_s": 80.0, "stood_s": rng.uniform(1.0, 4.0), "rest_s": 40.0, "tau0_Nm": 2.0, "late_s_per_s": 0.3}
    p = [shapes.get(q.name, 0.4 * q.typical) for q in effect.parameters]
    for j, rows in enumerate(by_parameters(effect, poses, tau, p)):
        step = STEP * effect.parameters[j].typical
        up, down = ([x + s * (i == j) for i, x in enumerate(p)] for s in (step, -step))
        ends = zip(effect.amounts(poses, tau, up), effect.amounts(poses, tau, down), strict=True)
        for own, (above, below) in zip(rows, ends, strict=True):
            numeric = (np.asarray(above) - np.asarray(below)) / (2.0 * step)
            np.testing.assert_allclose(np.broadcast_to(own, COUNT), numeric, rtol=1e-6, atol=1e-9)
    for rows in by_loads(effect, poses, tau, p):
        assert all((np.asarray(row) >= 0.0).all() for row in rows)  # an own load pulls its own way


def test_derivatives_through_the_equilibrium(lab: Arm) -> None:
    """Models whose joints yield at once and slowly, and warm."""
    poses = some_poses(lab)
    effects = (*effects_at(lab, "compliance"), *effects_at(lab, "creep"), *effects_at(lab, "self_heating@joint2"))
    model = model_of(lab, effects)
    model = model.with_values([p.default or 0.5 * p.typical for p in model.parameters])
    settled = solve_equilibrium(model, poses, tolerance=1e-14)
    keys = ["creep.joint2.k_rad_per_Nm", "creep.joint3.T_s", "creep.base.k_y_rad_per_Nm", "self_heating.joint2.T_s"]
    J = parameter_jacobian(settled, keys)
    for column, key in zip(J.transpose(2, 0, 1), keys, strict=True):
        h = 1e-4 * model.parameter(key).typical
        up, down = (model.with_values_of([key], [model.value(key) + s]) for s in (h, -h))
        tips = [
            solve_equilibrium(one, settled.poses, settled, 1e-14).tcp for one in (up, down)
        ]  # the same loads before
        np.testing.assert_allclose(column, (tips[0] - tips[1]) / (2.0 * h), atol=1e-6 * np.abs(column).max() + 1e-13)


def test_loads_before_a_pose_are_those_of_the_arm_itself(lab: Arm) -> None:
    """A joint that gives way by degrees, with a payload: the nominal arm bears other loads."""
    poses = with_history(replace(some_poses(lab), payload=np.full(COUNT, 0.3)))
    model = model_of(lab, (*effects_at(lab, "compliance"), *effects_at(lab, "creep@joint2")))
    model = model.with_values_of(["compliance.joint2.k_rad_per_Nm", "creep.joint2.k_rad_per_Nm"], [0.1, K])
    settled = solve_equilibrium(model, poses)
    [slot] = [model.load_slots.index(k) for k in model.load_slots if model.chain.slots[k].key == "joint2.theta"]
    borne = settled.poses.history.visits.loads(model.chain, ("joint2.theta",))[:, 0]
    bare = solve_equilibrium(model_of(lab, ()), replace(poses, history=None)).joint_torque[:, 1]
    own = np.asarray(settled.tau[slot])
    assert np.abs(borne - own).max() < 0.05 * np.abs(bare - own).max()


def test_loads_before_some_of_the_poses_are_known_from_all(lab: Arm) -> None:
    poses, rows = some_poses(lab), np.array([4, 9, 20])
    model = model_of(lab, (*effects_at(lab, "compliance"), *effects_at(lab, "creep@joint2")))
    model = model.with_values_of(["compliance.joint2.k_rad_per_Nm", "creep.joint2.k_rad_per_Nm"], [0.1, K])
    known = solve_equilibrium(model, with_borne_loads(model, poses).take(rows)).tcp
    np.testing.assert_allclose(known, solve_equilibrium(model, poses).tcp[rows], atol=1e-8)
    np.testing.assert_allclose(solve_equilibrium(model, poses.take(rows)).tcp, known, atol=1e-5)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_way_to_the_first_pose_counts_where_it_is_known(lab: Arm, side: float) -> None:
    q = np.zeros((2, lab.dof))
    q[1, 1] = 0.2
    of = history_of(q, np.zeros(2), None, None, np.arange(2), start=np.full(lab.dof, -0.1 * side))
    assert of.visits.sides(1).tolist() == [side, 1.0]


@examples(10, 20)
@given(seed=st.integers(0, 1000))
def test_a_slip_never_passes_its_bound_and_moves_at_reversals_only(lab: Arm, seed: int) -> None:
    poses = some_poses(lab, seed)
    [effect] = effects_at(lab, "slip@joint2")
    z = np.asarray(effect.amounts(poses, (), (1.0, 0.3))[0])
    assert np.abs(z).max() <= 1.0
    moves = np.sign(np.diff(poses.q[:, 1], prepend=poses.q[0, 1]))
    reversed_now = np.append([False, False], moves[2:] * moves[1:-1] < 0.0)
    np.testing.assert_allclose(np.diff(z, prepend=0.0)[~reversed_now], 0.0, atol=SOUND)


def test_a_servo_warms_with_the_square_of_its_load_from_cold(lab: Arm) -> None:
    poses = some_poses(lab, t=1e5 * np.arange(1.0, COUNT + 1))
    [effect] = effects_at(lab, "self_heating@joint2")
    found = np.asarray(effect.amounts(poses, (), (0.1, 0.0, 100.0))[0])
    assert found[0] == 0.0
    np.testing.assert_allclose(found[1:], 0.1 * torque(effect, replace(poses, history=None))[1:] ** 2, atol=1e-9)


SHARE = 0.012


def campaign(arm: Arm, session: tuple[int, ...] | None = None, shuffle: bool = False) -> Poses:
    """40 poses in an order; shuffled rows keep their times."""
    rng = np.random.default_rng(3)
    q, t, number = rng.uniform(-1.0, 1.0, (40, arm.dof)), np.linspace(0.0, 390.0, 40), np.arange(1, 41)
    rows = rng.permutation(40) if shuffle else np.arange(40)
    sessions = None if session is None else np.array(session)
    history = history_of(q[rows], np.zeros(40), t[rows], sessions, number)
    return replace(poses_of(q[rows]), t=t[rows], number=number, history=history)


def late(arm: Arm) -> Model:
    """The lab arm with springs, read too early."""
    names = ("offsets", "compliance", "settling_error@frame")
    effects = tuple(effect for name in names for effect in effects_at(arm, name))
    values = {"compliance.joint2.k_rad_per_Nm": 0.05, "settling_error.frame.e_rad_per_rad": SHARE}
    return model_of(arm, effects, values)


def stopped_short(poses: Poses) -> Poses:
    """Where the joints stood: by the rows' times, a share of the way from the pose before is missing."""
    order = np.argsort(poses.t)
    q = poses.q.copy()
    q[order[1:]] -= SHARE * (poses.q[order[1:]] - poses.q[order[:-1]])
    return poses_of(q)


@pytest.mark.parametrize("shuffle", [False, True])
def test_each_joint_lacks_a_share_of_its_last_move(lab: Arm, shuffle: bool) -> None:
    poses, model = campaign(lab, shuffle=shuffle), late(lab)
    settled = model.with_values_of(["settling_error.frame.e_rad_per_rad"], [0.0])
    np.testing.assert_allclose(
        solve_equilibrium(model, poses).tcp, solve_equilibrium(settled, stopped_short(poses)).tcp, atol=1e-8
    )


def test_the_first_pose_of_a_session_lacks_nothing(lab: Arm) -> None:
    poses = campaign(lab, (1,) * 20 + (2,) * 20)
    [effect] = effects_at(lab, "settling_error@frame")
    amounts = np.array(effect.amounts(poses, (), (1.0,)))
    assert not amounts[:, [0, 20]].any()
    np.testing.assert_allclose(amounts[:, 1], poses.q[0] - poses.q[1])


def test_the_arm_does_not_keep_it(lab: Arm) -> None:
    """Deployed is the arm at rest; with the readings of the measurement the model that was at rest nowhere counts."""
    poses, model = campaign(lab), late(lab)
    model = model.with_state(state_after_session(solve_equilibrium(model, poses)))
    rest = model.with_values_of(["settling_error.frame.e_rad_per_rad"], [0.0])
    found = [solve_equilibrium(one, poses).tcp for one in (as_deployed(model), as_deployed_when_read(model, poses))]
    np.testing.assert_allclose(found[0], solve_equilibrium(rest, poses).tcp, atol=1e-12)
    np.testing.assert_allclose(found[1], solve_equilibrium(model, poses).tcp, atol=1e-12)
