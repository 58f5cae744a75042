"""Answers of the ik service: agreement with model, servo tables and shapes; errors for invalid requests."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from typing import get_args

import msgpack
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lrm_math.arrays import ORIGIN, Array
from lrm_math.collision.scene import Scene, clearance, clearance_of
from lrm_math.effects.measured_range import MeasuredRange
from lrm_math.errors import LrmError
from lrm_math.ik.answer import Solved
from lrm_math.ik.methods import DEFAULT, METHODS, Direct, Iterative
from lrm_math.kinematics.forward import frames
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.deployed_model import under_gravity, with_load_at
from lrm_math.model.equilibrium import Equilibrium, solve_equilibrium
from lrm_math.model.model import Model
from lrmd.config import Config, load_config
from lrmd.errors import RequestError
from lrmd.ik.deployed_model import deploy
from lrmd.ik.service import IkService, goal_of, solver_of
from lrmd.messages.codec import Message, MessageError, unpack
from lrmd.messages.kinematics import FkAnswer, FkRequest, GoalEntry, IkAnswer, IkRequest, PlanRequest
from tests.conftest import TABLE_B2
from tests.math.collision.test_collision import sampled_distance
from tests.soak.fuzz_ik import fuzz
from tests.support.daemon.in_memory_daemon import CONFIG
from tests.support.sweep import examples

EXACT = 1e-6
"""m: largest error of a polished answer, a thousandth of a millimetre."""


@lru_cache
def config() -> Config:
    return replace(load_config(CONFIG), model=TABLE_B2)


@lru_cache
def service() -> IkService:
    return IkService.of(config(), deploy(config()))


@lru_cache
def drawn_service() -> IkService:
    """The nominal arm's: nothing bends."""
    drawn = replace(config(), model=None)
    return IkService.of(drawn, deploy(drawn))


def test_a_request_may_name_every_method_and_no_other() -> None:
    assert set(get_args(IkRequest.model_fields["method"].annotation)) == set(METHODS)
    assert IkRequest.model_fields["method"].default == DEFAULT.name


def solve_goals(*goals: GoalEntry, **more: object) -> list[IkAnswer]:
    return list(service().inverse(IkRequest(goals=list(goals), **more)))  # type: ignore[arg-type]


@pytest.mark.parametrize(("factor", "said"), [(1e-3, "too small, m where mm are meant"), (1e3, "too large, mm where")])
def test_a_goal_that_seems_to_be_in_another_unit_is_told(factor: float, said: str) -> None:
    """Before: "base and link6 would be -40.2 mm apart", or a distance of hundreds of metres."""
    place = np.array([0.09, -0.05, 0.09])  # within 0.1 m, as farther goals are no valid message in mm
    (answer,) = solve_goals(GoalEntry(position_m=(place * factor).tolist()))
    assert answer.q_rad is None
    assert said in answer.text
    here = [0.0] * config().dof
    line = PlanRequest(from_rad=here, goal=GoalEntry(position_m=(place * factor).tolist()), line=True)
    assert said in service().plan(line, lambda: None).text  # type: ignore[union-attr]
    (beyond,) = solve_goals(GoalEntry(position_m=(place * 20.0).tolist()))
    assert "times too" not in beyond.text


def bent(q: Array, payload: float) -> Array:
    """(N, n + 2, 4, 4), frames of the arm at rest for commands (N, n), by the model alone."""
    model = service().deployed.model
    return frames(model.chain, solve_equilibrium(model, poses_of(q, payload)).slots, len(q))


def limits() -> tuple[Array, Array]:
    joints = config().arm.joints
    return np.array([j.lower for j in joints]), np.array([j.upper for j in joints])


def anywhere(seed: int) -> Array:
    return np.random.default_rng(seed).uniform(*limits())


def quaternion_of(R: Array) -> list[float]:
    """x, y, z, w, from the eigenvector of Bar-Itzhack's (2000) matrix: no formula of the code under test."""
    K = np.array(
        [
            [R[0, 0] - R[1, 1] - R[2, 2], R[0, 1] + R[1, 0], R[0, 2] + R[2, 0], R[2, 1] - R[1, 2]],
            [R[0, 1] + R[1, 0], R[1, 1] - R[0, 0] - R[2, 2], R[1, 2] + R[2, 1], R[0, 2] - R[2, 0]],
            [R[0, 2] + R[2, 0], R[1, 2] + R[2, 1], R[2, 2] - R[0, 0] - R[1, 1], R[1, 0] - R[0, 1]],
            [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], R.trace()],
        ]
    )
    return np.linalg.eigh(K)[1][:, -1].tolist()  # type: ignore[no-any-return]


def pose_goal(T: Array) -> GoalEntry:
    return GoalEntry(position_m=T[:3, 3].tolist(), quaternion_xyzw=quaternion_of(T[:3, :3]))


def reached_goal(seed: int, payload: float = 0.0) -> GoalEntry:
    """A pose that the bent arm has for some commands."""
    return pose_goal(bent(anywhere(seed)[None], payload)[0, -1])


def clear_rows(q: Array, payload: float) -> NDArray[np.bool_]:
    """(N,), in which poses (N, n) both the rigid and the bent arm keep the margin."""
    scene = Scene.of(config().arm)
    rigid, sagging = clearance(scene, q), clearance_of(scene, bent(q, payload))
    return np.asarray(np.minimum(rigid.distance, sagging.distance) >= scene.margin)


def assert_true(answer: IkAnswer, goal: GoalEntry, payload: float, exact: bool = True) -> None:
    """A solved answer agrees with the model, the servo tables and the shapes.

    The tool is at the goal if the method is exact, else within the millimetre at which the thesis's iteration stops,
    turned by as much as the answer predicts.
    """
    assert answer.q_rad is not None
    assert answer.predicted_error_m is not None
    assert answer.tcp_m is not None
    q, (lower, upper) = np.array(answer.branches_rad), limits()
    assert answer.q_rad == answer.branches_rad[0]
    assert ((q >= lower) & (q <= upper)).all()
    assert clear_rows(q, payload).all()
    tools = bent(q, payload)[:, -1]
    np.testing.assert_allclose(tools[:, :3, 3], [goal.position_m] * len(q), atol=EXACT if exact else Iterative().enough)
    np.testing.assert_allclose(answer.tcp_m, tools[0, :3, 3], atol=EXACT)
    assert answer.predicted_error_m == pytest.approx(math.dist(answer.tcp_m, goal.position_m), abs=1e-9)
    turn = 0.0 if exact else answer.predicted_turn_rad
    if goal.quaternion_xyzw is not None:
        for tool in tools:
            cosine = abs(np.dot(quaternion_of(tool[:3, :3]), goal.quaternion_xyzw))
            assert cosine == pytest.approx(math.cos(turn / 2), abs=1e-9)
    if goal.approach is not None:
        along = np.array(goal.approach) / np.linalg.norm(goal.approach)
        sine = np.linalg.norm(np.cross(tools[:, :3, 2], along), axis=1)
        np.testing.assert_allclose(sine, math.sin(turn), atol=1e-5)
        assert (tools[:, :3, 2] @ along > 0).all()
    clock, tables = config().clock, [joint.servo for joint in config().arm.joints]
    counts = answer.counts or []
    put_out = [float(t.angle_of(clock.pulse_of(c))) for t, c in zip(tables, counts, strict=True) if t is not None]
    np.testing.assert_allclose(put_out, answer.rounded_q_rad or [], atol=1e-12)
    lands = bent(np.array([put_out]), payload)[0, -1]
    assert answer.rounded_error_m == pytest.approx(math.dist(lands[:3, 3], goal.position_m), abs=EXACT)
    assert answer.rounded_turn_rad == pytest.approx(turn_between(lands[:3, :3], goal), abs=1e-6)


def turn_between(tool: Array, goal: GoalEntry) -> float:
    """Angle (rad) between a tool (3, 3) and what a goal asks of it, by scipy; 0 for a position alone."""
    if goal.quaternion_xyzw is not None:
        return float((Rotation.from_matrix(tool).inv() * Rotation.from_quat(goal.quaternion_xyzw)).magnitude())
    if goal.approach is None:
        return 0.0
    along = np.array(goal.approach) / np.linalg.norm(goal.approach)
    return float(np.arctan2(np.linalg.norm(np.cross(tool[:, 2], along)), tool[:, 2] @ along))


@pytest.mark.slow
@examples(25, 50)
@given(
    seed=st.integers(0, 10_000), payload=st.sampled_from([0.0, 0.0663]), method=st.sampled_from(sorted(METHODS)),
    kind=st.sampled_from(["pose", "approach", "point"]), near=st.booleans(), rounding=st.sampled_from(["each", "best"]),
)  # fmt: skip
def test_answers_agree_with_model(seed: int, payload: float, method: str, kind: str, near: bool, rounding: str) -> None:
    tool = bent(anywhere(seed)[None], payload)[0, -1]
    position, along = tool[:3, 3].tolist(), tool[:3, 2].tolist()
    goal = {
        "pose": pose_goal(tool),
        "approach": GoalEntry(position_m=position, approach=along),
        "point": GoalEntry(position_m=position),
    }[kind]
    here = anywhere(seed + 1).tolist() if near else None
    (answer,) = solve_goals(goal, payload_kg=payload, method=method, near_rad=here, round=rounding)
    assert answer.verdict in ("solved", "collision", "not_converged", "outside_limits")
    assert method != "direct" or answer.verdict in ("solved", "collision"), "a pose that the arm can have"
    if answer.verdict == "solved":
        assert_true(answer, goal, payload, exact=method != "iterative")
    else:
        assert answer.q_rad is None
        assert not answer.branches_rad


@pytest.mark.slow
def test_where_the_first_branch_collides_a_free_one_is_the_answer_with_figures_of_its_own() -> None:
    solver, found = solver_of(config(), service().deployed), 0
    everywhere = np.array([anywhere(seed) for seed in range(400)])
    blocked = everywhere[~clear_rows(everywhere, 0.0)]
    for here, tool in zip(blocked.tolist(), bent(blocked, 0.0)[:, -1], strict=True):
        goal = GoalEntry(position_m=tool[:3, 3].tolist(), approach=tool[:3, 2].tolist())
        reply = solver.solve(goal_of(goal), near=here, method=Direct())
        assert isinstance(reply, Solved)
        free = clear_rows(np.array([branch.q for branch in reply.branches]), 0.0).tolist()
        (answer,) = solve_goals(goal, near_rad=here, method="direct")
        assert (answer.verdict == "solved") == any(free)
        if not free[0] and any(free):
            found += 1
            assert answer.q_rad == list(reply.branches[free.index(True)].q)
            assert_true(answer, goal, 0.0)
    assert found >= 3, "too few goals of this kind among these to say anything"


@pytest.mark.parametrize("method", ["cube", "direct"])
def test_a_singular_pose_names_a_joint_that_can_turn(method: str) -> None:
    """Axes 1 and 3 in line, of the arm as drawn: the smallest singular value is zero; elsewhere no joint is named."""
    model = drawn_service().deployed.model

    def tool(q: Array) -> Array:
        return frames(model.chain, solve_equilibrium(model, poses_of(q[None])).slots, 1)[0, -1]

    def turning(q: Array) -> tuple[float, Array]:
        """Smallest singular value of the Jacobian by differences, turns weighed by 0.1 m, and its joint motion."""
        h, rows = 1e-6, []
        for step in h * np.eye(6):
            up, down = tool(q + step), tool(q - step)
            spin = (up - down)[:3, :3] @ tool(q)[:3, :3].T / (2 * h)
            rows.append([*(up - down)[:3, 3] / (2 * h), *(0.1 * np.array([spin[2, 1], spin[0, 2], spin[1, 0]]))])
        _, values, motions = np.linalg.svd(np.array(rows).T)
        return float(values[-1]), motions[-1]

    aligned = np.array([0.3, 0.0, -0.6, 0.3, 0.5, 0.2])
    sizes = [turning(aligned + angle * np.eye(6)[1])[0] for angle in (0.0, 0.5)]
    assert sizes[0] < 1e-6 < 1e-3 < sizes[1]
    for angle, singular in ((0.0, True), (0.5, False)):
        goal = pose_goal(tool(aligned + angle * np.eye(6)[1]))
        (answer,) = drawn_service().inverse(IkRequest(goals=[goal], method=method))  # type: ignore[arg-type]
        assert answer.verdict == "solved"
        assert len(answer.free_joints) == len(answer.branches_rad)
        assert any(answer.free_joints) == singular
        for q, free in zip(answer.branches_rad, answer.free_joints, strict=True):
            if free:
                size, motion = turning(np.array(q))
                assert size < 2e-4
                assert abs(motion[free - 1]) > 0.6 * abs(motion).max()


def test_a_collision_names_two_bodies_and_their_distance() -> None:
    answers = [a for a in solve_goals(*map(reached_goal, range(80)), method="direct") if a.verdict == "collision"]
    assert answers
    shapes, margin = config().arm.shapes, config().arm.shapes.margin
    for answer in answers:
        assert set(answer.bodies) <= set(shapes.names)
        assert len(answer.bodies) == 2
        assert answer.clearance_m < margin
        assert all(word in answer.text for word in (*answer.bodies, f"{answer.clearance_m * 1e3:.1f} mm"))


def test_the_distance_of_a_collision_is_that_of_plain_geometry() -> None:
    """A nominal arm does not sag; points on the capsules' axes and link matrices, nothing else, see the distance."""
    rigid = drawn_service()
    seen = 0
    for seed in range(60):
        at = anywhere(seed)
        place = next(rigid.forward(FkRequest(q_rad=[at.tolist()])))
        goal = GoalEntry(position_m=place.tcp_m, quaternion_xyzw=quaternion_of(np.array(place.rotation)))
        (answer,) = rigid.inverse(IkRequest(goals=[goal], near_rad=at.tolist(), method="direct"))
        if answer.verdict == "collision" and answer.clearance_m is not None and answer.clearance_m > 0:
            distance = sampled_distance(config().arm, at, *answer.bodies, 60)
            assert distance == pytest.approx(answer.clearance_m, abs=2e-3)
            seen += 1
    assert seen >= 2


@examples(20, 40)
@given(st.tuples(*[st.floats(-3, 3)] * 3), st.tuples(*[st.floats(-3, 3)] * 3))
def test_turns_and_quaternion_are_one_goal(rpy: tuple[float, float, float], along: tuple[float, float, float]) -> None:
    half = [a / 2 for a in rpy]
    turns = [(math.sin(h) * np.eye(3)[axis], math.cos(h)) for axis, h in enumerate(half)]

    def product(p: tuple[Array, float], q: tuple[Array, float]) -> tuple[Array, float]:
        (u, a), (v, b) = p, q
        return a * v + b * u + np.cross(u, v), a * b - float(np.dot(u, v))

    vector, scalar = product(turns[2], product(turns[1], turns[0]))
    quaternion = [*vector.tolist(), scalar]
    same = [
        goal_of(GoalEntry(position_m=[0.1, 0.2, 0.3], rpy_rad=list(rpy))),
        goal_of(GoalEntry(position_m=[0.1, 0.2, 0.3], quaternion_xyzw=quaternion)),
        goal_of(GoalEntry(position_m=[0.1, 0.2, 0.3], quaternion_xyzw=[-x for x in quaternion])),
    ]
    for other in same[1:]:
        np.testing.assert_allclose(np.array(other.rotation), np.array(same[0].rotation), atol=1e-12)
    if np.linalg.norm(along) > 0.1:
        longer = [goal_of(GoalEntry(position_m=[0, 0, 0.0], approach=[k * x for x in along])) for k in (1, 2.5)]
        np.testing.assert_allclose(longer[0].approach, longer[1].approach, atol=1e-12)


def test_a_batch_is_answered_in_order_and_like_single_goals() -> None:
    goals = [reached_goal(5), GoalEntry(position_m=[5.0, 0, 0]), reached_goal(6), GoalEntry(position_m=[0.2, 0.1, 0.3])]
    together = solve_goals(*goals, method="direct")
    alone = [solve_goals(goal, method="direct")[0] for goal in goals]
    for one, other in zip(together, alone, strict=True):
        assert one.model_copy(update={"elapsed_ms": 0.0}) == other.model_copy(update={"elapsed_ms": 0.0})
    assert together[1].verdict == "out_of_reach"


def test_the_nearest_command_to_what_is_out_of_reach_is_as_near_as_it_says() -> None:
    rng, (lower, upper) = np.random.default_rng(3), limits()
    for _ in range(10):
        position = (rng.normal(size=3) * 2).clip(-3, 3)
        (answer,) = solve_goals(GoalEntry(position_m=position.tolist()), method="direct")
        if answer.verdict == "solved":
            continue
        q = np.array(answer.nearest_rad)
        assert ((q >= lower) & (q <= upper)).all()
        distance = float(np.linalg.norm(bent(q[None], 0.0)[0, -1, :3, 3] - position))
        assert answer.nearest_distance_m == pytest.approx(distance, abs=EXACT)


@pytest.mark.slow
def test_the_best_counts_are_never_worse_than_the_nearest_of_each_joint() -> None:
    goals = [reached_goal(seed) for seed in range(40)]
    each, best = (solve_goals(*goals, method="direct", round=how) for how in ("each", "best"))
    pairs = [(a.rounded_error_m, b.rounded_error_m) for a, b in zip(each, best, strict=True)]
    known = [(a, b) for a, b in pairs if a is not None and b is not None]
    assert len(known) > 20
    assert all(b <= a for a, b in known)
    assert np.median([b for _, b in known]) < 0.6 * np.median([a for a, _ in known])


@pytest.mark.slow
@examples(30, 60)
@given(
    angles=st.lists(st.sampled_from([0.0, 0.5, -0.7, math.pi / 2, 1.7]), min_size=6, max_size=6),
    near=st.sampled_from([None, "zero", "there"]), method=st.sampled_from(["direct", "cube"]),
)  # fmt: skip
def test_the_drawn_arm_solves_poses_with_aligned_axes(angles: list[float], near: str | None, method: str) -> None:
    drawn = drawn_service()
    place = next(drawn.forward(FkRequest(q_rad=[angles])))
    here = {"zero": [0.0] * 6, "there": angles, None: None}[near]
    goal = GoalEntry(position_m=place.tcp_m, quaternion_xyzw=quaternion_of(np.array(place.rotation)))
    ask = IkRequest(goals=[goal], near_rad=here, method=method)  # type: ignore[arg-type]
    (answer,) = drawn.inverse(ask)
    assert answer.verdict in ("solved", "collision")
    for branch in answer.branches_rad:
        back = next(drawn.forward(FkRequest(q_rad=[branch])))
        np.testing.assert_allclose(back.tcp_m, place.tcp_m, atol=EXACT)


def test_a_direction_leaves_equations_without_a_unique_answer_which_is_no_reason_to_fail() -> None:
    """Two questions to the drawn arm whose Newton steps have matrices that are singular to the last bit."""
    found = [
        ([0.3118282770975559, -0.10881796946858899, 0.4085660519256962],
         [0.021305887141035637, 0.015719398573535697, 0.007556811556273123],
         [-3.258763547376413, -4.038096081750809, 2.79356728312084, 5.235987755982989, -3.6040125341365727,
          -3.232601886770838]),
        ([0.20489454064015145, 0.18958699302829513, 0.13133562033038665],
         [-0.019831091625694436, 0.025913422199892625, -0.014396296377060008],
         [4.84936174584451, -5.235987755982989, 4.570705232835024, -0.25305121602087177, -3.435296056952226,
          -3.311362092498135]),
    ]  # fmt: skip
    for position, along, here in found:
        goal = GoalEntry(position_m=position, approach=along)
        (answer,) = drawn_service().inverse(IkRequest(goals=[goal], near_rad=here, method="direct"))
        assert answer.verdict == "solved"


@pytest.mark.slow
@examples(12, 25)
@given(seed=st.integers(0, 10_000), payload=st.floats(0.3, 2.0))
def test_an_answer_for_an_overloaded_arm_is_a_unique_equilibrium(seed: int, payload: float) -> None:
    """The answer is where the model has the arm rest when nothing is known of how it got there."""
    tool = bent(anywhere(seed)[None], 0.0)[0, -1]
    (answer,) = solve_goals(pose_goal(tool), payload_kg=payload, method="direct")
    assert answer.text
    if answer.verdict == "solved":
        assert_true(answer, pose_goal(tool), payload)


@pytest.mark.slow
def test_random_requests_violate_nothing() -> None:
    result, _ = fuzz(120, 3)
    assert result.violations == []


def test_forward_kinematics_is_that_of_the_sagging_arm() -> None:
    q = np.array([anywhere(seed) for seed in range(20)])
    places = list(service().forward(FkRequest(q_rad=q.tolist(), payload_kg=0.05)))
    tools = bent(q, 0.05)[:, -1]
    np.testing.assert_allclose([p.tcp_m for p in places], tools[:, :3, 3], atol=1e-8)
    np.testing.assert_allclose([p.rotation for p in places], tools[:, :3, :3], atol=1e-7)


# ---- invalid requests

GOAL = {"position_m": [0.2, 0.1, 0.3]}
HOME = [0.0] * 6
WRONG: list[tuple[type[Message], dict[str, object], str]] = [
    (IkRequest, {"goals": [{"position_m": [200.0, 100.0, 300.0]}]}, "goals.0.position_m.0"),
    (IkRequest, {"goals": [{"position_mm": [0.2, 0.1, 0.3]}]}, "goals.0.position_m"),
    (IkRequest, {"goals": [{"position_m": [0.2, 0.1]}]}, "goals.0.position_m"),
    (IkRequest, {"goals": [{"position_m": [0.2, 0.1, math.nan]}]}, "goals.0.position_m.2"),
    (IkRequest, {"goals": [{**GOAL, "rpy_rad": [0.0, 90.0, 0.0]}]}, "goals.0.rpy_rad.1"),
    (IkRequest, {"goals": [{**GOAL, "rpy_rad": HOME[:3], "approach": [0.0, 0.0, 1.0]}]}, "give one of them"),
    (IkRequest, {"goals": [{**GOAL, "quaternion_xyzw": [0.0, 0.0, 0.0, 2.0]}]}, "length 2; should be 1"),
    (IkRequest, {"goals": [GOAL, {**GOAL, "quaternion_xyzw": [0.0, 0.0, 0.0, 0.0]}]}, "goals.1: quaternion_xyzw"),
    (IkRequest, {"goals": [{**GOAL, "approach": [0.0, 0.0, 0.0]}]}, "goals.0: approach is the zero vector"),
    (IkRequest, {"goals": []}, "goals"),
    (IkRequest, {"goals": [GOAL], "near_rad": HOME[:5]}, "near_rad: 5 angles; lrm-rover has 6 joints"),
    (IkRequest, {"goals": [GOAL], "near_rad": [90.0] * 6}, "near_rad.0"),
    (IkRequest, {"goals": [GOAL], "payload_kg": 66.3}, "payload_kg"),
    (IkRequest, {"goals": [GOAL], "payload_kg": -0.1}, "payload_kg"),
    (IkRequest, {"goals": [GOAL], "method": "magic"}, "method"),
    (IkRequest, {"goals": [GOAL], "cube_points": 1}, "cube_points"),
    (FkRequest, {"q_rad": HOME}, "q_rad.0"),
    (FkRequest, {"q_rad": [HOME, HOME[:4]]}, "q_rad.1: 4 angles; lrm-rover has 6 joints"),
    (PlanRequest, {"from_rad": HOME}, "give to_rad or goal"),
    (PlanRequest, {"from_rad": HOME, "to_rad": HOME, "goal": GOAL}, "give to_rad or goal"),
    (PlanRequest, {"from_rad": HOME, "to_rad": HOME[:3]}, "to_rad: 3 angles; lrm-rover has 6 joints"),
]


def ask(kind: type[Message], content: dict[str, object]) -> None:
    match unpack(kind, msgpack.packb(content)):
        case IkRequest() as request:
            next(service().inverse(request))
        case FkRequest() as request:
            next(service().forward(request))
        case PlanRequest() as request:
            service().plan(request, lambda: None)


@pytest.mark.parametrize(("kind", "content", "says"), WRONG)
def test_wrong_shapes_and_units_name_the_field(kind: type[Message], content: dict[str, object], says: str) -> None:
    with pytest.raises(MessageError) as caught:
        ask(kind, content)
    assert says in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def test_a_question_is_answered_goal_by_goal() -> None:
    """The next question is computed next, so that a long question can wait for others between two goals."""
    good = GoalEntry(position_m=[0.2, 0.1, 0.3])
    answers = service().inverse(IkRequest(goals=[good] * 1000, method="direct"))
    assert [next(answers).verdict for _ in range(2)] == ["solved"] * 2
    places = service().forward(FkRequest(q_rad=[HOME] * 1000))
    assert next(places).tcp_m == next(places).tcp_m


def test_a_search_of_many_cubes_lets_its_caller_look_up_and_end_it() -> None:
    """Twenty-four starts of five cubes with 21 points each take seconds on a small board."""
    cubes, most = list[None](), 7
    far = IkRequest(goals=[GoalEntry(position_m=[0.9, -0.2, 0.1])], cube_points=21, cube_side_m=0.2)

    def looked_up() -> None:
        cubes.append(None)
        if len(cubes) == most:
            raise RequestError("expired", "the deadline has passed")

    with pytest.raises(RequestError, match="deadline"):
        next(service().inverse(far, check_cancelled=looked_up))
    assert len(cubes) == most


def test_a_model_of_another_arm_is_refused() -> None:
    lab = replace(config(), arm=replace(config().arm, name="lrm-lab"))
    with pytest.raises(LrmError, match="a model of lrm-rover; this daemon drives lrm-lab"):
        deploy(lab)


def test_answers_name_the_joints_outside_the_range_of_the_fit() -> None:
    """Before: a model fitted on a part of the range answered anywhere as if it had been measured there."""
    known = deploy(config())
    within = MeasuredRange(((-3.0, 3.0), (-0.2, 0.3), *((-3.0, 3.0),) * 4), (0.0, 0.1))
    ranged = IkService.of(config(), replace(known, model=replace(known.model, within=within)))
    near, far = [0.1, 0.2, 0.3, 0.1, 0.4, 0.1], [0.1, 0.6, 0.3, 0.1, 0.4, 0.1]
    places = list(ranged.forward(FkRequest(q_rad=[near, far])))
    assert [place.outside_range for place in places] == [[], [2]]
    goals = [GoalEntry(position_m=place.tcp_m) for place in places]
    for answer in ranged.inverse(IkRequest(goals=goals, near_rad=far)):
        assert answer.q_rad is not None
        assert answer.outside_range == ([] if -0.2 <= answer.q_rad[1] <= 0.3 else [2])
    assert [place.outside_range for place in service().forward(FkRequest(q_rad=[far]))] == [[]]


def forward_as_expected(of: IkService, request: FkRequest, expected: Equilibrium) -> list[FkAnswer]:
    found = list(of.forward(request))
    np.testing.assert_allclose([one.tcp_m for one in found], expected.true_tcp, atol=1e-9)
    np.testing.assert_allclose([one.tau_nm for one in found], expected.joint_torque, atol=1e-9)
    return found


def assert_inverse_reaches(of: IkService, model: Model, there: list[FkAnswer], near: list[float], load: float) -> None:
    goals = IkRequest(goals=[GoalEntry(position_m=one.tcp_m) for one in there], payload_kg=load, near_rad=near)
    solved = [answer for answer in of.inverse(goals) if answer.q_rad is not None]
    assert solved
    for answer in solved:
        reached = solve_equilibrium(model, poses_of(answer.q_rad, load, np.array([answer.direction])))
        np.testing.assert_allclose(reached.true_tcp[0], answer.tcp_m, atol=EXACT)


def test_a_known_direction_of_gravity_is_that_of_another_arm_file() -> None:
    """Forward and inverse kinematics on a slope; and back, the very same answers as before."""
    lean = math.radians(12.0)
    down = (math.sin(lean), 0.0, -math.cos(lean))
    tilted = service().under_gravity(down)
    q = np.random.default_rng(3).uniform(-1.0, 1.0, (6, 6)).tolist()
    request = FkRequest(q_rad=q, payload_kg=0.05)
    model = under_gravity(deploy(config()).model, down)
    expected = solve_equilibrium(model, poses_of(q, 0.05))
    found = forward_as_expected(tilted, request, expected)
    level = list(service().forward(request))
    assert np.linalg.norm(np.subtract([a.tcp_m for a in level], [b.tcp_m for b in found]), axis=1).max() > 2e-3
    assert_inverse_reaches(tilted, model, found, q[0], 0.05)
    assert [one.model_dump() for one in tilted.under_gravity(None).forward(request)] == [
        one.model_dump() for one in level
    ]


def test_the_centre_of_a_load_counts_in_forward_and_inverse_on_a_slope_too() -> None:
    """Told before or after gravity's direction; the centre of zero gives the very same answers as before."""
    centre, down = (0.03, -0.02, 0.06), (math.sin(0.1), 0.0, -math.cos(0.1))
    q = np.random.default_rng(3).uniform(-1.0, 1.0, (4, 6)).tolist()
    request = FkRequest(q_rad=q, payload_kg=0.1)
    model = with_load_at(under_gravity(deploy(config()).model, down), centre)
    expected = solve_equilibrium(model, poses_of(q, 0.1))
    for told in (
        service().under_gravity(down).with_load_at(centre),
        service().with_load_at(centre).under_gravity(down),
    ):
        found = forward_as_expected(told, request, expected)
    assert_inverse_reaches(told, model, found, q[0], 0.1)
    level = [one.model_dump() for one in service().forward(request)]
    moved = service().with_load_at(centre)
    assert [one.model_dump() for one in moved.with_load_at(ORIGIN).forward(request)] == level
    assert [one.model_dump() for one in moved.forward(request)] != level
