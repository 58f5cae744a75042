"""The inverse of a model with a residual field: the kernel computes it as Python does, answers reach their goals."""

from __future__ import annotations

import numpy as np
import pytest

from bench.calibrated_ik import DISTINCT, distinct
from lrm_ident.study.study import Study
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.effects.field.residual_field import BEYOND, ResidualField
from lrm_math.effects.measured_range import MeasuredRange
from lrm_math.ik.answer import Solved
from lrm_math.ik.calibrated import CalibratedSolver
from lrm_math.ik.calibrated_arm import IkSolutions
from lrm_math.ik.goal import CHAR_LENGTH, Goal, IkQuery
from lrm_math.ik.methods import Cube, Direct
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.model.covariance import Covariance, drawn_models
from lrm_math.model.deployed_model import field_of, named_part
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from tests.support.nameless_arm import measured

pytestmark = pytest.mark.long

LAB = load_arm("lrm-lab")
LOWER, UPPER = (np.array([getattr(joint, end) for joint in LAB.joints]) for end in ("lower", "upper"))
KNOWN = (
    "offsets", "compliance", "servo_gain@joint2", "backlash@joint3", "hysteresis@joint4", "coupling@joint5<-joint1",
)  # fmt: skip
UNKNOWN = (*KNOWN, "angle_curve@joint4")
"""With an effect that the kernel has no formula for."""


def with_field(names: tuple[str, ...], seed: int, size: float = 1.5e-3, share: float = 0.8) -> Model:
    """A model with a field of a hundred coefficients, which fades within the joints' limits."""
    rng = np.random.default_rng(seed)
    causes = model_of(LAB, [effect for name in names for effect in effects_at(LAB, name)])
    fixed = np.array([p.fixed is not None for p in causes.parameters])
    small = 0.3 * rng.uniform(0.0, 1.0, len(fixed)) * [p.typical for p in causes.parameters]
    field = ResidualField(LAB, "tool")
    p = np.zeros(len(field.parameters))
    chosen = [row for row, parameter in enumerate(field.parameters) if "beyond" not in parameter.name]
    p[rng.choice(chosen, 97, replace=False)] = rng.normal(0.0, size / np.sqrt(33.0), 97)
    ends = zip((share * LOWER).tolist(), (share * UPPER).tolist(), strict=True)
    values = np.concatenate([np.where(fixed, causes.values, small), p])
    return Model(LAB, (*causes.effects, field), values, (), MeasuredRange(tuple(ends), (0.0, 0.0)))


def commands(seed: int, count: int, share: float = 1.0) -> Array:
    return np.random.default_rng(seed).uniform(share * LOWER, share * UPPER, (count, LAB.dof))


@pytest.mark.parametrize("names", [("compliance",), KNOWN])
def test_the_kernel_settles_where_python_does(names: tuple[str, ...]) -> None:
    model = with_field(names, 1)
    solver, poses = CalibratedSolver.of(model), poses_of(commands(2, 100))
    assert solver.arm.complete
    side = np.random.default_rng(3).integers(-1, 2, poses.q.shape).astype(float)
    kernel = solver.arm.equilibria(0.0, poses.q, side, tolerance=1e-12)
    ours = solve_equilibrium(model, Poses(poses.q, poses.payload, side), tolerance=1e-12)
    np.testing.assert_allclose(kernel.tcp[:, 9:], ours.tcp[kernel.rows], atol=1e-10)
    moved = solve_equilibrium(named_part(model), poses).tcp - solve_equilibrium(model, poses).tcp
    assert np.linalg.norm(moved, axis=1).max() > 1e-3, "a field worth the name"


@pytest.mark.parametrize("method", [Direct(), Cube()], ids=lambda method: method.name)
@pytest.mark.parametrize("names", [("compliance",), KNOWN, UNKNOWN], ids=["plain", "laws", "law in Python"])
def test_answers_reach_their_goals(names: tuple[str, ...], method: Direct | Cube) -> None:
    """Within and beyond the field's range; each branch settles at the goal, coming from where the arm was."""
    model = with_field(names, 4)
    assert CalibratedSolver.of(model).arm.complete == (names != UNKNOWN)
    answers_reach_goals(model, commands(5, 12, 0.95), commands(8, 1, 0.5)[0], method)


def answers_reach_goals(model: Model, goals: Array, begin: Array, method: Direct | Cube) -> None:
    """Asserts that each branch of an answer settles at its goal; goals are those of commands (N, n), rad."""
    solver, here, solved = CalibratedSolver.of(model), tuple(begin.tolist()), 0
    for q in goals.tolist():
        there = solver.forward(q, near=here)
        found = method.find(solver.arm, IkQuery(Goal(there.tcp, there.rotation), 0.0, here))
        assert isinstance(found, IkSolutions)
        solved += bool(found.within)
        for branch in found.within:
            side = np.array([branch.direction], dtype=float)
            equilibrium = solve_equilibrium(model, Poses(np.array([branch.q]), np.zeros(1), side), tolerance=1e-12)
            assert np.linalg.norm(equilibrium.tcp[0] - there.tcp) < 2e-9
    assert solved == len(goals)


def test_no_branch_is_lost() -> None:
    """Wherever the arm without the field has a branch well within the limits, that with it has one beside it."""
    model = with_field(("compliance",), 6)
    plain, field = CalibratedSolver.of(named_part(model)), CalibratedSolver.of(model)
    for q in commands(7, 30, 0.9).tolist():
        there = plain.forward(q)
        goal = Goal(there.tcp, there.rotation)
        before, after = (getattr(solver.solve(goal, method=Direct()), "branches", ()) for solver in (plain, field))
        for branch in before:
            if branch.margin > 0.2 and _slowest(plain, branch.q) > 0.03:
                assert min(np.abs(np.subtract(branch.q, other.q)).max() for other in after) < 0.2


def beside_many_starts(model: Model, seed: int, count: int) -> tuple[int, int]:
    """How many branches of goals Newton's method from the 200 closest poses of the library finds; and the direct method
    not."""
    solver, known, lacking = CalibratedSolver.of(model), 0, 0
    arm, library = solver.arm, solver.arm.library
    for q in commands(seed, count).tolist():
        there = solver.forward(q)
        query = IkQuery(Goal(there.tcp, there.rotation))
        far = np.linalg.norm(library.tcp[:, :3, 3] - there.tcp, axis=1)
        far += CHAR_LENGTH * np.linalg.norm(library.tcp[:, :3, :3] - np.array(there.rotation), axis=(1, 2))
        reached = [c for row in np.argsort(far)[:200] for c in arm.at_goal(query, library.slots[row])]
        every = distinct([np.array(c.q) for c in reached if c.margin > 0.0])
        found = Direct().find(arm, query)
        rows = np.array([c.q for c in found.within])
        known, lacking = known + len(every), lacking + sum(np.abs(rows - q).max(axis=1).min() > DISTINCT for q in every)
    return known, lacking


def test_all_branches_with_a_field_that_was_learned() -> None:
    model = Study.of(measured(1, 3e-3)).fit("option1").add_field().model
    assert beside_many_starts(model, 50, 25)[1] == 0


@pytest.mark.parametrize("names", [("compliance",), KNOWN], ids=["plain", "laws"])
def test_nearly_all_branches_with_rough_fields(names: tuple[str, ...]) -> None:
    """Fields of millimetres at the shortest waves fade within the limits: such a field folds the workspace anew."""
    counts = np.array([beside_many_starts(with_field(names, seed), seed + 50, 30) for seed in range(4)])
    known, lacking = counts.sum(axis=0)
    assert known > 150
    assert lacking <= 0.015 * known


def _slowest(solver: CalibratedSolver, q: tuple[float, ...]) -> float:
    """m/rad, by finite differences: how slowly some joint motion moves the tool, turns weighed by 0.1 m."""
    h, columns = 1e-5, []
    for joint in range(len(q)):
        up, down = (
            solver.forward([angle + (s * h if k == joint else 0.0) for k, angle in enumerate(q)]) for s in (1, -1)
        )
        turn = (np.array(up.rotation) - np.array(down.rotation)).ravel() / np.sqrt(2.0)
        columns.append(np.concatenate([np.subtract(up.tcp, down.tcp), 0.1 * turn]) / (2.0 * h))
    return float(np.linalg.svd(np.array(columns).T, compute_uv=False)[-1])


def learned(seed: int) -> tuple[Model, Covariance]:
    """A model with a field, and a random covariance of its coefficients, of its springs and of what is beyond."""
    model, rng = with_field(("compliance",), seed), np.random.default_rng(seed)
    field = model.effects[-1]
    springs = [key for key in model.keys if key.startswith("compliance")]
    kept = [key for key in field.keys if model.value(key)]
    beyond = [key for key, parameter in zip(field.keys, field.parameters, strict=True) if parameter.name in BEYOND]
    A = rng.normal(0.0, 1.0, (len(springs) + len(kept), 200)) / np.sqrt(200.0)
    size = np.array([*[2e-3] * len(springs), *[1e-4] * len(kept)])
    matrix = np.zeros((len(size) + 3, len(size) + 3))
    matrix[:-3, :-3] = A @ A.T * np.outer(size, size)
    matrix[-3:, -3:] = 4e-6 * np.eye(3)
    return model, Covariance((*springs, *kept, *beyond), matrix)


@pytest.mark.parametrize("share", [0.7, 1.0], ids=["within its range", "beyond it too"])
def test_the_uncertainty_of_an_answer_is_that_of_drawn_models(share: float) -> None:
    """Monte Carlo: models drawn from the covariance, at the answered commands."""
    model, covariance = learned(9)
    solver = CalibratedSolver.of(model, covariance=covariance)
    alone = CalibratedSolver.of(model, covariance=covariance.marginal(model, named_part(model)))
    drawn = drawn_models(model, covariance, 400, np.random.default_rng(1))
    for q in commands(10, 3, share).tolist():
        there = solver.forward(q)
        goal = Goal(there.tcp, there.rotation)
        answer, less = solver.solve(goal), alone.solve(goal)
        assert isinstance(answer, Solved)
        assert isinstance(less, Solved)
        at = poses_of([answer.q])
        tips = np.array([solve_equilibrium(one, at).tcp[0] for one in drawn])
        assert answer.sd == pytest.approx(np.sqrt(np.trace(np.cov(tips.T))), rel=0.1)
        assert answer.sd > 1.05 * less.sd, "springs alone are surer than springs and a field"


def test_the_uncertainty_of_an_answer_has_the_variance_of_the_field_there() -> None:
    """Nothing else is uncertain: it is the root of F C Fᵀ by the functions of the regression."""
    model, covariance = learned(11)
    field = field_of(model)
    own = covariance.marginal(model, model_of(LAB, [field]))
    solver, functions = CalibratedSolver.of(model, covariance=own), field.over(model.within)
    for q in commands(12, 5).tolist():
        there = solver.forward(q)
        answer = solver.solve(Goal(there.tcp, there.rotation))
        assert isinstance(answer, Solved)
        basis = dict(zip(field.keys, functions.basis(poses_of([answer.q]), ()), strict=True))
        F = np.array([[float(np.squeeze(amount)) for amount in basis[key]] for key in own.keys])
        assert answer.sd == pytest.approx(np.sqrt(np.trace(F.T @ own.matrix @ F)), rel=1e-6)
