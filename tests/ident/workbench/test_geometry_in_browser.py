"""Nothing lies over anything, nothing is cut: page, report, dialogs, tour, on a desk, a tablet, a phone."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

import lrm_ident as lrm
from lrm_ident.report.plain_names import WORDS
from tests.support.browser import RunningWorkbench, idle, opened, press, settle, wait_for
from tests.support.commands import part_of_example, stdout_of
from tests.support.geometry import faults_of_geometry
from tests.support.sweep import in_soak

RANKED = "lrm.state.values.ranking.length > 0"
SETTLED_MS = 700
WIDTHS = (390, 1024, 1440) if in_soak() else (390, 1440)
EFFECTS = ("backlash@joint2", "cable_curve@joint1+joint2", "hysteresis@joint3", "base_curve@base")
"""Of one joint, of two, of a direction, of the base."""

SKETCHES = """(kinds) => {
  const box = document.body.appendChild(document.createElement("div")), hidden = [];
  const along = (path) => Array.from({ length: 41 }, (_, k) => path.getPointAtLength(k * path.getTotalLength() / 40));
  const apart = (p, q) => Math.hypot(p.x - q.x, p.y - q.y);
  for (const kind of kinds) {
    box.innerHTML = lrmSketch(kind);
    const of = (name) => [...box.querySelectorAll(name)], wrong = of(".wrong"), filled = of("circle");
    const covered = (p) => filled.some((one) =>
      apart(p, { x: one.cx.baseVal.value, y: one.cy.baseVal.value }) < one.r.baseVal.value);
    const seen = wrong.filter((path) => along(path).some((p) => !covered(p)));
    if (!wrong.length || seen.length < wrong.length) hidden.push(`${kind}: what is wrong is covered`);
    const lines = wrong.flatMap(along);
    for (const path of of(".dashed")) {
      if (Math.max(...along(path).map((p) => Math.min(...lines.map((q) => apart(p, q))))) < 6) {
        hidden.push(`${kind}: as it should be, and as it is, look alike`);
      }
    }
  }
  box.remove();
  return hidden;
}"""
SKETCH_KINDS = sorted({kind for row in WORDS.values() if (kind := row.get("sketch", ""))})
"""Of every sketch: whether what is wrong in it is seen, and beside what should be."""
COLOURS_OF_STEPS = """[...document.querySelectorAll('.lrm-card-of-step')].map((card, k) => {
  const bar = document.querySelector(`.lrm-fall-row:has([data-step="${k + 1}"])`);
  return [getComputedStyle(card).borderLeftColor, getComputedStyle(bar).color];
})"""
PRINTED = """(() => {
  const seen = [...document.querySelectorAll(".lrm-fold > summary h2")].filter((one) => one.checkVisibility());
  const bar = getComputedStyle(document.querySelector(".lrm-bar"));
  const kept = [...seen.map((one) => one.parentElement), document.getElementById("lrm-effect-note")];
  return [seen.length, bar.printColorAdjust, kept.every((one) => getComputedStyle(one).breakAfter === "avoid")];
})()"""
NO_WIDER = "document.documentElement.scrollWidth <= innerWidth"
FIELD = "(({ clientWidth, clientHeight }) => [clientWidth, clientHeight])(lrm.scenes.field.canvas)"
TITLE = """(() => {
  const [title, canvas] = [".lrm-scene-title", "canvas"].map((one) => document.querySelector("#lrm-field " + one));
  return [title.textContent, canvas.getBoundingClientRect().right - title.getBoundingClientRect().right];
})()"""
"""Title of the scene, and the px beside it."""
FILLED = """(() => {
  const { content, canvas } = lrm.scenes.field, [low, high] = content.box;
  const size = [canvas.clientWidth, canvas.clientHeight];
  const at = lrmScene.projection(content.box, ...size), ends = [0, 1, 2, 3, 4, 5, 6, 7].map((corner) =>
    at(low.map((l, k) => (corner >> k & 1 ? high[k] : l))));
  return [0, 1].flatMap((k) => [Math.min, Math.max].map((of) => of(...ends.map((end) => end[k])) / size[k]));
})()"""
"""Where the box of the scene begins and ends: parts of the width of its canvas, and of the height."""
LEGEND = "[...document.querySelectorAll('#lrm-card-1 .legendtext')].map((one) => one.textContent)"
LONGEST = "[...lrm.state.values.ranking].sort((a, b) => b.title.length - a.title.length)[0].name"
HINTS = "[...document.querySelectorAll('.lrm-menu-list [data-name] .q-btn__content div')].map((one) => one.innerText)"
OPACITY = "getComputedStyle(document.querySelector('.lrm-tour')).opacity"
PLACES = """(() => {
  const [head, framed, card] = ["header.lrm-head", ".lrm-toured", ".lrm-tour"].map((one) =>
    document.querySelector(one).getBoundingClientRect());
  return [head.bottom, framed.top, card.top];
})()"""
"""px where the head ends, what the tour frames begins, its card begins."""


STEPS = [
    ["1.", "Add it:", ["lrm-ident add /home/rover/arms/model.toml /home/rover/arms/data.csv mass@link5"]],
    ["or:", "poses:", ["lrm-ident design --separate eccentricity@joint4,base_curve@base,cable_spring@joint4"]],
    ["or, without new poses:", "give the arm the model:", ["lrm deploy /home/rover/arms/model.toml"]],
]
"""What to do next, as `figure_values` gives it: number or lead, words, commands."""
BREAKS = """[...document.querySelectorAll("#lrm-next code span")].flatMap((word) => {
  const signs = [...word.childNodes].filter((one) => one.nodeType === Node.TEXT_NODE).flatMap((text) =>
    [...text.data].map((sign, k) => {
      const range = document.createRange();
      range.setStart(text, k);
      range.setEnd(text, k + 1);
      return { sign, top: range.getBoundingClientRect().top };
    }));
  return signs.slice(1).flatMap((one, k) => (one.top > signs[k].top + 2 ? [signs[k].sign] : []));
})"""
"""The last sign of each line within a word of a command."""


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A report of a model with four effects."""
    folder = tmp_path_factory.mktemp("report")
    data = part_of_example(folder)
    study = lrm.Study.of(lrm.load(data)).fit()
    screened = study.screen()  # for all steps: a screening before each is half of the time
    for effect in EFFECTS:
        study = study.add(effect, screened)
    study.save(folder / "m.toml")
    stdout_of("report", folder / "m.toml", data, "-o", folder / "r.html")
    return folder / "r.html"


@pytest.mark.slow
def test_a_report_of_four_steps_at_every_width(browser: Any, report: Path) -> None:
    """The axis is that of the effect's law, before and after are seen to differ, every step has a sketch."""
    page = browser.new_context(viewport={"width": 1440, "height": 844}, color_scheme="light").new_page()
    page.goto(report.as_uri())
    page.wait_for_selector("#lrm-card-1 .main-svg")
    assert page.is_visible("#panel-turn") == page.evaluate("lrm.state.values.fails")
    page.set_viewport_size({"width": 500, "height": 844})  # a window that is made narrower, a phone that is turned
    settle(page, SETTLED_MS)
    assert faults_of_geometry(page) == [], "resized"
    for width in WIDTHS:
        page.set_viewport_size({"width": width, "height": 844})
        page.goto(report.as_uri())
        page.wait_for_selector("#lrm-card-4 .main-svg", state="attached")
        settle(page, SETTLED_MS)
        assert faults_of_geometry(page) == [], width
        assert page.evaluate(NO_WIDER), width
        title, beside = page.evaluate(TITLE)
        assert "mm" in title, width
        assert beside > 55, "the scale of colours has its own room"
        left, right, top, bottom = page.evaluate(FILLED)
        assert min(left, 1 - right, top, 1 - bottom) >= 0, "nothing is cut"
        assert min(right - left, bottom - top) > 0.7, "the scene fills its card, whatever the arm"
        assert page.evaluate(LEGEND) == ["before", "after", "mean before", "mean after"]
        if width == min(WIDTHS):
            bottom = "document.querySelector('{}').getBoundingClientRect()"
            assert page.evaluate(f"{bottom.format('#lrm-verdict')}.bottom < innerHeight / 2"), "the sentence is seen"
            assert page.evaluate(f"{bottom.format('#lrm-field canvas')}.top < 0.75 * innerHeight"), "the arm is seen"
    drivers = dict(page.evaluate("lrm.state.values.cards.map((one) => [one.name, one.driver])"))
    assert drivers["backlash@joint2"] == "torque of joint 2"
    assert drivers["hysteresis@joint3"] == "last motion of joint 3"
    assert drivers["cable_curve@joint1+joint2"] in ("angle of joint 1", "angle of joint 2")
    assert len(page.query_selector_all(".lrm-card-of-step .lrm-sketch svg")) == len(EFFECTS)
    assert page.evaluate(SKETCHES, SKETCH_KINDS) == []
    for card, bar in page.evaluate(COLOURS_OF_STEPS):
        assert card == bar, "a card has the colour of its step"
    page.evaluate("(next) => lrm.show({ ...lrm.state.values, next })", STEPS)
    for width in WIDTHS:
        page.set_viewport_size({"width": width, "height": 844})
        settle(page, SETTLED_MS)
        assert set(page.evaluate(BREAKS)) <= {",", "/"}, "a name is broken in two"
        assert re.findall(r"\S+ ?or\b.*:", page.inner_text("#lrm-next")) == [], "every step begins a line"
    page.evaluate("lrm.theme('dark')")
    assert page.evaluate("getComputedStyle(document.getElementById('lrm-what-if-size')).colorScheme") == "dark"
    page.evaluate("lrm.theme('light')")
    page.emulate_media(media="print")
    page.evaluate("lrm.print(true)")
    assert page.evaluate(PRINTED) == [5, "exact", True], "tables keep their headings, bars are printed"
    page.evaluate("lrm.print(false)")
    page.emulate_media(media="screen")
    assert page.inner_text("#lrm-fall").startswith("nominal "), "never the last, smallest step"
    assert page.evaluate("lrm.state.beside") == 0
    for words in ("measured minus predicted", "Solid arm: the model", "Outline and dashed line: the nominal arm"):
        assert words in page.inner_text("#lrm-scale"), "the picture says what it shows"
    captions = page.evaluate("[...document.querySelectorAll('.lrm-numbers caption')].map((one) => one.textContent)")
    assert len({*captions}) == len(captions), "no table stands twice"
    assert page.inner_text("#lrm-verdict") not in (page.text_content(".lrm-numbers") or ""), "the verdict stands above"
    page.context.close()


@pytest.mark.slow
def test_tour_dialogs_and_what_if_on_a_desk_and_a_phone(browser: Any, small: RunningWorkbench) -> None:
    for width in (1440, 390):
        page = opened(browser, small, {"width": width, "height": 844})
        idle(page, RANKED)
        settle(page, SETTLED_MS)
        assert faults_of_geometry(page) == [], width
        assert page.evaluate(NO_WIDER), width
        assert min(page.evaluate(FIELD)) > 240, "the field is squeezed"
        first = page.evaluate("lrm.state.candidate")
        page.evaluate(f"lrm.choose({LONGEST})")
        settle(page, SETTLED_MS)
        assert faults_of_geometry(page) == [], "an effect with a long name"
        page.evaluate(f"lrm.choose('{first}')")
        page.click("#lrm-menu summary")
        hints = page.evaluate(HINTS)
        assert len(hints) == 14
        assert all(hints), "where nothing can be pointed at, too"
        page.keyboard.press("Escape")
        press(page, "tour")
        for _ in range(6):
            settle(page, 200)
            head, top, card = page.evaluate(PLACES)
            assert head > 0, "the head stays"
            assert top < card, "what is framed is seen beside the card"
            assert page.evaluate(OPACITY) == "1", "nothing shines through the card"
            page.click("[data-name=next]")
        for name, dialog in (("save…", "#lrm-save"), ("commands", "#lrm-done"), ("live…", "#lrm-live")):
            press(page, name)
            page.wait_for_selector(dialog)
            settle(page, SETTLED_MS)
            box = page.evaluate(f"(({{ left, right }}) => [left, right])"
                                f"(document.querySelector('{dialog}').getBoundingClientRect())")  # fmt: skip
            assert box[0] >= 0, name
            assert box[1] <= width, name
            page.keyboard.press("Escape")
            page.wait_for_selector(dialog, state="hidden")
        form = "lrm.state.values.ranking[0].form.find((y) => y !== null)"
        trace = "document.getElementById('lrm-form').data?.find((t) => t.name.startsWith('its form'))"
        shown = f"{trace}.y.find((y) => y !== null)"
        wait_for(page, shown)
        page.locator("#lrm-what-if-size").press("End")
        wait_for(page, f"Math.abs({shown} - 2 * {form}) < 1e-6")
        assert "estimate" in page.inner_text("#lrm-what-if")
        page.context.close()
