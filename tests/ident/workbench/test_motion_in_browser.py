"""The page of motion: its numbers are the study's, its charts are drawn, and axe-core finds nothing in either theme."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lrm_ident.measuring.motion.motion_study import MotionStudy
from lrm_ident.workbench.motion_page import motion_figures, motion_page
from tests.ident.motion.arm_in_motion import JOINT
from tests.ident.motion.test_motion_study import study
from tests.ident.workbench.test_axe_in_browser import faults
from tests.support.browser import opened, with_axe, workbench
from tests.support.commands import stdout_of
from tests.support.teleoperation import recorded, sound_arm
from validation.lerobot_dataset import write_dataset


@cache
def both() -> tuple[MotionStudy, MotionStudy]:
    """A model without and with the friction that hides."""
    before = study("friction")
    return before, before.add("coulomb_friction@joint2")


def test_a_prediction_and_what_it_leaves_add_up_to_the_reading() -> None:
    before, after = both()
    found = motion_figures(before, after)
    assert [one["name"] for one in found["steps"]] == ["servo response", "Coulomb friction of joint 2"]
    assert [one["error"] for one in found["steps"]] == pytest.approx(
        np.degrees([before.held_out_rms, after.held_out_rms]), abs=6e-4
    )
    assert found["first"] == JOINT
    what = found["what"][JOINT]
    assert len(what["moves"]) == 8
    for move in what["moves"]:
        for name, left in zip(("before", "after"), move["left"], strict=True):
            total = np.array(move[name]) + np.array(left)
            np.testing.assert_allclose(total, move["read"], atol=2.1e-3)


def test_a_joint_to_which_nothing_was_added_says_so() -> None:
    added = [what["added"] for what in motion_figures(*both())["what"]]
    assert added == [joint == JOINT for joint in range(len(added))]
    plain = study("nothing")
    assert not any(what["added"] for what in motion_figures(plain, plain)["what"])
    page = motion_page(plain, plain, "motion.toml")
    assert "Moves as predicted" in page
    assert "Before and after" not in page


def test_no_table_stands_twice() -> None:
    page = motion_page(*both(), "better.toml")
    heads = re.findall(r"<thead>.*?</thead>", page, re.DOTALL)
    assert len(heads) == 3  # effects, errors, parameters
    assert len({*heads}) == len(heads)


def opened_page(browser: Any, tmp_path: Path) -> Any:
    """The page in the browser, its charts drawn."""
    path = tmp_path / "motion.html"
    path.write_text(motion_page(*both(), "better.toml"), encoding="utf-8")
    page = browser.new_context(viewport={"width": 1280, "height": 900}).new_page()
    page.goto(path.as_uri())
    page.wait_for_selector("#lrm-left.js-plotly-plot")
    return page


def test_its_charts_are_drawn_and_follow_what_is_chosen(browser: Any, tmp_path: Path) -> None:
    page = opened_page(browser, tmp_path)
    assert page.locator("#lrm-steps .bars .point").count() == 2
    left = "document.getElementById('lrm-{}')._fullLayout._size.l"
    assert page.evaluate(left.format("path")) == page.evaluate(left.format("left")), "time is at the same place in both"
    said, drawn = page.locator("#lrm-errors"), "document.getElementById('lrm-path').data.map((one) => one.name)"
    assert " before, " in said.inner_text()
    assert page.evaluate(drawn) == ["command", "encoder", "predicted before", "predicted after"]
    page.select_option("#lrm-what", index=0)
    assert "Nothing was added to the servo response here" in said.inner_text()
    assert page.evaluate(drawn) == ["command", "encoder", "predicted"]
    assert page.evaluate("document.getElementById('lrm-left').data.length") == 1
    page.context.close()


@with_axe
@pytest.mark.slow
def test_axe_finds_nothing_in_it(browser: Any, tmp_path: Path) -> None:
    page = opened_page(browser, tmp_path)
    found = faults(page, "motion", lambda: page.click("#lrm-theme"))
    page.context.close()
    assert not found, "\n".join(map(str, found))


@pytest.mark.slow
def test_the_button_of_the_workbench_opens_the_page_in_a_tab_beside(browser: Any, tmp_path: Path) -> None:
    write_dataset(tmp_path / "moves", recorded(sound_arm(np.random.default_rng(5)), np.random.default_rng(6)), "v3.0")
    stdout_of("motion", "fit", tmp_path / "moves", "-o", tmp_path / "motion.toml")
    with workbench("--motion", tmp_path / "motion.toml", tmp_path / "moves", cwd=tmp_path) as running:
        page = opened(browser, running, {"width": 390, "height": 900})
        with page.context.expect_page() as beside:
            page.click("[data-name=motion]")
        beside.value.wait_for_selector("#lrm-left.js-plotly-plot")
        assert beside.value.title() == "Motion: moves, so101"
        page.context.close()
