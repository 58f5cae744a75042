"""Interactive figures: laws of the error field and of a candidate beside the data; the report's size."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import lrm_ident as lrm
from lrm_ident.data.measurements import Measurements
from lrm_ident.fitting.model_fit import nominal_model
from lrm_ident.report.diagnosis.standing import Standing
from lrm_ident.report.document import ListSection, ResultTable, blocks_html, heading
from lrm_ident.report.model_report import quick_report, with_diagnosis
from lrm_ident.report.plain_names import WORDS, plain_name
from lrm_ident.report.plots.interactive.candidate_view import candidate_view
from lrm_ident.report.plots.interactive.values import figure_values, values_text
from lrm_ident.residual.covariates import Covariate, covariates
from lrm_ident.residual.picture.drivers import NO_FUNCTION, drivers_of, von_neumann_ratio
from lrm_ident.residual.picture.error_field import MOST_DRAWN, arrow_scale, error_field, joint_turns, rows_to_draw
from lrm_ident.residual.picture.group_means import explained_by_means, shown_most
from lrm_math.effects import CATALOGUE, FREE_FORMS
from lrm_math.model.derivatives import joint_levers
from lrm_math.model.equilibrium import solve_equilibrium
from tests.conftest import EXAMPLE
from tests.support.commands import stdout_of


@pytest.fixture(scope="module")
def data() -> Measurements:
    """The shipped data set."""
    return lrm.load(EXAMPLE)


def test_a_turn_of_one_joint_is_seen_as_that_turn() -> None:
    """A residual that is a turn of joint 3 by 0.01 rad reads 0.01 rad there."""
    rng = np.random.default_rng(0)
    motion = rng.normal(size=(6, 3, 50))
    assert joint_turns(0.01 * motion[2].T, motion)[2] == pytest.approx(0.01)


@given(st.floats(1e-6, 10.0), st.floats(1e-3, 10.0))
def test_the_arrow_scale_is_round_and_bounded(error: float, spread: float) -> None:
    rng = np.random.default_rng(1)
    tcp = rng.normal(scale=spread, size=(100, 3))
    scale = arrow_scale(tcp, rng.normal(scale=error, size=(100, 3)))
    assert f"{scale.magnification:.0e}"[0] in "125"
    assert scale.largest > 0


@pytest.mark.long
def test_scale_and_steps_of_the_error_field(data: Measurements, example_study: lrm.Study) -> None:
    assert data.source.arm is not None
    nominal, fitted = nominal_model(data.source.arm), example_study.model
    field = error_field(data, [("nominal", nominal), ("fit", fitted)])
    assert field.scale == error_field(data, [("nominal", nominal)]).scale, "a later step must not change the scale"
    assert field.steps[1].error.rms < 0.2 * field.steps[0].error.rms
    assert field.bent[:, -1] + field.steps[1].residual == pytest.approx(data.tcp, abs=1e-12)
    assert len(field.rows) == field.poses


def test_many_poses_are_thinned_and_their_number_is_kept(data: Measurements) -> None:
    rows = np.tile(np.arange(len(data)), 34)
    many = replace(data.take(rows), pose=np.arange(1, len(rows) + 1))
    assert data.source.arm is not None
    field = error_field(many, [("nominal", nominal_model(data.source.arm))])
    assert len(field.rows) == MOST_DRAWN
    assert field.poses == len(rows)
    worst = np.argmax(np.linalg.norm(many.tcp - field_tcp(many), axis=1))
    assert worst in rows_to_draw(many.tcp - field_tcp(many))


def field_tcp(data: Measurements) -> np.ndarray:
    assert data.source.arm is not None
    return lrm.predict(nominal_model(data.source.arm), data.poses)


@pytest.mark.slow
def test_the_form_of_the_hidden_play_lies_on_the_data(example_diagnosis: lrm.DiagnosisReport) -> None:
    report = example_diagnosis
    fitted, seen = report.diagnosis.screening.subset
    known = covariates(seen, fitted.equilibrium.joint_torque)
    assert report.first is not None
    view = candidate_view(report.first, report.diagnosis, known, np.arange(len(seen)))
    assert (view["name"], view["joint"], view["driver"]) == ("backlash@joint2", 1, "torque of joint 2")
    around, form, added = (np.array(view[name], dtype=np.float64) for name in ("around", "form", "added"))
    assert np.nanstd(around - form) < 0.2 * np.nanstd(around)
    residual = 1e3 * fitted.residual
    explained = 1 - ((residual - added) ** 2).sum() / (residual**2).sum()
    assert explained > 0.9


def is_one_small_file_that_asks_nothing_of_the_network(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert len(text) < 6e6
    page = text.split("<script>/**")[0]
    assert "default-src 'none'" in page
    assert 'src="http' not in page
    assert "@media print" in page


@pytest.mark.slow
def test_what_explains_as_well_is_told_apart_and_every_card_says_what_was_found(
    tmp_path: Path,
    example_study: lrm.Study,
    better_study: lrm.Study,
    example_diagnosis: lrm.DiagnosisReport,
    example_model: Path,
) -> None:
    bare, second, page = tmp_path / "bare.toml", tmp_path / "n.toml", tmp_path / "r.html"
    better_study.save(second)
    drawn = figure_values(with_diagnosis(quick_report(example_study), example_diagnosis))
    ranking = {one["name"]: one for one in drawn["ranking"]}
    assert ranking["backlash@joint2"]["standing"] == "identified cause"
    assert ranking["torque_curve@joint2"]["mark"] == "◌ imitates the first, with more parameters"
    assert ranking["nonlinear_stiffness@joint2"]["standing"] == "explains part of it"
    assert ranking["backlash@joint2"]["gain"] > 2.0 > ranking["nonlinear_stiffness@joint2"]["gain"] > 1.0
    bare.write_text(example_model.read_text().split("[[history]]")[0])
    stdout_of("report", bare, EXAMPLE, "-o", page)
    is_one_small_file_that_asks_nothing_of_the_network(page)
    alone = _values_of(page)
    assert alone["story"] is None
    assert not any(step["here"] for step in alone["steps"])
    assert {one["name"]: one["standing"] for one in alone["ranking"]} == {k: v["standing"] for k, v in ranking.items()}
    stdout_of("report", second, EXAMPLE, "-o", page)
    found = _values_of(page)
    (card,) = found["cards"]
    assert (card["title"], card["joint"], card["driver"]) == ("Backlash in joint 2", 1, "torque of joint 2")
    assert card["fall"].split(" → ") == [step["held"] for step in found["steps"]]
    assert card["share"] > 0.9
    assert card["shows"] == "finding", "nothing that could be another cause"
    assert all(step["here"] for step in found["steps"])
    assert card["rivals"][0]["name"] == "torque_curve@joint2"
    assert card["rivals"][0]["why"].endswith(" mm, with more parameters")
    assert not card["unrivalled"], "a free curve explains it as well"


def _values_of(page: Path) -> dict[str, Any]:
    """The values that a report draws its figures from."""
    inside = re.search(r'id="lrm-values">(.*?)</script>', page.read_text(encoding="utf-8"), re.S)
    assert inside is not None
    return dict(json.loads(inside[1]))


@given(st.integers(0, 5), st.integers(0, 5), st.integers(0, 10**6))
def test_a_form_is_drawn_over_all_that_it_is_a_function_of(first: int, second: int, seed: int) -> None:
    """One quantity: that one; two: both; their order does not matter."""
    rng = np.random.default_rng(seed)
    known = [Covariate("angle", rng.uniform(-1.0, 1.0, 400), joint) for joint in range(6)]
    x, y = known[first].values, known[second].values
    found = drivers_of(np.sin(3.0 * (x + y)) + np.cos(3.0 * (x - y)), known, first, np.ones(400, dtype=np.bool_))
    assert {one.joint for one in found} == {first, second}


@given(st.integers(2, 4), st.integers(0, 10**6))
def test_poses_that_stand_alike_have_no_order(stops: int, seed: int) -> None:
    """A form that runs with the order of measurement is no function of a joint of few levels; nor is their order."""
    rng = np.random.default_rng(seed)
    level, form = np.repeat(np.arange(float(stops)), 60), np.tile(np.linspace(-1.0, 1.0, 60), stops)
    shuffled = rng.permutation(len(form))
    assert von_neumann_ratio(form, level) > NO_FUNCTION
    assert von_neumann_ratio(form[shuffled], level[shuffled]) > NO_FUNCTION
    assert von_neumann_ratio(level**2, level) <= NO_FUNCTION
    assert von_neumann_ratio(level + form, level, form) <= NO_FUNCTION


@given(st.integers(0, 5), st.integers(0, 5), st.sampled_from([5, 400]), st.integers(0, 10**6))
def test_charts_open_on_the_joint_and_the_quantity_that_show_most(joint: int, of: int, stops: int, seed: int) -> None:
    """A turn of one joint that follows one quantity, of few levels or of many, among noise of all joints."""
    rng = np.random.default_rng(seed)
    known = [Covariate("angle", rng.integers(0, stops, 400) / stops - 0.5, k) for k in range(6)]
    turns, lever = 0.2 * rng.normal(size=(6, 400)), rng.uniform(0.5, 2.0, (6, 400))
    turns[joint] += np.sin(6.0 * known[of].values)
    shown = [explained_by_means(turns, lever, one.values) for one in known]
    assert shown_most(shown, known, range(6)) == (joint, known[of].variable)
    assert shown[of][joint] < (lever[joint] * turns[joint] ** 2).sum(), "a part of all"


@given(st.integers(0, 10**6))
def test_noise_shows_nothing_on_average(seed: int) -> None:
    """Within 4.5 standard errors of a mean of 200 χ² of 11 degrees of freedom, less their number."""
    rng = np.random.default_rng(seed)
    turns, ones = rng.normal(size=(200, 300)), np.ones((200, 300))
    assert abs(explained_by_means(turns, ones, rng.normal(size=300)).mean()) < 4.5 * np.sqrt(22 / 200)


@pytest.mark.slow
def test_where_it_fails_is_where_the_error_is(data: Measurements, better_study: lrm.Study) -> None:
    """A turn of joint 4 that follows joint 3, which no fit of the geometry takes away."""
    lever = joint_levers(solve_equilibrium(better_study.model, data.poses))[3].T
    wrong = data.with_tcp(data.tcp + 0.02 * np.sin(5.0 * data.poses.q[:, [2]]) * lever)
    where = figure_values(quick_report(lrm.Study.of(wrong).fit().add("backlash@joint2")))["where"]
    assert where == {"joint": 3, "driver": "angle of joint 3"}


@pytest.mark.slow
def test_the_list_begins_with_what_the_verdict_names(
    example_study: lrm.Study, example_diagnosis: lrm.DiagnosisReport
) -> None:
    """Also where one that the data cannot tell from others comes before one that has support of its own."""
    found = with_diagnosis(quick_report(example_study), example_diagnosis)
    assert found.diagnosis is not None
    ranking = [dict(one) for one in found.diagnosis.values["ranking"]]  # type: ignore[attr-defined]
    ranking[0]["standing"], ranking[3]["standing"] = Standing.LIKE, Standing.BESIDE
    judged = replace(found.diagnosis, values={**found.diagnosis.values, "ranking": ranking})
    shown = [one["name"] for one in figure_values(replace(found, diagnosis=judged))["ranking"]]
    assert shown[:2] == [f"{one['effect']}@{one['place']}" for one in (ranking[0], ranking[3])]


def test_every_effect_has_a_plain_name() -> None:
    for kind in (*CATALOGUE, *FREE_FORMS):
        assert WORDS[kind.id]["name"]
        assert "{" not in plain_name(f"{kind.id}@joint2")
    assert plain_name("cable_curve@joint1+joint2") == "a smooth curve over joints 1 and 2"
    assert plain_name("my_own@tool") == "my own of tool"


@pytest.mark.long
def test_estimates_are_named_without_the_unit_of_the_file(
    better_study: lrm.Study, example_diagnosis: lrm.DiagnosisReport
) -> None:
    """The file's `b_rad` is shown in degrees."""
    found = with_diagnosis(quick_report(better_study), example_diagnosis)
    for backlash, *others in (found.cards[0].estimates, found.candidates[0]["estimates"]):
        assert re.fullmatch(r"b = 2\.2\d+ ± 0\.02\d*°", backlash)
        assert all("_" not in one for one in others)


def test_blocks_as_html_are_escaped_and_whole() -> None:
    table = ResultTable(("name", "value|.1f"), [("<b>", 1.25)], "a & b")
    html = blocks_html([heading("Verdict <x>"), "text & more", table, ListSection("list", tuple("abcdefgh"))])
    assert "<h3>Verdict &lt;x&gt;</h3>" in html
    assert '<td class="right">1.2</td>' in html
    assert html.count("<li>") == 8
    assert "<h3>list</h3>" in html, "of the same order as another heading"
    assert "2 more" in html


def test_values_hold_no_end_of_a_script() -> None:
    assert "</" not in values_text({"name": "</script><script>alert(1)</script>"})
