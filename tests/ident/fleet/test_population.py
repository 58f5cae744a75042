"""Population, rates, outliers and tags against populations whose truth is known, a broken arm among them."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.data.measurements import Measurements
from lrm_ident.data.source import Source
from lrm_ident.diagnosis.effect_pairs import EffectPairs
from lrm_ident.diagnosis.forward_selection import forward_select
from lrm_ident.diagnosis.screening.linearised_fit import linearise
from lrm_ident.fitting.priors import EffectRates
from lrm_ident.fitting.progress import silent
from lrm_ident.fleet import fleet_findings
from lrm_ident.fleet.effect_rates import EffectRate, effect_rates, exact_interval
from lrm_ident.fleet.fleet_report import FleetResult, fleet_result, outlier_sentence, rate_words
from lrm_ident.fleet.identify_arm import ArmRecord, evidence_of
from lrm_ident.fleet.manifest import FleetMember
from lrm_ident.fleet.population import ArmEvidence, fit_population
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects import ModelPart, effects_at
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of


def drawn(rng: np.random.Generator, mean: Array, spread: Array, arms: int, error: float) -> list[ArmEvidence]:
    """Arms whose every parameter is estimates with a standard error of `error`."""
    places, estimates = np.arange(len(mean)), np.eye(len(mean)) / error**2
    true = mean + spread * rng.normal(size=(arms, len(mean)))
    return [ArmEvidence(places, estimates, estimates @ (one + error * rng.normal(size=len(mean)))) for one in true]


def test_exact_arms_give_sample_mean_and_variance() -> None:
    rng = np.random.default_rng(1)
    arms = drawn(rng, np.array([0.5, -1.0]), np.array([0.3, 0.05]), 12, 1e-4)
    values = np.array([arm.along * 1e-8 for arm in arms])
    found = fit_population(arms, 2)
    assert found.mean == pytest.approx(values.mean(axis=0), abs=1e-3)
    assert found.spread == pytest.approx(values.std(axis=0, ddof=1), rel=0.02)
    assert found.mean_error == pytest.approx(values.std(axis=0, ddof=1) / np.sqrt(12), rel=0.02)
    assert found.freedom == pytest.approx([11.0, 11.0], rel=0.1)


@pytest.mark.slow
def test_intervals_of_mean_and_spread_hold_as_often_as_they_say() -> None:
    """40 populations of 8 parameters: 320 intervals of each kind, of which 95 % should hold (binomial, 4 sd)."""
    rng, mean, spread = np.random.default_rng(2), np.linspace(-1, 1, 8), np.geomspace(0.2, 1.0, 8)
    held = np.zeros(2)
    for _ in range(40):
        found = fit_population(drawn(rng, mean, spread, 10, 0.2), 8)
        for k, (truth, (low, high)) in enumerate([(mean, found.mean_interval), (spread, found.spread_interval)]):
            held[k] += np.count_nonzero((low <= truth) & (truth <= high))
    assert held.min() / 320 >= 0.95 - 4 * np.sqrt(0.95 * 0.05 / 320)


def test_what_one_arm_cannot_tell_apart_its_sisters_may() -> None:
    """Each arm knows only a sum of two parameters, with weights of its own: together they tell both means."""
    rng, mean = np.random.default_rng(3), np.array([0.8, -0.4])
    arms = []
    for _ in range(40):
        row = rng.normal(size=2)
        value = row @ (mean + 0.1 * rng.normal(size=2)) + 0.01 * rng.normal()
        arms.append(ArmEvidence(np.arange(2), np.outer(row, row) / 1e-4, row * value / 1e-4))
    found = fit_population(arms, 2)
    assert np.all(np.abs(found.mean - mean) < 4 * found.mean_error)
    assert found.mean_error.max() < 0.1


def test_a_sum_that_no_arm_can_take_apart_is_known_of_the_next() -> None:
    """Every arm knows the sum of two parameters and nothing of their difference: so does the prior."""
    rng, row = np.random.default_rng(5), np.array([1.0, 1.0])
    arms = []
    for _ in range(30):
        value = 0.4 + 0.02 * rng.normal()
        arms.append(ArmEvidence(np.arange(2), np.outer(row, row) / 1e-6, row * value / 1e-6))
    found = fit_population(arms, 2).predictive_covariance
    assert np.sqrt(np.diag(found)).min() > 1.0
    assert 0.01 < np.sqrt(row @ found @ row) < 0.04


def test_a_parameter_that_no_arm_has_stays_unknown() -> None:
    arms = drawn(np.random.default_rng(4), np.zeros(1), np.ones(1), 5, 0.1)
    found = fit_population(arms, 2)
    assert (found.arms.tolist(), found.mean[1]) == ([5.0, 0.0], pytest.approx(0.0))
    assert np.sqrt(found.predictive_covariance[1, 1]) > 2.9


def test_unsure_arms_count_for_what_their_sisters_have() -> None:
    sure, unsure = [["backlash@joint2"]], [["nonlinear_stiffness@joint2", "backlash@joint2"]]
    tested = [["backlash@joint2", "nonlinear_stiffness@joint2", "hysteresis@joint3"]] * 12
    rates = {one.name: one for one in effect_rates([*[sure] * 6, *[unsure] * 2, *[[]] * 4], tested)}
    assert rates["backlash@joint2"].found > 7.5
    assert rates["nonlinear_stiffness@joint2"].found < 0.5
    assert rates["backlash@joint2"].low < 8 / 12 < rates["backlash@joint2"].high
    assert rates["hysteresis@joint3"].rate < 0.2


def test_rates_without_arms() -> None:
    assert effect_rates([], []) == ()


def test_a_rate_is_what_was_seen_and_in_whole_percents_what_that_says_of_the_kind() -> None:
    (rate,) = effect_rates([[["backlash@joint2"]]] * 3, [["backlash@joint2"]] * 3)
    assert re.fullmatch(r"3 of 3 arms \(of the kind: \d+ to \d+ %\)", rate_words(rate))
    assert rate_words(EffectRate("play", 3.0, 3, 0.8, 0.4512, 0.9968)) == "3 of 3 arms (of the kind: 45 to 100 %)"
    assert rate_words(EffectRate("play", 0.5, 12, 0.05, 0.0007, 0.3044)) == "0.5 of 12 arms (of the kind: 0 to 30 %)"


@given(st.integers(1, 200), st.floats(1e-6, 1.0) | st.just(0.0), st.integers(2, 10))
def test_the_interval_of_a_rate_shrinks_with_arms(arms: int, share: float, times: int) -> None:
    """Also of parts of arms, and of none and of all."""
    found = min(share * arms, arms)
    low, high = exact_interval(found, arms)
    assert 0.0 <= low <= found / arms <= high <= 1.0
    less, more = exact_interval(times * found, times * arms)
    assert more - less < high - low
    assert exact_interval(arms - found, arms) == pytest.approx((1.0 - high, 1.0 - low), abs=1e-9)


def test_the_interval_of_a_rate_against_tables() -> None:
    """Clopper & Pearson: by their definition for all of n, and from published tables of 1 and 5 of 10."""
    assert exact_interval(3, 3) == pytest.approx((0.025 ** (1 / 3), 1.0))
    assert exact_interval(1, 10) == pytest.approx((0.0025, 0.4450), abs=5e-5)
    assert exact_interval(5, 10) == pytest.approx((0.1871, 0.8129), abs=5e-5)


def test_a_rare_effect_is_not_said_to_be_rarer_than_it_was_seen() -> None:
    """One of three arms, among a hundred effects that no arm has."""
    names = [f"backlash@joint{k}" for k in range(100)]
    first, *_ = effect_rates([[[names[0]]], [], []], [names] * 3)
    assert rate_words(first) == "1 of 3 arms (of the kind: 1 to 91 %)"
    assert first.rate < 0.1, "what is known of all effects makes it rare for the next arm"


def test_an_effect_that_is_expected_is_selected_before_one_that_predicts_as_well() -> None:
    """Two candidates with the same columns: without rates the first in the list, with them the expected one."""
    rng = np.random.default_rng(5)
    poses, column = 60, rng.normal(size=(180, 1))
    residual = 2.0 * column[:, 0] + 0.1 * rng.normal(size=180)
    folds = [np.arange(k, poses, 10) for k in range(10)]
    linear = linearise(rng.normal(size=(180, 3)), residual, folds, 0.1)
    weak, strong = (
        SimpleNamespace(
            name=name,
            size=1,
            implausible=None,
            projected=linear.project(column),
            alone=linear.explain(linear.project(column)),
            candidate=SimpleNamespace(
                trials=1,
                shapes=((),),
                priority=2,
                effect=SimpleNamespace(place="joint1", is_free_form=False, variant_of=(), part=ModelPart.ARM),
                name=name,
            ),
        )
        for name in ("rare@joint1", "usual@joint1")
    )
    ranked: Any = [weak, strong]
    sets = linear.project_each([column, column], [1, 1])
    start = EffectPairs(ranked, sets, linear, {one.name: one.alone for one in ranked})
    assert forward_select(start, silent).effects[0] is weak
    weights = EffectRates({"usual@joint1": 0.8}, 0.01).weights([one.name for one in ranked])
    assert forward_select(start, silent, weights).effects[0] is strong
    even = dict.fromkeys(weights, 1.0)
    assert forward_select(start, silent, even).effects[0] is weak


@given(st.lists(st.floats(-10.0, 10.0), min_size=4, max_size=12), st.integers(0, 1000))
def test_leaving_one_out_is_as_leaving_it_out(values: list[float], seed: int) -> None:
    errors = np.random.default_rng(seed).uniform(0.1, 1.0, len(values))
    rows = [(k, value, float(error)) for k, (value, error) in enumerate(zip(values, errors, strict=True))]
    _, middles, spreads = fleet_findings._leave_one_out(rows)
    medians = fleet_findings._medians_of_others(errors)
    for k in range(len(rows)):
        rest = np.delete(values, k)
        assert (middles[k], spreads[k]) == (
            pytest.approx(rest.mean(), abs=1e-9),
            pytest.approx(rest.std(ddof=1), abs=1e-6),
        )
        assert medians[k] == pytest.approx(np.median(np.delete(errors, k)))


ARM, ARMS, POSES, BROKEN = "lrm-lab", 18, 20, 4
SOFT, LOOSE = "compliance.joint3.k_rad_per_Nm", "compliance.joint2.k_rad_per_Nm"


def fleet(softer: float, folder: Path) -> FleetResult:
    """Arms of two batches in turn; joint 3 of the second is so many times as soft; joint 2 of one arm five times."""
    arm = load_arm(ARM)
    effects = effects_at(arm, "compliance")
    members, records = list[FleetMember](), list[ArmRecord]()
    for number in range(ARMS):
        rng, second = np.random.default_rng([11, number]), number % 2 == 1
        values = {f"compliance.joint{k}.k_rad_per_Nm": 0.03 * (1 + 0.08 * rng.normal()) for k in range(1, 7)}
        values[SOFT] *= softer if second else 1.0
        values[LOOSE] *= 5.0 if number == BROKEN else 1.0
        equilibrium = solve_equilibrium(
            model_of(arm, effects, values), poses_of(rng.uniform(-0.8, 0.8, (POSES, arm.dof)))
        )
        tcp = equilibrium.tcp + rng.normal(0, 3e-4, (POSES, 3))
        data = Measurements.of_tcp(equilibrium.poses, tcp, source=Source(arm=arm))
        name, tags = f"arm{number}", (("batch", "AB"[second]), ("screwdriver", "xy"[number // 2 % 2]))
        evidence = evidence_of(model_of(arm, effects), data, ARM)
        members.append(FleetMember(name, Path(f"{name}.csv"), ARM, tags))
        records.append(ArmRecord(name=name, sha256="made", poses=POSES, evidence=evidence))
    return fleet_result(members, records, folder)


@pytest.fixture(scope="module")
def two_batches(tmp_path_factory: pytest.TempPathFactory) -> FleetResult:
    return fleet(1.8, tmp_path_factory.mktemp("batches"))


@pytest.mark.slow
def test_the_softer_joint_goes_with_the_batch_and_nothing_else_does(two_batches: FleetResult) -> None:
    assert [(link.what, link.tag) for link in two_batches.links] == [(SOFT, "batch")]
    medians = {level: float(words.split()[-1]) for level, words in two_batches.links[0].levels}
    assert medians["B"] / medians["A"] == pytest.approx(1.8, rel=0.15)


@pytest.mark.long
def test_the_broken_arm_is_named_and_the_batch_is_no_outlier(two_batches: FleetResult) -> None:
    assert [(one.arm, one.key) for one in two_batches.outliers] == [(f"arm{BROKEN}", LOOSE)]
    assert outlier_sentence(two_batches.outliers[0]).startswith(f"arm{BROKEN}: joint2's compliance")


@pytest.mark.slow
def test_where_no_batch_differs_none_is_named(tmp_path: Path) -> None:
    found = fleet(1.0, tmp_path)
    assert not found.links
    assert [one.arm for one in found.outliers] == [f"arm{BROKEN}"]
