"""Cards of steps say what is true of the rivals: those that were tried, that none was near, or how to learn it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

import lrm_ident as lrm
from lrm_ident.report.model_report import quick_report, with_diagnosis
from lrm_ident.residual.thresholds import MAX_UNEXPLAINED_RATIO
from lrm_ident.workbench.html_report import html_report
from tests.conftest import EXAMPLE, ROOT
from tests.support.commands import stdout_of
from validation import synthetic


@pytest.fixture(scope="module")
def stepped(better_study: lrm.Study) -> lrm.Study:
    """Two steps after the fit."""
    return better_study.add("eccentricity@joint5")


def cards(browser: Any, model: Path, text: str, diagnosis: lrm.DiagnosisReport) -> list[str]:
    """The words of the cards in the report of a model with this text, and of the line at their end."""
    model.write_text(text, encoding="utf-8")
    page, report = browser.new_page(), model.with_suffix(".html")
    report.write_text(
        html_report(with_diagnosis(quick_report(lrm.read_study(model, EXAMPLE)), diagnosis)), encoding="utf-8"
    )
    page.goto(report.as_uri())
    page.wait_for_selector("#lrm-cards article")
    where = page.evaluate("lrm.state.values.where")
    assert page.evaluate("lrm.state.candidate") is None
    assert page.input_value("#lrm-joint") == str(where["joint"]), "it opens on what shows most"
    assert page.input_value("#lrm-driver") == where["driver"]
    ratios = page.evaluate("lrm.state.values.cards.map((one) => one.ratio)")
    assert all(one is None or one > MAX_UNEXPLAINED_RATIO for one in ratios), "named only where it is the reason"
    found = page.eval_on_selector_all("#lrm-cards > *", "(all) => all.map((one) => one.innerText)")
    page.close()
    return [str(one) for one in found]


@pytest.mark.slow
def test_cards_say_what_is_known_of_rivals(browser: Any, stepped: lrm.Study, tmp_path: Path) -> None:
    model, found = tmp_path / "m.toml", stepped.diagnose()
    stepped.save(model)
    text = model.read_text(encoding="utf-8")
    first, second = cards(browser, model, text, found)
    assert "torque_curve@joint2): ≈ 0.5" in first
    assert "mm, with more parameters" in first
    assert "what each alone would have left" in second

    rivals, refitted = r"\[history\.rivals_mm\]\n(\".*\n)+", 'rivals_refitted = ["compliance@joint1"]'
    far, _ = cards(browser, model, re.sub(rivals, '[history.rivals_mm]\n"compliance@joint1" = 2.5\n', text), found)
    assert "No other effect explained it as well." in far
    assert "(compliance@joint1): ≈ 2.50 mm" in far
    one = re.sub(rivals, '[history.rivals_mm]\n"compliance@joint1" = 2.5\n', text)
    known, _ = cards(browser, model, one.replace("rivals_refitted = []", refitted), found)
    assert "(compliance@joint1): 2.50 mm" in known

    first, second = cards(browser, model, re.sub(rivals, "", text), found)
    assert "undo these steps (lrm-ident undo 2 times) and diagnose the model before it" in first
    assert "undo this step (lrm-ident undo) and diagnose the model before it" in second


@pytest.mark.slow
def test_page_one_names_what_cannot_be_told_apart_and_what_is_next(browser: Any, tmp_path: Path) -> None:
    data, *_ = synthetic.write_example(tmp_path, ROOT / "config" / "arms" / "two-joint.toml")
    model, report = tmp_path / "m.toml", tmp_path / "r.html"
    stdout_of("fit", data, "-o", model)
    stdout_of("report", model, data, "-o", report)
    page = browser.new_page()
    page.goto(report.as_uri())
    page.wait_for_selector("#lrm-ranking label")
    verdict, following = page.inner_text("#lrm-verdict"), page.inner_text("#lrm-next")
    first, second = page.evaluate("lrm.state.values.ranking.slice(0, 2).map((one) => [one.title, one.verdict])")
    assert (first[1], second[1]) == ("indistinguishable", "indistinguishable")
    assert verdict.startswith("Missing from the model: backlash in joint 2 (backlash@joint2), or another")
    assert second[0] in page.inner_text("#lrm-facts")
    assert following.split()[:4] == ["Next", "1.", "Add", "it"], "no poses that were tried distinguish them"
    assert page.inner_text("h1").startswith("two-joint: model and measurements ")
    page.close()
