"""Nominal inverse kinematics: solutions are exact and complete, failures are diagnosed."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from lrm_math.arm.arm import MOST_JOINTS, Arm, Joint, Placement
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.ik.answer import IkVerdict, NominalAnswer
from lrm_math.ik.goal import CHAR_LENGTH, Goal, point, point_along, pose, pose_rpy
from lrm_math.ik.nominal import NominalSolver
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.forward import frames
from lrm_math.kinematics.screw_axes import screw_axes_of
from tests.support.random_arms import random_arm
from tests.support.sweep import examples

SHIPPED = ("lrm-lab", "lrm-rover")
seeds = st.integers(0, 10_000)


def meeting_arm(seed: int, first: bool, shape: str) -> Arm:
    """A random arm whose first or last three axes intersect; the other three as `shape` says of the two outer ones."""
    arm = random_arm(seed, 6)
    joints = list(arm.joints)
    a, b, outer = (0, 1, 4) if first else (3, 4, 0)
    joints[a] = replace(joints[a], a=0.0, extra_z=None)
    joints[b] = replace(joints[b], a=0.0, d=0.0)
    if shape == "meeting":
        joints[outer] = replace(joints[outer], a=0.0)
    elif shape == "parallel":
        joints[outer] = replace(joints[outer], alpha=math.pi * (seed % 2))
    return replace(arm, joints=tuple(joints), bodies=())


meeting_arms = st.builds(meeting_arm, seeds, st.booleans(), st.sampled_from(["meeting", "parallel", "skew"]))
shipped = st.sampled_from(SHIPPED).map(load_arm)


def angles(arm: Arm, seed: int, count: int) -> Array:
    lower, upper = ([getattr(j, end) for j in arm.joints] for end in ("lower", "upper"))
    return np.random.default_rng(seed).uniform(lower, upper, (count, arm.dof))


def tool(arm: Arm, q: Array) -> tuple[Array, Array]:
    """TCP (N, 3) and rotation (N, 3, 3) at angles (N, n)."""
    chain = chain_of(arm)
    T = frames(chain, chain.values(list(np.atleast_2d(q).T.copy())), len(np.atleast_2d(q)))[:, -1]
    return T[:, :3, 3], T[:, :3, :3]


def goal_at(arm: Arm, q: Array) -> Goal:
    p, R = tool(arm, q)
    return pose(p[0], R[0])


def apart(a: Array, b: Array) -> Array:
    """Largest difference of the last axis' angles, modulo 2π."""
    return np.abs((a - b + np.pi) % (2 * np.pi) - np.pi).max(axis=-1)


def check_solves(arm: Arm, goal: Goal, answer: NominalAnswer) -> None:
    """Every branch keeps the limits and solves the goal to a nanometre and a nanoradian."""
    assert answer.branches
    for branch in answer:
        p, R = tool(arm, np.array(branch.q))
        assert np.linalg.norm(p[0] - goal.position) < 1e-9
        if goal.rotation is not None:
            assert np.abs(R[0] - goal.rotation).max() < 1e-9
        if goal.approach is not None:
            assert np.abs(R[0][:, 2] - goal.approach).max() < 1e-9
        assert all(j.lower <= x <= j.upper for j, x in zip(arm.joints, branch.q, strict=True))
        assert branch.margin >= 0.0


@pytest.mark.slow
@example(meeting_arm(1425, False, "skew"), 1425)
@example(meeting_arm(775, False, "skew"), 775)
@example(meeting_arm(1271, False, "skew"), 1271)
@given(shipped | meeting_arms, seeds)
def test_every_branch_solves_the_goal_and_the_original_angles_are_found(arm: Arm, seed: int) -> None:
    solver = NominalSolver.of(arm)
    assert solver.form is not None
    for q in angles(arm, seed, 3):
        goal = goal_at(arm, q)
        answer = solver.solve(goal)
        check_solves(arm, goal, answer)
        found = np.array([branch.q for branch in answer])
        assert apart(found, q).min() < 1e-6
        assert all(apart(np.delete(found, i, 0), row).min() > 1e-7 for i, row in enumerate(found) if len(found) > 1)


@pytest.mark.long
@pytest.mark.parametrize("name", SHIPPED)
def test_many_reachable_poses_all_solved(name: str) -> None:
    arm = load_arm(name)
    q = angles(arm, 1, 20_000)
    p, R = tool(arm, q)
    batch = NominalSolver.of(arm).solve_batch(p, R)
    assert batch.solved.all()
    assert np.isfinite(batch.q).all()
    assert np.where(batch.valid, apart(batch.q, q[:, None]), np.inf).min(axis=1).max() < 1e-6
    row, _ = np.nonzero(batch.valid)
    took_p, took_R = tool(arm, batch.q[batch.valid])
    assert np.linalg.norm(took_p - p[row], axis=1).max() < 1e-9
    assert np.abs(took_R - R[row]).max() < 1e-9


@pytest.mark.slow
@given(shipped | meeting_arms, seeds)
@examples(20, 40)
def test_batch_and_single_goals_agree(arm: Arm, seed: int) -> None:
    solver = NominalSolver.of(arm)
    p, R = tool(arm, angles(replace_limits(arm, -3.0, 3.0), seed, 4))
    batch = solver.solve_batch(p, R)
    for i in range(4):
        one = solver.solve(pose(p[i], R[i]))
        assert len(one) == batch.valid[i].sum()
        for branch in one:
            assert batch.valid[i, branch.number]
            np.testing.assert_allclose(batch.q[i, branch.number], branch.q, atol=1e-6)


def replace_limits(arm: Arm, lower: float, upper: float) -> Arm:
    return replace(arm, joints=tuple(replace(j, lower=lower, upper=upper) for j in arm.joints))


@given(shipped | meeting_arms, seeds)
def test_branches_agree_with_eaik(arm: Arm, seed: int) -> None:
    """EAIK (Ostermeier et al. 2024) solves the same arms by other means, without limits."""
    eaik = pytest.importorskip("eaik.IK_HP", reason="EAIK is not installed")
    arm = replace_limits(arm, -math.pi, math.pi)
    lines = screw_axes_of(arm)
    offsets = np.vstack([lines.point[:1], np.diff(lines.point, axis=0), lines.position - lines.point[-1]])
    robot = eaik.HPRobot(lines.axis.copy(), offsets)
    for q in angles(arm, seed, 3):
        p, R = tool(arm, q)
        T = np.eye(4)
        T[:3, 3], T[:3, :3] = p[0], R[0] @ lines.rotation.T
        theirs = np.array(robot.IK(T).Q).reshape(-1, 6)
        took_p, took_R = tool(arm, theirs)
        exact = (np.linalg.norm(took_p - p, axis=1) < 1e-8) & (np.abs(took_R - R).max(axis=(1, 2)) < 1e-7)
        ours = np.array([branch.q for branch in NominalSolver.of(arm).solve(goal_at(arm, q))])
        assert all(apart(ours, x).min() < 1e-5 for x in theirs[exact])
        if exact.all():
            assert all(apart(theirs, x).min() < 1e-5 for x in ours)


@pytest.mark.slow
@given(shipped, seeds)
def test_near_orders_the_branches(arm: Arm, seed: int) -> None:
    q, near = angles(arm, seed, 2)
    goal = goal_at(arm, q)
    distances = [branch.distance(tuple(near)) for branch in NominalSolver.of(arm).solve(goal, near)]
    assert distances == sorted(distances)
    assert apart(np.array(NominalSolver.of(arm).solve(goal, q).branches[0].q), q) < 1e-6
    margins = [branch.margin for branch in NominalSolver.of(arm).solve(goal)]
    assert margins == sorted(margins, reverse=True)


def test_multi_turn_limits_give_the_nearest_equivalent_angle(lab: Arm) -> None:
    arm = replace_limits(lab, -3 * math.pi, 3 * math.pi)
    q = np.array([0.3, 0.5, -0.4, 0.9, 0.7, 0.2])
    for turns in (-1, 0, 1):
        near = q + 2 * math.pi * turns
        best = NominalSolver.of(arm).solve(goal_at(arm, q), near).branches[0]
        np.testing.assert_allclose(best.q, near, atol=1e-9)


@pytest.mark.slow
@given(shipped, seeds, st.integers(0, 63))
def test_angles_at_the_limits_are_found(arm: Arm, seed: int, corner: int) -> None:
    q = angles(arm, seed, 1)[0]
    for i, joint in enumerate(arm.joints):
        if corner & (1 << i):
            q[i] = joint.upper if seed & (1 << i) else joint.lower
    answer = NominalSolver.of(arm).solve(goal_at(arm, q))
    check_solves(arm, goal_at(arm, q), answer)
    assert apart(np.array([branch.q for branch in answer]), q).min() < 1e-6


@pytest.mark.slow
@example(load_arm("lrm-lab"), 811, 0.0)
@given(shipped, seeds, st.sampled_from([1e-3, 1e-5, 1e-7, 1e-9, 1e-11, 0.0]))
def test_axes_1_and_3_aligned(arm: Arm, seed: int, tilt: float) -> None:
    q = angles(arm, seed, 1)[0] * 0.4
    q[1] = tilt
    goal = goal_at(arm, q)
    answer = NominalSolver.of(arm).solve(goal)
    check_solves(arm, goal, answer)
    if tilt == 0.0:
        assert answer.verdict is IkVerdict.SINGULAR
        assert "1 and 3" in answer.singularity
        families = [branch.q[0] + branch.q[2] for branch in answer if branch.free is not None]
        assert any(turn == pytest.approx(q[0] + q[2], abs=1e-6) for turn in families)
        assert NominalSolver.of(arm).solve(goal, q).branches[0].distance(tuple(q)) < 1e-6


@pytest.mark.parametrize("name", SHIPPED)
def test_self_motion_with_few_members_within_the_limits(name: str) -> None:
    arm = load_arm(name)
    q = np.array([arm.joints[0].upper - 1e-4, 0.0, arm.joints[2].upper - 1e-4, 0.8, -0.5, 0.1])
    check_solves(arm, goal_at(arm, q), NominalSolver.of(arm).solve(goal_at(arm, q)))


def industrial_arm() -> Arm:
    """A shoulder over a turntable, two links of 200 mm, a spherical wrist."""
    right = math.pi / 2
    links = [
        (0, 0.1, 0, right), (0, 0, 0.2, 0), (right, 0, 0, right), (0, 0.2, 0, -right), (0, 0, 0, right),
        (0, 0.05, 0, 0),
    ]  # fmt: skip
    joints = tuple(Joint(theta, d, a, alpha, None, -3.0, 3.0) for theta, d, a, alpha in links)
    return Arm("industrial", (0.0, 0.0, -9.81), Placement(z=0.2, beta=0.3), joints, Placement(x=0.03, alpha=0.2), ())


@given(seeds)
@examples(10, 20)
def test_shoulder_singularity(seed: int) -> None:
    arm = industrial_arm()
    q = angles(arm, seed, 1)[0] * 0.4
    q[1], q[2], q[4] = math.radians(60), math.radians(60), 0.7
    goal = goal_at(arm, q)
    answer = NominalSolver.of(arm).solve(goal)
    check_solves(arm, goal, answer)
    assert answer.verdict is IkVerdict.SINGULAR
    assert "axes 4, 5 and 6 meet lies on axis 1" in answer.singularity
    assert any(branch.free == 1 for branch in answer)
    assert NominalSolver.of(arm).solve(goal, q).branches[0].distance(tuple(q)) < 1e-6


@pytest.mark.slow
@example(arm=load_arm("lrm-lab"), seed=175)
@given(shipped, seeds)
def test_stretched_arms_at_the_edge_of_reach(arm: Arm, seed: int) -> None:
    q = angles(arm, seed, 1)[0]
    q[3] = 0.0
    goal = goal_at(arm, q)
    answer = NominalSolver.of(arm).solve(goal)
    check_solves(arm, goal, answer)
    assert answer.verdict is IkVerdict.SINGULAR
    assert "axis 5" in answer.singularity
    best = NominalSolver.of(arm).solve(goal, q).branches[0]
    assert best.q[2] + best.q[4] == pytest.approx(q[2] + q[4], abs=1e-6)


def metric(goal: Goal, p: Array, R: Array) -> Array:
    """(N,), errors of poses from a goal: metres, and angles times the characteristic length."""
    chord = np.zeros(len(p))
    if goal.rotation is not None:
        chord = np.linalg.norm(R - goal.rotation, axis=(-1, -2)) / np.sqrt(8.0)
    if goal.approach is not None:
        chord = np.linalg.norm(R[..., 2] - goal.approach, axis=-1) / 2.0
    return np.hypot(np.linalg.norm(p - goal.position, axis=-1), 2.0 * CHAR_LENGTH * np.arcsin(np.minimum(chord, 1.0)))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["pose", "point", "point_along"])
@examples(4, 8)
@given(seed=seeds, arm=shipped)
def test_nearest_is_reachable_and_nothing_is_nearer(kind: str, seed: int, arm: Arm) -> None:
    solver = NominalSolver.of(arm)
    rng = np.random.default_rng(seed)
    p, R = tool(arm, angles(arm, seed, 1))
    far = p[0] + 0.4 * (p[0] - screw_axes_of(arm).point[1]) / np.linalg.norm(
        p[0] - screw_axes_of(arm).point[1]
    ) * rng.uniform(1, 3)
    goal = {"pose": pose(far, R[0]), "point": point(far), "point_along": point_along(far, R[0][:, 2])}[kind]
    answer = solver.solve(goal)
    assert answer.verdict in (IkVerdict.OUT_OF_REACH, IkVerdict.OUTSIDE_LIMITS)
    assert not answer.solved
    assert answer.nearest is not None
    near = answer.nearest
    check_solves(arm, near.goal, solver.solve(near.goal, near.q))
    there = tool(arm, np.array(near.q))
    best = metric(goal, *there)[0]
    assert np.linalg.norm(np.array(near.goal.position) - goal.position) == pytest.approx(near.distance, abs=1e-12)
    lower, upper = (np.array([getattr(j, end) for j in arm.joints]) for end in ("lower", "upper"))
    anywhere = angles(arm, seed, 3000)
    around = np.clip(near.q + rng.normal(0, 0.02, (3000, 6)), lower, upper)
    assert metric(goal, *tool(arm, np.vstack([anywhere, around]))).min() > best - 1e-9


def test_out_of_reach_by_the_length_of_the_stretched_arm(lab: Arm) -> None:
    shoulder = screw_axes_of(lab).point[1]
    wrist = 103.505e-3 + 43.06953e-3 + 107.75e-3 + 43.25e-3 + 73.27e-3
    out = np.array([math.sin(math.pi / 3), 0.0, math.cos(math.pi / 3)])
    answer = NominalSolver.of(lab).solve(point(shoulder + (wrist + 0.05) * out))
    assert answer.verdict is IkVerdict.OUT_OF_REACH
    assert answer.nearest.distance == pytest.approx(0.05, abs=1e-9)
    assert "out of reach" in str(answer)
    assert "50.00 mm" in str(answer)


@given(shipped, seeds)
@examples(10, 20)
def test_outside_limits_names_the_joint_and_the_excess(arm: Arm, seed: int) -> None:
    q = angles(arm, seed, 1)[0]
    goal, tight = goal_at(arm, q), replace_limits(arm, -0.05, 0.05)
    answer = NominalSolver.of(tight).solve(goal)
    free = NominalSolver.of(replace_limits(arm, -math.pi, math.pi)).solve(goal)
    least = min(max(abs(x) - 0.05 for x in branch.q) for branch in free)
    if least > 0.0:
        assert answer.verdict is IkVerdict.OUTSIDE_LIMITS
        assert answer.violation.excess == pytest.approx(least, abs=1e-6)
        assert f"joint {answer.violation.joint}" in str(answer)
        assert abs(answer.beyond[0].q[answer.violation.joint - 1]) == pytest.approx(0.05 + least, abs=1e-6)


@pytest.mark.slow
@given(shipped, seeds)
@examples(20, 40)
def test_positions_and_directions_of_reachable_poses_are_solved(arm: Arm, seed: int) -> None:
    q, near = angles(arm, seed, 2)
    p, R = tool(arm, q)
    for goal in (point(p[0]), point_along(p[0], R[0][:, 2])):
        check_solves(arm, goal, NominalSolver.of(arm).solve(goal))
        check_solves(arm, goal, NominalSolver.of(arm).solve(goal, near))
        already = NominalSolver.of(arm).solve(goal, q).branches[0]
        assert already.distance(tuple(q)) < 1e-3, "an arm that is there already need not move"


@pytest.mark.slow
def test_free_roll_minimises_joint_motion(lab: Arm) -> None:
    turns = np.linspace(0, 2 * np.pi, 1000)
    about = np.array([[[math.cos(t), -math.sin(t), 0], [math.sin(t), math.cos(t), 0], [0, 0, 1]] for t in turns])
    solver, further = NominalSolver.of(lab), 0
    for seed in range(200):
        q, near = angles(lab, seed, 2)
        p, R = tool(lab, q)
        ours = solver.solve(point_along(p[0], R[0][:, 2]), near).branches[0].distance(tuple(near))
        batch = solver.solve_batch(np.tile(p[0], (len(turns), 1)), R[0] @ about)
        further += ours > np.linalg.norm(batch.q - near, axis=-1)[batch.valid].min() + 1e-5
    assert further <= 2, "turns that a branch allows for less than two degrees may be missed, rarely"


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_arms_without_a_closed_form(seed: int) -> None:
    arm = random_arm(seed, 6)
    solver = NominalSolver.of(arm)
    assert solver.form is None
    for q in angles(arm, seed, 3):
        goal = goal_at(arm, q)
        answer = solver.solve(goal, q + 0.05)
        check_solves(arm, goal, answer)
        assert apart(np.array([branch.q for branch in answer]), q).min() < 1e-6


def test_a_calibrated_arm_near_a_closed_form(lab: Arm) -> None:
    joints = tuple(replace(j, a=j.a + 1e-3 * (i + 1), alpha=j.alpha + 0.01) for i, j in enumerate(lab.joints))
    bent = replace(lab, joints=joints)
    assert NominalSolver.of(bent).form is None
    q = angles(bent, 5, 1)[0]
    p, R = tool(bent, q)
    answer = NominalSolver.of(bent).solve(pose(p[0], R[0]))
    check_solves(bent, pose(p[0], R[0]), answer)
    batch = NominalSolver.of(bent).solve_batch(p, R)
    assert batch.valid[0].sum() == min(8, len(answer))


@pytest.mark.parametrize("joints", [3, 4, 7, 12, MOST_JOINTS])
def test_arms_of_other_numbers_of_joints(joints: int) -> None:
    arm = random_arm(joints, joints)
    q = angles(arm, joints, 1)[0]
    p, R = tool(arm, q)
    goal = pose(p[0], R[0]) if joints > 4 else point(p[0])
    check_solves(arm, goal, NominalSolver.of(arm).solve(goal))


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: point([0.1, float("nan"), 0.2]), "finite"),
        (lambda: point([0.1, 0.2]), r"shape \(2,\)"),
        (lambda: pose([0, 0, 0], np.eye(3) * 1.01), "off orthonormal by 0.0201"),
        (lambda: pose([0, 0, 0], np.diag([1.0, 1.0, -1.0])), "mirror"),
        (lambda: pose([0, 0, 0], [[1, 0], [0, 1]]), "shape"),
        (lambda: point_along([0, 0, 0], [0, 0, 0]), "zero"),
        (lambda: pose_rpy([0, 0, 0], 0.0, float("inf"), 0.0), "pitch"),
        (lambda: point("here"), "numbers"),
        (lambda: Goal((0.0, 0.0, 0.0), None, (0.0, 0.0, 2.0)), "length 2"),
        (lambda: Goal((0.0, 0.0, 0.0), ((1, 0, 0), (0, 1, 0), (0, 0, 1)), (0.0, 0.0, 1.0)), "both"),
    ],
)
def test_invalid_goals_are_refused(make: object, says: str) -> None:
    with pytest.raises(LrmError, match=says):
        make()  # type: ignore[operator]


def test_rounded_rotations_are_orthonormalised(lab: Arm) -> None:
    q = angles(lab, 3, 1)[0]
    p, R = tool(lab, q)
    goal = pose(p[0], R[0].round(6))
    np.testing.assert_allclose(np.array(goal.rotation) @ np.array(goal.rotation).T, np.eye(3), atol=1e-14)
    check_solves(lab, goal, NominalSolver.of(lab).solve(goal))


def test_roll_pitch_yaw_turn_about_fixed_axes() -> None:
    np.testing.assert_allclose(
        pose_rpy([0, 0, 0], 0.0, 0.0, math.pi / 2).rotation, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15
    )
    np.testing.assert_allclose(
        pose_rpy([0, 0, 0], math.pi / 2, 0.0, math.pi / 2).rotation, [[0, 0, 1], [1, 0, 0], [0, 1, 0]], atol=1e-15
    )


def test_invalid_queries_are_refused(lab: Arm) -> None:
    with pytest.raises(LrmError, match="6 finite joint angles"):
        NominalSolver.of(lab).solve(point([0.2, 0, 0.2]), [0.0] * 5)
    with pytest.raises(LrmError, match="6 finite joint angles"):
        NominalSolver.of(lab).solve(point([0.2, 0, 0.2]), [0.0] * 5 + [float("nan")])
    with pytest.raises(LrmError, match="shape"):
        NominalSolver.of(lab).solve_batch([[0.1, 0.2, 0.3]], np.eye(3))
    with pytest.raises(LrmError, match="goal 2"):
        NominalSolver.of(lab).solve_batch([[0.1, 0.2, 0.3], [0.1, np.inf, 0.3]], [np.eye(3)] * 2)
