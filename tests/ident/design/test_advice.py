"""Advice is tried: what the poses proposed tell of two causes, the power of tests, and that nothing tells twins."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from lrm_ident.design.advice import Advice, MeasuringPlan, advise, advise_beside, next_poses
from lrm_ident.design.detmax import _climb, maximise_criterion
from lrm_ident.design.discrimination import TARGET_POWER, TEST_LEVEL, discrimination_of
from lrm_ident.design.expected_lead import (
    NEEDED,
    TRIALS,
    CandidateCause,
    as_measured,
    cause_columns,
    expected,
    told_in_trials,
)
from lrm_ident.design.observability import MM_PER_M, identification_jacobian
from lrm_ident.design.optimality import criterion_of
from lrm_ident.design.pose_design import CandidateSet, DesignProblem, PoseDesign
from lrm_ident.fitting.parameter_sets import fittable
from lrm_ident.report.text.advice import advice_sentence, hopeless_words
from lrm_ident.residual.thresholds import EQUIVALENCE_COSINE
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects import Effect, effects_at
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from tests.support.commands import stdout_of
from tests.support.random_arms import random_arm

NOISE = 3e-4


@pytest.fixture(scope="module")
def arm() -> Arm:
    return random_arm(3, 3)


def base(arm: Arm) -> Model:
    model = model_of(arm, (*effects_at(arm, "offsets"), *effects_at(arm, "compliance")))
    return model.with_free(fittable(model))


def causes(model: Model, *names: str) -> list[CandidateCause]:
    return [CandidateCause.typical(effect, model.free) for name in names for effect in effects_at(model.arm, name)]


def at_levels(arm: Arm, *levels: float) -> Poses:
    q = np.random.default_rng(0).choice(levels, (60, arm.dof))
    return as_measured(Poses(q, np.zeros(len(q))), None)


def test_poses_at_any_angle_tell_what_two_levels_do_not(arm: Arm) -> None:
    """At two levels a gain is an offset; the plan's poses were tried, and no more load was needed."""
    model, measured = base(arm), at_levels(arm, -1.0, 1.0)
    both = causes(model, "servo_gain@joint2", "coupling@joint2<-joint1")
    now = expected(model, both, [measured], NOISE)
    assert min(pair.lead for pair in now) < NEEDED
    advice = advise(model, both, measured, NOISE, most=40)
    assert advice.works
    assert "distinguish them" in advice_sentence(advice)
    then = expected(model, both, [measured, advice.plan.poses], NOISE)
    assert [pair.lead for pair in then] == [pair.lead for pair in advice.pairs]
    assert min(pair.lead for pair in then) >= NEEDED


def test_what_no_pose_tells_is_said_with_the_reason(arm: Arm) -> None:
    """Without feedback a servo that yields and a joint that does are one motion."""
    model = model_of(arm, effects_at(arm, "offsets"))
    model = model.with_free(fittable(model))
    twins = causes(model, "servo_droop@joint2", "compliance@joint2")
    advice = advise(model, twins, None, NOISE, most=40)
    assert not advice.works
    assert not advice.helps
    (worst, *_) = advice.alike
    assert {worst.there, worst.instead} == {"servo_droop@joint2", "compliance@joint2"}
    assert worst.cosine > EQUIVALENCE_COSINE
    words = f"No poses tried can distinguish {worst.there} from {worst.instead}"
    assert hopeless_words(advice) == words
    assert advice_sentence(advice).startswith(f"{words}: they move the tip alike (cosine 1.00), with ")


def test_an_effect_of_the_model_is_told_from_what_fitted_as_well(arm: Arm) -> None:
    """Where two joints always moved together, a gain of one is a coupling to the other, as large."""
    poses, coupling = at_levels(arm, -1.0, -0.5, 0.0, 0.6, 1.1), effects_at(arm, "coupling@joint2<-joint1")[0]
    measured = replace(poses, q=poses.q[:, [1, 1, 2]])
    model, gain = having(arm, "servo_gain@joint2", 0.02)
    advice = advise_beside(model, gain, [coupling], measured, NOISE)
    assert advice.works
    assert {pair.there for pair in advice.pairs} == {gain.name, coupling.name}
    model, droop = having(arm, "servo_droop@joint2", 1e-3)
    spring = effects_at(arm, "compliance@joint2")[0]
    assert not advise_beside(model.with_free({*model.free} - {*spring.keys}), droop, [spring], measured, NOISE).helps


def having(arm: Arm, name: str, size: float) -> tuple[Model, Effect]:
    """A model with an effect, each of its parameters as large (SI) and free."""
    effect, model = effects_at(arm, name)[0], base(arm)
    values = {key: model.value(key) for key in model.keys} | dict.fromkeys(effect.keys, size)
    return model_of(arm, (*model.effects, effect), values).with_free((*model.free, *effect.keys)), effect


def test_formulas_that_one_free_form_refines_are_told_only_if_one_is_exact(arm: Arm) -> None:
    """A joint that hardens otherwise than the cube of its torque has a torque curve: neither formula leads then."""
    model, loaded = base(arm), at_any_angle(arm, 2.0)
    both = causes(model, "backlash@joint2", "nonlinear_stiffness@joint2", "servo_gain@joint2")
    form, *others = expected(model, both, [loaded], NOISE)
    assert (form.there, form.instead) == ("backlash@joint2", "nonlinear_stiffness@joint2")
    assert form.distinguishable_if_exact
    assert not form.distinguishable
    assert all(pair.distinguishable for pair in others if "servo_gain@joint2" in (pair.there, pair.instead))
    advice = Advice(MeasuringPlan(loaded, (0.0, 2.0), 0.0), (form,))
    condition = ", if the formula of backlash@joint2 or nonlinear_stiffness@joint2 is exact"
    assert f"distinguish them{condition}: " in advice_sentence(advice)


def at_any_angle(arm: Arm, kilograms: float) -> Poses:
    """60 random poses without a load and with one."""
    q = np.random.default_rng(1).uniform(-1.5, 1.5, (60, arm.dof))
    return as_measured(Poses(np.tile(q, (2, 1)), np.repeat([0.0, kilograms], len(q))), None)


def test_design_says_that_formulas_must_be_exact() -> None:
    rivals = "backlash@joint2,nonlinear_stiffness@joint2"
    anyhow = ("--levels", "any", "--loads-g", "0,1000", "-n", 30, "--all")
    said = " ".join(stdout_of("design", "lrm-lab", "--separate", rivals, *anyhow).split())
    assert f"will distinguish {' from '.join(rivals.split(','))}, if the formula of" in said


def test_the_expected_lead_is_that_of_simulated_measurements(arm: Arm) -> None:
    """Mean over noise of the paired z of squared residuals, each model refitted linearly: within a fifth."""
    model, poses = base(arm), at_levels(arm, -1.0, -0.5, 0.0, 0.6, 1.1)
    there, instead = causes(model, "servo_gain@joint2", "coupling@joint2<-joint1")
    there = replace(there, size=0.5 * there.size)
    lead = expected(model, [there, instead], [poses], NOISE)[0].lead
    assert 2.0 < lead < 20.0
    squares = _squares(model, poses, there, instead)
    z = [float(d.mean() / d.std(ddof=1) * np.sqrt(len(d))) for d in squares]
    assert np.mean(z) == pytest.approx(lead, rel=0.2)


def _squares(model: Model, poses: Poses, there: CandidateCause, instead: CandidateCause) -> list[Array]:
    """Differences of squared residuals per pose of measurements with `there`, fitted with either cause."""
    own, other = cause_columns(model, [there, instead], [poses], NOISE).columns
    settled = solve_equilibrium(model, poses)
    fitted = identification_jacobian(settled, model.free).reshape(-1, len(model.free)) / MM_PER_M
    rng, out = np.random.default_rng(1), []
    for _ in range(60):
        seen = own[0] @ there.size + rng.normal(0.0, NOISE, len(fitted))
        left = []
        for columns in (other[0], own[0]):
            A = np.concatenate([fitted, columns], axis=1)
            residual = seen - A @ np.linalg.lstsq(A, seen, rcond=1e-9)[0]
            left.append((residual.reshape(-1, 3) ** 2).sum(axis=1))
        out.append(left[0] - left[1])
    return out


def test_poses_as_if_measured_have_an_order_and_times(arm: Arm) -> None:
    first = at_levels(arm, -1.0, 1.0)
    then = as_measured(Poses(first.q, first.payload), first)
    assert then.number[0] == first.number[-1] + 1
    assert then.t[0] > first.t[-1]
    assert then.history is not None
    solve_equilibrium(model_of(arm, effects_at(arm, "creep@joint2")), then)


@pytest.fixture(scope="module")
def waiting(arm: Arm) -> PoseDesign:
    return of_memory(arm, "creep@joint2", "compliance@joint2")


def of_memory(arm: Arm, *names: str) -> PoseDesign:
    """The design that distinguishes effects among random poses of two loads."""
    q = np.random.default_rng(1).uniform(-1.5, 1.5, (60, arm.dof))
    offer = CandidateSet(Poses(np.tile(q, (2, 1)), np.repeat([0.0, 2.0], len(q))), "random", {})
    rivals = tuple(effect for name in names for effect in effects_at(arm, name))
    problem = DesignProblem(base(arm), None, rivals, 30, "O1", NOISE, None, 2, 1, 0)
    return next_poses(problem, offer)


@pytest.mark.long
def test_effects_with_a_memory_get_dwell_times_that_tell_them(waiting: PoseDesign) -> None:
    """What the model fits already is told from what it lacks; half of the poses are held, in no order."""
    assert waiting.distinguishable
    assert not {"compliance.joint2.c_rad_per_Nm"} & {*waiting.keys}
    held = np.count_nonzero(waiting.hold)
    assert held in (0, len(waiting.hold) // 2)
    assert set(waiting.trials) == {("creep@joint2", "compliance@joint2"), ("compliance@joint2", "creep@joint2")}
    assert min(waiting.trials.values()) >= 0.9 * TRIALS


@pytest.mark.long
def test_holding_tells_more_of_slow_creep(arm: Arm, waiting: PoseDesign) -> None:
    """The same poses: the longer half of them is held, the surer is the time constant at which it is least sure."""
    model = base(arm).with_free(waiting.keys)
    both = causes(model, "creep@joint2", "compliance@joint2")
    leads = []
    for seconds in (0.0, 120.0, 480.0):
        hold = np.where(np.arange(len(waiting.poses)) % 2 == 1, seconds, 0.0)
        leads.append(min(pair.lead for pair in expected(model, both, [as_measured(waiting.poses, None, hold)], NOISE)))
    assert leads[0] < leads[1] < leads[2]


def test_simulated_measurements_do_not_tell_twins(arm: Arm) -> None:
    """An independent oracle of the trial: two names of one motion lead each other as often as chance lets them."""
    model = model_of(arm, effects_at(arm, "offsets"))
    model = model.with_free(fittable(model))
    twins = causes(model, "servo_droop@joint2", "compliance@joint2")
    told = told_in_trials(model, twins, [at_levels(arm, -1.0, -0.5, 0.3, 1.0)], NOISE, 0)
    assert max(told.values()) <= 2


QUANTILES = (np.arange(4000) + 0.5) / 4000


def power_by_mixture(noncentrality: float, size: int, freedom: int) -> float:
    """F = (χ'²/size)/(χ²/freedom): the power given the denominator, averaged over that."""
    critical, rest = stats.f.ppf(1.0 - TEST_LEVEL, size, freedom), stats.chi2.ppf(QUANTILES, freedom)
    return float(stats.ncx2.sf(critical * size * rest / freedom, size, noncentrality).mean())


@pytest.mark.long
@given(st.integers(1, 60), st.floats(-2.0, 5.0))
def test_the_power_is_that_of_the_noncentral_f_distribution(freedom: int, log_strength: float) -> None:
    rows = freedom + 2
    fitted, own = np.eye(rows)[:, :1], np.eye(rows)[:, 1:2] * 10.0**log_strength
    [effect] = effects_at(load_arm("two-joint"), "hysteresis@joint1")
    [rival] = discrimination_of([effect], fitted, [own], noise=1.0).rivals
    assert rival.power == pytest.approx(power_by_mixture(100.0**log_strength, 1, freedom), abs=2e-3)
    enough = rival.detectable_size**2 * 100.0**log_strength
    assert power_by_mixture(enough, 1, freedom) == pytest.approx(TARGET_POWER, abs=2e-3)


@pytest.mark.long
@given(st.integers(0, 10_000), st.floats(-6.0, -3.0))
def test_an_exchange_among_nearly_dependent_columns_ends(seed: int, log_apart: float) -> None:
    rng = np.random.default_rng(seed)
    J = rng.normal(size=(25, 3, 3))
    J[:, :, 2] = J[:, :, 0] - J[:, :, 1] + 10.0**log_apart * J[:, :, 2]
    criterion = criterion_of(J, "O1", np.zeros((3, 3)))
    found = maximise_criterion(criterion, 4, starts=3, seed=seed)
    assert found.score == criterion.evaluate(found.rows).score
    starts = [rng.choice(len(J), 4, replace=False) for _ in range(3)]
    assert all(_climb(criterion, rows).score >= criterion.evaluate(rows).score for rows in starts)


@pytest.mark.long
@pytest.mark.parametrize("parameters", ["compliance.*", "offsets.joint?.theta_rad"])
def test_few_poses_for_a_rival_on_a_small_arm(parameters: str) -> None:
    few = ["--levels", 5, "-n", 6, "--repeats", 0, "--separate", "hysteresis@joint1", "--parameters", parameters]
    said = stdout_of("design", "two-joint", *few, "--all")
    (row,) = (line for line in said.splitlines() if line.startswith("hysteresis@joint1"))
    assert "±" in row or "never" in row
