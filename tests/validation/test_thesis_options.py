"""The thesis's method on any data set: what identification on some poses promises for the rest."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.design.detmax import exchange
from lrm_ident.design.observability import identification_jacobian
from lrm_ident.fitting.model_fit import nominal_model
from lrm_ident.fitting.parameter_sets import select_parameters
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm, shipped_arms
from lrm_math.errors import LrmError, UnknownName
from lrm_math.model.equilibrium import solve_equilibrium
from tests.conftest import EXAMPLE
from tests.support.commands import stderr_of, stdout_of
from tests.support.sweep import soak
from validation import synthetic, synthetic_measurements
from validation.thesis.__main__ import main as thesis
from validation.thesis.error_distribution import error_distribution
from validation.thesis.thesis_options import (
    OPTIONS,
    OptionStudy,
    cross_apply,
    identify,
    option_named,
    residual_of,
    run_options,
)
from validation.thesis.thesis_results import LOADED, NO_LOAD, TABLE_6_8, campaign_named

NOISE = 3e-4
PUBLISHED_WITH_THE_DATA_MM = {"option1": 6.30, "option1_2": 6.25, "option2": 15.7, "option4": 7.28}
"""Mean error of the author's own parameter vectors on all 393 real poses."""


def measured(seed: int, count: int, payload: float = 0.0) -> Measurements:
    """Random poses of a random arm of the independent generator, with a load (kg)."""
    rig = synthetic.load_arm(shipped_arms()["lrm-lab"])
    poses_seed, truth = seed + round(payload * 1e4), synthetic.GroundTruth.random(rig, seed)
    q = synthetic.random_poses(rig, count, poses_seed, floor_m=0.1)
    return synthetic_measurements.measured(rig, truth, q, poses_seed, payload)


@pytest.fixture(scope="module")
def method(lab: Arm) -> OptionStudy:
    """All options on 200 synthetic poses without load."""
    return run_options(lab, measured(1, 200))


@pytest.fixture(scope="module")
def loaded(lab: Arm) -> OptionStudy:
    """The same arm at other poses with 66.3 g."""
    return run_options(lab, measured(1, 200, 0.0663), options=[option_named("option1_2")])


def test_the_options_are_the_thesis(lab: Arm) -> None:
    sizes = {option.name: len(select_parameters(nominal_model(lab), option.parameters)) for option in OPTIONS}
    assert sizes == {
        "option1": 28,
        "option2": 20,
        "option3": 7,
        "option4": 27,
        "option5": 6,
        "option1_2": 28,
        "option3_2": 7,
    }
    with pytest.raises(UnknownName, match="option1_2"):
        option_named("option6")


@pytest.mark.slow
def test_every_option_sees_fifty_poses_and_no_more(method: OptionStudy) -> None:
    for one in method.identified:
        assert len(one.rows) == len(np.unique(one.rows)) == 50
        assert one.rest.sum() == 150
        assert not one.rest[one.rows].any()
        n = [one.on_chosen.rms**2 * 50, one.on_rest.rms**2 * 150, one.on_all.rms**2 * 200]
        assert n[0] + n[1] == pytest.approx(n[2])


@pytest.mark.long
def test_what_is_hidden_does_not_change_what_is_identified(lab: Arm, method: OptionStudy) -> None:
    one = method.of("option1")
    spoiled = method.data.tcp.copy()
    spoiled[one.rest] += 0.05
    again = identify(
        replace(nominal_model(lab), free=one.fit.model.free),
        method.data.with_tcp(spoiled),
        one.option,
        one.rows,
    )
    np.testing.assert_array_equal(again.fit.model.values, one.fit.model.values)


@pytest.mark.long
def test_more_parameters_explain_more_of_the_chosen_poses(lab: Arm, method: OptionStudy) -> None:
    rows = method.of("option1").rows
    rms = {}
    for option in OPTIONS:
        model = replace(nominal_model(lab), free=select_parameters(nominal_model(lab), option.parameters))
        rms[option.name] = identify(model, method.data, option, rows).on_chosen.rms
    assert rms["option1"] <= min(rms["option2"], rms["option4"], rms["option1_2"]) + 1e-12
    assert rms["option4"] <= rms["option5"]
    assert rms["option3"] <= min(rms["option5"], rms["option3_2"]) + 1e-12


@pytest.mark.long
def test_physical_options_obey_physics(method: OptionStudy) -> None:
    for name in ("option1_2", "option3_2"):
        fitted = method.of(name).fit.model
        assert min(fitted.value(key) for key in fitted.free if key.startswith("compliance")) >= 0.0


@pytest.mark.slow
def test_on_an_arm_as_the_model_says_option_1_reaches_the_noise(lab: Arm) -> None:
    rig = synthetic.load_arm(shipped_arms()["lrm-lab"])
    names = ("joint2.theta_rad", "joint3.alpha_rad", "joint5.theta_rad")
    off = synthetic.Deviations.named(6, dict.fromkeys(names, 0.02) | {"base.z_m": 0.004, "tool.y_m": 0.003})
    truth = replace(
        synthetic.GroundTruth.nominal(rig),
        deviations=off,
        base_compliance_rad_per_nm=0.02,
        joint_compliance_rad_per_nm=(0.07, 0.06, 0.08, 0.1, 0.1, 0.1),
    )
    q = synthetic.random_poses(rig, 150, 4)
    data = synthetic_measurements.measured(rig, truth, q, 4)
    found = run_options(lab, data, options=[option_named(f"option{i}") for i in (1, 2, 3, 4)])
    assert found.of("option1").on_rest.rms < 1.25 * NOISE * np.sqrt(3)
    for name in ("option2", "option3", "option4"):
        assert found.of(name).on_rest.rms > 3 * found.of("option1").on_rest.rms


@pytest.mark.slow
def test_parameters_of_one_load_serve_another_if_springs_are_linear(method: OptionStudy, loaded: OptionStudy) -> None:
    crossed = cross_apply(method, loaded, "option1_2")
    for j, own in enumerate((method, loaded)):
        assert crossed.error(j, j) == own.of("option1_2").on_rest
        assert crossed.error(1 - j, j).mean < 1.5 * crossed.error(j, j).mean
        assert crossed.error(1 - j, j).mean < 0.2 * error_stats(own.nominal).mean


@pytest.mark.long
def test_the_poses_are_the_exchange_searchs(lab: Arm, method: OptionStudy) -> None:
    empty = nominal_model(lab)
    J = identification_jacobian(solve_equilibrium(empty, method.data.poses), select_parameters(empty, "option3"))
    np.testing.assert_array_equal(method.of("option3").rows, exchange(J, 50).rows)


def test_poses_that_cannot_tell_are_refused(lab: Arm) -> None:
    data = measured(1, 60)
    same = replace(data, poses=replace(data.poses, q=np.zeros_like(data.poses.q)))
    with pytest.raises(LrmError, match="determine only"):
        run_options(lab, same)
    with pytest.raises(LrmError, match="60"):
        run_options(lab, data, poses=100)
    with pytest.raises(UnknownName):
        run_options(load_arm("two-joint"), data)


@pytest.mark.parametrize(("seed", "draw"), [(0, "normal"), (1, "normal"), (2, "chi"), (3, "chi")])
def test_a_gaussian_is_told_from_what_is_none(seed: int, draw: str) -> None:
    rng = np.random.default_rng(seed)
    if draw == "normal":
        distance = np.abs(rng.normal(10.0, 1.0, 400))
        residual = distance[:, None] * np.array([[0.6, 0.0, 0.8]])
    else:
        residual = rng.normal(0.0, 1.0, (400, 3)) * rng.choice([0.4, 1.6], (400, 1))
    found = error_distribution(residual)
    assert found.is_gaussian == (draw == "normal")
    ours = found.misfit / (1 + 0.75 / 400 + 2.25 / 400**2)
    distance = np.linalg.norm(residual, axis=1)
    inside = stats.norm.cdf(np.sort(distance), distance.mean(), distance.std(ddof=1))
    i = np.arange(1, 401)
    assert ours == pytest.approx(-400 - np.mean((2 * i - 1) * (np.log(inside) + np.log1p(-inside[::-1]))), rel=1e-9)
    assert found.quantile(0.5) == pytest.approx(np.median(np.linalg.norm(residual, axis=1)))
    assert found.cumulative(np.array([found.mean]))[0] == pytest.approx(0.5)


def test_the_thesis_tables_hang_together(lab: Arm) -> None:
    for campaign in (NO_LOAD, LOADED):
        for name, values in campaign.parameters.items():
            free = select_parameters(nominal_model(lab), option_named(name).parameters)
            assert set(values) <= set(free)
            assert set(campaign.model(lab, name).keys) == set(nominal_model(lab).keys)
        assert set(campaign.on_all) == set(campaign.on_rest) == {"nominal", *campaign.parameters}
    assert min(v for k, v in NO_LOAD.parameters["option1_2"].items() if "compliance" in k) > 0
    assert TABLE_6_8["no-load", "no-load"][0] == NO_LOAD.on_rest["option1_2"].mean_mm
    assert TABLE_6_8["loaded", "loaded"][0] == LOADED.on_rest["option1"].mean_mm
    with pytest.raises(UnknownName, match="no-load"):
        campaign_named("unloaded")
    with pytest.raises(UnknownName):
        LOADED.model(lab, "option1_2")


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, *soak(1)])
def test_real_poses_no_worse_than_the_authors_own_parameters(lab: Arm, real: Measurements, seed: int) -> None:
    found = run_options(lab, real, seed=seed)
    for name, mean_mm in PUBLISHED_WITH_THE_DATA_MM.items():
        assert found.of(name).on_all.mean * 1e3 <= mean_mm
    assert found.of("option1").on_rest.mean < 1.05 * found.of("option1").on_all.mean
    assert not error_distribution(found.of("option1").residual).is_gaussian


@pytest.mark.slow
def test_the_command_writes_what_it_draws(tmp_path: Path, method: OptionStudy, loaded: OptionStudy) -> None:
    from lrm_ident.data.measurement_file.write import measurements_csv

    for name, one in (("light", method), ("heavy", loaded)):
        (tmp_path / f"{name}.csv").write_text(measurements_csv(one.data))
    words = ["--arm", "lrm-lab", "--only", "option1,option1_2,option5", "--beside", "no-load"]
    files = ["--figure", tmp_path / "a.svg", "--cross-figure", tmp_path / "b.png", "--json", tmp_path / "o.json"]
    said = stdout_of(tmp_path / "light.csv", tmp_path / "heavy.csv", *words, *files, program=thesis)
    assert "option 1₂" in said
    tables = json.loads((tmp_path / "o.json").read_text())
    assert [len(one["options"]) for one in tables["data_sets"]] == [3, 3]
    rows = list(csv.DictReader((tmp_path / "a.csv").open()))
    told = tables["data_sets"][0]["options"][0]
    rest = [float(row["option1_mm"]) for row in rows if row["option1_chosen"] == "0"]
    assert np.mean(rest) == pytest.approx(told["error"]["rest"]["mean_mm"], abs=1e-3)
    chosen_there = [int(row["pose"]) for row in rows if row["option1_chosen"] == "1"]
    assert chosen_there == told["chosen_poses"]
    crossed = list(csv.DictReader((tmp_path / "b.csv").open()))
    assert {row["measured_on"] for row in crossed} == {"light", "heavy"}
    stated = next(c for c in tables["cross_load"] if (c["identified_on"], c["measured_on"]) == ("heavy", "light"))
    errors = [float(r["heavy_mm"]) for r in crossed if r["measured_on"] == "light" and r["chosen_there"] == "0"]
    assert np.mean(errors) == pytest.approx(stated["error"]["mean_mm"], abs=1e-3)
    assert (tmp_path / "a.svg").stat().st_size > 1000
    assert (tmp_path / "b.png").stat().st_size > 1000


def test_wrong_words_are_one_line() -> None:
    for words in (["--only", "option7"], ["--beside", "full"], ["--cross-figure", "x.png"], ["-n", "301"]):
        assert stderr_of(EXAMPLE, *words, program=thesis)


@pytest.mark.long
def test_residuals_are_measured_minus_predicted(lab: Arm, method: OptionStudy) -> None:
    np.testing.assert_array_equal(method.nominal, residual_of(nominal_model(lab), method.data))
