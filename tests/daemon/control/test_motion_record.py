"""Record of the arm's moves: `rpc/fk` and `lrm-ident predict` agree, over whatever it went through."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from lrm_ident.data.measurement_file.load import load_poses
from lrm_ident.study.api import predict
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.effects.measured_range import MeasuredRange
from lrm_math.effects.reversion import Reversion
from lrm_math.kinematics.known import Known
from lrm_math.kinematics.motion import TRAVELS_DEG, Motion, recorded
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.deployed_model import as_deployed
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from lrm_math.model.session_state import StateAfterSession
from lrmd.config import SECOND, Config, load_config
from lrmd.control.state_machine import Mode
from lrmd.ik.deployed_model import DeployedModel
from lrmd.ik.planner import NoPlan
from lrmd.ik.service import IkService
from lrmd.ik.straight_line import TOLERANCE
from lrmd.messages.kinematics import FkRequest, GoalEntry, IkRequest, PlanRequest
from lrmd.ramp.shared_memory import FRICTION_ELEMENTS
from tests.support.daemon.armed_daemon import ArmedDaemon
from tests.support.daemon.in_memory_daemon import CONFIG
from tests.support.sweep import examples

AGREE = 1e-9
"""m."""
ANGLES = st.one_of(st.sampled_from([0.0, 0.02, -0.05]), st.floats(-0.12, 0.12))
ORDERS = st.lists(st.lists(ANGLES, min_size=6, max_size=6), min_size=2, max_size=4)


@lru_cache
def config() -> Config:
    return replace(load_config(CONFIG), stagger=20_000_000, step=20_000)


def model(seed: int) -> Model:
    """A random model with friction and play in several joints, compliance, and an error of some joint's angle.

    Of every second one the friction ends above an angle of some joint.
    """
    rng, arm = np.random.default_rng(seed), config().arm
    joints = [f"joint{j}" for j in range(1, arm.dof + 1)]
    chosen = {f"friction_curve@{j}" for j in rng.choice(joints, 3)} | {f"hysteresis@{j}" for j in rng.choice(joints, 3)}
    chosen |= {f"{rng.choice(['backlash', 'eccentricity', 'servo_gain', 'torque_curve'])}@{rng.choice(joints)}"}
    effects = [e for name in ("offsets", "compliance", *sorted(chosen)) for e in effects_at(arm, name)]
    sizes = {k: 0.5 * rng.normal() * p.typical for e in effects for k, p in zip(e.keys, e.parameters, strict=True)}
    bounded = {k: abs(v) for k, v in sizes.items() if k.startswith(("compliance", "backlash"))}
    of = model_of(arm, effects, sizes | bounded)
    return replace(of, within=ending(of, int(rng.integers(arm.dof)))) if seed % 2 else of


def ending(of: Model, joint: int) -> MeasuredRange:
    """A range beyond which a model goes back to one without its friction."""
    terms = tuple(effect.name for effect in of.effects if effect.id == "friction_curve")
    ends = tuple((-math.inf, 0.01 if j == joint else math.inf) for j in range(of.arm.dof))
    changes = {key: -of.value(key) for key in of.keys if key.startswith("friction_curve")}
    reversion = Reversion(terms, ends, changes | {"offsets.joint2.theta_rad": 0.01})
    return MeasuredRange(((-0.1, 0.1),) * of.arm.dof, (0.0, 0.1), reversion=reversion)


def service(of: Model) -> IkService:
    return IkService.of(config(), DeployedModel(of, None, "", "", ()))


def tip(of: IkService, q: list[float], known: Known, **more: object) -> list[float]:
    (place,) = of.forward(FkRequest(q_rad=[q], **more), known)  # type: ignore[arg-type]
    return place.tcp_m


def in_order(of: Model, q: Array, folder: Path) -> Array:
    """(N, 3), TCP (m) of `lrm-ident predict` for a file of poses in order."""
    path, n = folder / "order.csv", q.shape[1]
    rows = [",".join([str(k), *(f"{angle:.17g}" for angle in np.degrees(row))]) for k, row in enumerate(q, start=1)]
    path.write_text("\n".join([",".join(["pose", *(f"q{j}_deg" for j in range(1, n + 1))]), *rows]) + "\n")
    return predict(of, load_poses(path, of.arm))


@pytest.mark.long
@given(seed=st.integers(0, 2**31), orders=ORDERS)
@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_rpc_fk_and_predict_agree_wherever_the_arm_went(seed: int, orders: list[list[float]], tmp_path: Path) -> None:
    of, arm = model(seed), ArmedDaemon(config())
    arm.arm("given", orders[0])
    ik, q, tips = service(of), [arm.q], [tip(service(of), arm.q, arm.known)]
    for goal in orders[1:]:
        asked = tip(ik, goal, arm.known)  # before the move, for what will be
        arm.go(goal)
        q.append(arm.q)
        tips.append(tip(ik, arm.q, arm.known))
        np.testing.assert_allclose(asked, tips[-1], rtol=0.0, atol=2e-6)  # a pulse has whole ns
    np.testing.assert_allclose(tips, in_order(of, np.array(q), tmp_path), rtol=0.0, atol=AGREE)


@pytest.mark.long
@given(seed=st.integers(0, 2**31), orders=ORDERS)
@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_stated_directions_and_start_are_those_of_a_file(seed: int, orders: list[list[float]], tmp_path: Path) -> None:
    of, n = model(seed), 6
    q, side = np.array(orders), np.sign(np.random.default_rng(seed).uniform(-1, 1, (len(orders), n)))
    names = [*(f"q{j}_deg" for j in range(1, n + 1)), *(f"approach{j}" for j in range(1, n + 1))]
    rows = [",".join(f"{x:.17g}" for x in [*np.degrees(a), *s]) for a, s in zip(q, side, strict=True)]
    (tmp_path / "sides.csv").write_text("\n".join([",".join(names), *rows]) + "\n")
    poses = load_poses(tmp_path / "sides.csv", of.arm)
    request = FkRequest(q_rad=q.tolist(), direction=side.astype(int).tolist())
    tips = [place.tcp_m for place in service(of).forward(request)]
    np.testing.assert_allclose(tips, predict(of, replace(poses, friction=None)), rtol=0.0, atol=AGREE)


def warming(seed: int) -> Model:
    """A random model one or two of whose joints warm up by a law that the daemon follows."""
    of, rng = model(seed), np.random.default_rng(seed)
    joints = rng.choice([f"joint{j}" for j in range(1, of.arm.dof + 1)], 2, replace=False)
    sizes = {f"drift.{joint}.A_rad": 0.05 * rng.normal() for joint in joints}
    effects = [*of.effects, *(e for joint in joints for e in effects_at(of.arm, f"drift@{joint}"))]
    parts = {f"drift@{joint}": 0.01 * rng.normal() for joint in joints[: 1 + seed % 2]}
    kept = {f"offsets.{name.partition('@')[2]}.theta_rad": part + 0.002 for name, part in parts.items()}
    whole = model_of(of.arm, effects, dict(zip(of.keys, of.values, strict=True)) | sizes)
    return whole.with_state(StateAfterSession(dict.fromkeys((f"drift@{j}" for j in joints), "last"), kept, parts))


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:the file of these poses")
@given(seed=st.integers(0, 2**31), running=st.floats(0.0, 2e4), goal=st.lists(ANGLES, min_size=6, max_size=6))
@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_fk_and_predict_agree_since_power_on(seed: int, running: float, goal: list[float], tmp_path: Path) -> None:
    """A file whose poses have that time, and the daemon that kept it; and `rpc/ik` reaches what `rpc/fk` predicts."""
    of = warming(seed)
    ik = IkService.of(config(), DeployedModel(of, None, "", "", ("drift",)))
    rows = [",".join(f"{x:.17g}" for x in [running, *np.degrees(goal)])]
    (tmp_path / "warm.csv").write_text(
        "\n".join([",".join(["t_s", *(f"q{j}_deg" for j in range(1, 7))]), *rows]) + "\n"
    )
    poses = replace(load_poses(tmp_path / "warm.csv", of.arm), direction=np.ones((1, 6)), friction=None)
    (told,) = predict(replace(of, fitted_to="another file"), poses)
    known = Known(running=running, warmed=0.0)
    np.testing.assert_allclose(tip(ik, goal, known, direction=[[1] * 6]), told, rtol=0.0, atol=AGREE)
    (answer,) = ik.inverse(IkRequest(goals=[GoalEntry(position_m=told.tolist())]), known)
    if answer.q_rad is not None and not answer.detours:
        (place,) = ik.forward(FkRequest(q_rad=[answer.q_rad], direction=[answer.direction]), known)
        np.testing.assert_allclose(place.tcp_m, told, rtol=0.0, atol=1e-6)


def test_without_a_known_time_the_state_that_is_kept_counts() -> None:
    """Before the joints have pulses, and where poses have no times."""
    of, goal = warming(5), [0.05] * 6
    ik = IkService.of(config(), DeployedModel(of, None, "", "", ("drift",)))
    assert ik.deployed.uncompensated == (), "both drifts follow the time"
    (kept,) = solve_equilibrium(as_deployed(of), poses_of([goal], direction=np.ones((1, 6)))).tcp
    np.testing.assert_allclose(tip(ik, goal, Known(), direction=[[1] * 6]), kept, rtol=0.0, atol=AGREE)
    assert np.linalg.norm(np.subtract(tip(ik, goal, Known(running=0.0), direction=[[1] * 6]), kept)) > 1e-5


def cold_joint(config: Config) -> tuple[Model, IkService]:
    """Joint 2 warms up, from cold, by 0.05 rad with a time constant of 20 s; else the arm is as drawn."""
    effects = [e for name in ("offsets", "compliance", "drift@joint2") for e in effects_at(config.arm, name)]
    law = {"drift.joint2.A_rad": 0.05, "drift.joint2.T_s": 20.0}
    state = StateAfterSession({"drift@joint2": "last"}, {}, {"drift@joint2": 0.0})
    of = model_of(config.arm, effects, law).with_state(state)
    return of, IkService.of(config, DeployedModel(of, None, "", "sha", ("drift",)))


def test_rpc_ik_and_a_plan_reach_the_goal_with_the_warm_up_at_arrival() -> None:
    """Not as the arm is when the answer is given: a long way takes seconds, in which a cold joint warms up."""
    slow, start, running = load_config(CONFIG), np.zeros(6), 4.0
    of, ik = cold_joint(slow)
    known = Known(Motion.at(start), running, 30.0, 0.0)
    (there,) = ik.forward(FkRequest(q_rad=[[0.6, 0.4, 0.3, 0.2, -0.3, 0.1]]), known)
    goal = GoalEntry(position_m=there.tcp_m)
    (answer,) = ik.inverse(IkRequest(goals=[goal]), known)
    path = ik.plan(PlanRequest(from_rad=start.tolist(), goal=goal), lambda: None, known)
    assert answer.q_rad is not None
    assert not isinstance(path, NoPlan)
    for q in (answer.q_rad, path[-1]):
        pulses = [abs(s.pulse_ns(x) - s.pulse_ns(0.0)) for s, x in zip(slow.servos, q, strict=False)]
        seconds = math.ceil(max(pulses) / slow.step) * slow.tick / SECOND
        assert seconds > 1.0
        drift, now = (0.05 * -np.expm1(-time / 20.0) for time in (running + seconds, running))
        turned = np.array([q]) + np.eye(6)[1] * np.array([[drift], [now]])
        tips = solve_equilibrium(model_of(of.arm, of.effects), poses_of(turned)).true_tcp
        reached, at_once = np.linalg.norm(tips - there.tcp_m, axis=1)
        assert reached < 2e-6
        assert at_once > 1e-4


def test_a_straight_line_has_the_warm_up_of_each_waypoint_at_its_arrival() -> None:
    """A cold joint turns by more than a line's tolerance while the tip goes 80 mm: the line stays straight in it."""
    config, start, running = load_config(CONFIG), np.array([0.2, 0.5, 0.4, 0.9, -0.3, 0.4]), 4.0
    of, ik = cold_joint(config)
    known = Known(Motion.at(start), running, 30.0, 0.0)
    (here,) = ik.forward(FkRequest(q_rad=[start.tolist()]), known)
    goal = np.array(here.tcp_m) + np.array([0.0, -0.08, 0.0])
    request = PlanRequest(from_rad=start.tolist(), goal=GoalEntry(position_m=goal.tolist()), line=True)
    path = ik.plan(request, lambda: None, known)
    assert not isinstance(path, NoPlan)
    pulses = np.array([[s.pulse_ns(x) for s, x in zip(config.servos, q, strict=False)] for q in path])
    ticks = np.ceil(np.abs(np.diff(pulses, axis=0)).max(axis=1) / config.step)
    elapsed = np.concatenate([[0.0], np.cumsum(ticks)]) * config.tick / SECOND
    drift = 0.05 * -np.expm1((running + elapsed) / -20.0)
    assert (drift[-1] - drift[0]) * 0.3 > TOLERANCE
    tips = solve_equilibrium(
        model_of(of.arm, of.effects), poses_of(np.array(path) + drift[:, None] * np.eye(6)[1])
    ).true_tcp
    assert np.abs((tips - here.tcp_m)[:, [0, 2]]).max() < TOLERANCE
    assert np.linalg.norm(tips[-1] - goal) < 2e-5


@pytest.mark.long
@given(seed=st.integers(0, 2**31), ends=st.lists(st.lists(ANGLES, min_size=6, max_size=6), min_size=3, max_size=3))
@examples(6, 12)
def test_rpc_ik_comes_from_where_the_arm_stands(seed: int, ends: list[list[float]]) -> None:
    """Its commands reach the goal with the friction that the move there leaves: as `rpc/fk` has it."""
    ik, start = service(model(seed)), Motion.at(ends[0]).to(np.array(ends[1]))
    known = Known(start)
    goal = tip(ik, [angle + 0.05 for angle in ends[2]], known)
    (answer,) = ik.inverse(IkRequest(goals=[GoalEntry(position_m=goal)]), known)
    if answer.q_rad is None:  # on the way it would turn: the goal lies in a gap between both sides
        assert answer.verdict in ("not_converged", "collision")
        return
    (place,) = ik.forward(FkRequest(q_rad=[answer.q_rad]), known)
    if not answer.detours:
        np.testing.assert_allclose(place.tcp_m, goal, rtol=0.0, atol=1e-6)
        assert place.direction == answer.direction


def test_a_turn_on_the_way_counts(tmp_path: Path) -> None:
    """The arm is sent back before it arrives: friction has turned over from where it turned round."""
    of, arm = model(3), ArmedDaemon(config())
    arm.arm("given", [0.0] * 6)
    arm.start([0.8] * 6)
    arm.keep(5)
    arm.start([-0.05] * 6)
    corner = list(arm.q)
    for _ in range(4000):
        arm.keep(1)
        corner = [max(a, b) for a, b in zip(corner, arm.core.angles(arm.report.position)[:6], strict=True)]
        if arm.core.mode is Mode.ARMED:
            break
    assert 0.1 < corner[1] < 0.79
    went = np.array([[0.0] * 6, corner, arm.q])
    here = tip(service(of), arm.q, arm.known)
    np.testing.assert_allclose(here, in_order(of, went, tmp_path)[-1], rtol=0.0, atol=AGREE)


@pytest.mark.parametrize("silence", [False, True])
def test_what_is_known_survives_a_kill(silence: bool) -> None:
    arm = ArmedDaemon(config())
    arm.arm("given", [0.0] * 6)
    arm.go([0.1, -0.1, 0.05, 0.0, 0.1, 0.1], [0.06, -0.1, 0.08, 0.0, 0.05, 0.1])
    before = arm.known
    assert before.running is not None
    assert before.motion.side.tolist() == [-1, -1, 1, 0, -1, 1]
    after = arm.killed(silence)
    assert after.known.motion is None, "not before it has pulses: somebody may move it"
    after.arm("stored" if silence else "board")
    known = after.known
    np.testing.assert_array_equal(known.motion.side, before.motion.side)
    np.testing.assert_allclose(known.motion.friction, before.motion.friction, atol=1e-12)
    began_anew = known.running < before.running
    assert began_anew is silence, "the time with pulses goes on where they do"


def test_of_a_pose_that_is_given_nothing_is_known() -> None:
    """The arm is where somebody says, as after a fall, and came there from nobody knows where."""
    arm = ArmedDaemon(config())
    arm.arm("given", [0.0] * 6)
    arm.go([0.1] * 6)
    arm.disarm()
    assert arm.known.motion is None
    arm.arm("given", arm.q)
    motion = arm.known.motion
    assert not motion.side.any()
    assert not motion.friction.any()
    (place,) = service(model(1)).forward(FkRequest(q_rad=[arm.q]), arm.known)
    assert place.direction == [0] * 6
    arm.go([0.12, *arm.q[1:]])
    assert arm.known.motion.side.tolist() == [1, 0, 0, 0, 0, 0]


@given(st.lists(st.integers(-1000, 1000), min_size=2, max_size=8), st.integers(0, 2**31))
def test_a_move_in_parts_leaves_the_traces_of_the_whole(ends: list[int], seed: int) -> None:
    """Property of Dahl's elements: so it does not matter how often the daemon looks at a move (of whole mrad)."""
    rng = np.random.default_rng(seed)
    whole = parts = Motion.at([0.0])
    for end in np.array(ends) * 1e-3:
        cuts = np.sort(rng.uniform(0.0, 1.0, 3))
        for cut in [*cuts, 1.0]:
            parts = parts.to(whole.q + cut * (np.array([end]) - whole.q))
        whole = whole.to(np.array([end]))
        np.testing.assert_allclose(parts.friction, whole.friction, atol=1e-12)
        np.testing.assert_array_equal(parts.side, whole.side)


def test_drift_is_evaluated_at_the_time_with_pulses() -> None:
    """Time and warmth that the daemon knows are those that an effect `drift` takes from a file."""
    effects = [e for name in ("offsets", "drift@joint4") for e in effects_at(config().arm, name)]
    drifting = model_of(config().arm, effects, {"drift.joint4.A_rad": 0.05, "drift.joint4.c_rad_per_K": 0.001})
    turned = 0.05 * (1.0 - np.exp(-1.0)) + 0.001 * 10.0
    same = drifting.with_values_of(["offsets.joint4.theta_rad"], [turned])
    for known, of in ((Known(None, 1800.0, 35.0, 10.0), same), (Known(), model_of(config().arm, effects[:6]))):
        at = Motion.at([0.1] * 6)
        here, there = solve_equilibrium(drifting, known.poses(at)), solve_equilibrium(of, Known().poses(at))
        np.testing.assert_allclose(here.tcp, there.tcp, atol=1e-12)


def test_the_shared_memory_has_room_for_every_element_of_friction() -> None:
    assert len(TRAVELS_DEG) == FRICTION_ELEMENTS
    assert recorded(np.zeros((0, 6)), None)[1].shape == (0, 6, FRICTION_ELEMENTS)
