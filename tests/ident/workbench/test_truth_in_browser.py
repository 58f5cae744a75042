"""Promises of the page: each number with its data, nothing moves away, nothing is lost."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

import lrm_ident as lrm
from tests.conftest import EXAMPLE
from tests.support.browser import (
    BrowserLog,
    RunningWorkbench,
    idle,
    opened,
    press,
    says,
    settle,
    shot,
    wait_for,
    workbench,
)
from tests.support.commands import FEW, part_of_example, stdout_of
from tests.support.sweep import soak

SIZE = {"width": 1280, "height": 800}
STORED_MS = 1000  # the browser stores what a page says in another process
TWO_STEPS, RANKED = "lrm.state.values.steps.length === 2", "lrm.state.values.ranking.length > 0"
LINES = """[...document.querySelectorAll('.js-plotly-plot')].flatMap((figure) => figure.data.filter((trace) =>
  trace.mode.includes('lines')).map((trace) => [...trace.x]))"""
"""The abscissae of every line that is drawn."""
BOXES = """Object.fromEntries([...document.querySelectorAll('.lrm-primary')].map((one) => {
  const box = one.getBoundingClientRect();
  return ['advised', [box.left, box.top, box.width, box.height].map(Math.round)];
}))"""
"""Where the advised button is."""

COLOUR = "getComputedStyle(document.querySelector('#lrm-stale' + one)).color"


def breaks_where_data_differ(page: Any) -> None:
    """Asserts that the waterfall joins no errors of different data, and says which step was fitted to others."""
    here, held_out = page.evaluate("[lrm.state.values.steps.map((one) => one.here), lrm.state.values.story.held_out]")
    assert all(here) or not held_out, "held-out errors of different data"
    rows = page.eval_on_selector_all(".lrm-fall-row button", "(all) => all.map((one) => one.innerText)")
    assert ["fitted to other data" not in words for words in rows] == here


@pytest.mark.slow
def test_every_error_carries_its_data_and_a_changed_file_is_told(browser: Any, tmp_path: Path) -> None:
    few = part_of_example(tmp_path, 100)
    stdout_of("fit", few, "-o", tmp_path / "m.toml")
    data = few.rename(tmp_path / "data.csv").resolve()
    few.with_suffix(".toml").rename(tmp_path / "data.toml")
    rows = EXAMPLE.read_text().splitlines(keepends=True)
    data.write_text("".join(rows[:151]))
    with workbench(tmp_path / "m.toml", data, cwd=tmp_path) as running:
        page = opened(browser, running, SIZE)
        idle(page, RANKED)
        first = page.evaluate("lrm.state.values.steps[0]")
        assert not first["here"]
        assert page.evaluate("lrm.state.values.story.steps[1].rms_mm.toFixed(2)") == first["rms"]
        breaks_where_data_differ(page)
        page.click("[data-name=add]")
        wait_for(page, TWO_STEPS)
        settle(page, 500)
        breaks_where_data_differ(page)
        idle(page, RANKED)
        data.write_text("".join(rows[:121]))
        page.wait_for_selector("#lrm-stale")
        inks = page.evaluate(f"['', ' .q-btn'].map((one) => {COLOUR})")
        assert len({*inks}) == 1, "the blue of a button has too little contrast on a notice in the dark"
        press(page, "auto")
        says(page, "body", "press Reload or Keep first")
        shot(page, "changed-on-disk.png")
        page.click("[data-name=reload]")
        wait_for(page, "lrm.state.values.poses === 120")
        page.wait_for_selector("#lrm-stale", state="hidden")
        breaks_where_data_differ(page)
        idle(page, RANKED)
        data.write_text("".join(rows[:80]))
        page.wait_for_selector("#lrm-stale")
        page.click("[data-name=keep]")
        page.wait_for_selector("#lrm-stale", state="hidden")
        page.keyboard.press("c")
        says(page, "#lrm-commands", "lrm-ident add")
        assert page.evaluate("lrm.state.values.poses") == 120
        page.context.close()


@pytest.mark.slow
def test_the_list_says_what_it_shows_and_the_second_quantity_of_a_form_is_its_colour(
    browser: Any, small: RunningWorkbench
) -> None:
    page = opened(browser, small, SIZE)
    idle(page, RANKED)
    says_what_it_shows(page)
    settle(page, 1000)
    for x in page.evaluate(LINES):
        known = [one for one in x if one is not None]
        assert all(a < b for a, b in pairwise(known)), "a line joins points of equal x"
    page.evaluate("""(() => {
      const values = structuredClone(lrm.state.values), one = values.ranking[0];
      one.second = values.drivers.find((d) => d.name !== one.driver).name;
      lrm.show(values);
    })()""")
    wait_for(page, "document.getElementById('lrm-form').data[0].marker.showscale")
    traces = page.evaluate("document.getElementById('lrm-form').data.map((t) => [t.name, t.mode, t.marker.color])")
    second = page.evaluate("((v) => v.drivers.find((d) => d.name === v.ranking[0].second).values)(lrm.state.values)")
    assert traces == [["data", "markers", second], ["its form", "markers", second]]
    shot(page, "map.png")
    page.context.close()


def says_what_it_shows(page: Any) -> None:
    """Asserts that the list of candidates stands in its order under its head, with marks that are explained."""
    assert "held-out RMS left, mm" in page.inner_text("#lrm-ranking-head")
    shown = page.evaluate("lrm.state.values.ranking.map((one) => [one.name, one.standing, one.heldOut, one.mark])")
    for _, _, _, mark in shown:
        assert mark in page.inner_text("#lrm-ranking-head")
    least = shown[0][2]
    assert all(held > 1.05 * least for _, standing, held, _ in shown if standing == "no evidence")
    for standing in {one[1] for one in shown} - {"identified cause"}:
        held = [one[2] for one in shown if one[1] == standing]
        assert held == sorted(held)
    assert page.evaluate("document.querySelector('#lrm-ranking-head abbr').title")
    assert "backlash in joint 2" in page.inner_text("#lrm-ranking .lrm-candidate")


@pytest.mark.slow
def test_buttons_stay_the_verdict_is_of_the_step_shown_and_redo_gives_back(
    browser: Any, small: RunningWorkbench
) -> None:
    seen = BrowserLog()
    page = opened(browser, small, SIZE, seen)
    boxes = page.evaluate(BOXES)
    idle(page, RANKED)
    assert page.inner_text("[data-name=add]").split("\n") == ["Add: backlash in joint 2", "backlash@joint2"]
    before = page.evaluate("lrm.state.values.story.steps[1].rms_mm")
    x, y = boxes["advised"][0] + 20, boxes["advised"][1] + 10
    under = f"document.elementFromPoint({x}, {y}).closest('.lrm-primary') !== null"
    page.mouse.click(x, y)
    while not page.evaluate(f"{TWO_STEPS} && {RANKED}"):
        assert page.evaluate(BOXES) == boxes
        assert page.evaluate(under)
        settle(page, 100)
    idle(page, RANKED)
    assert page.evaluate(BOXES) == boxes
    after = page.evaluate("lrm.state.values.story.steps[2].rms_mm")
    fall = page.inner_text("#lrm-fall").replace("\xa0", " ")
    assert re.search(
        rf"^nominal .* {before:.2f} → with backlash in joint 2: {after:.2f} mm RMS at poses not in the fit$", fall
    ), fall
    last = page.inner_text("#lrm-verdict")
    page.click("#lrm-look > summary")
    page.select_option("#lrm-step", "0")
    assert last not in page.inner_text("#lrm-verdict")
    assert "Missing from the model: backlash in joint 2" in page.inner_text("#lrm-verdict")
    assert "Shown: step 0" in page.inner_text("#lrm-fall")
    drawn = "document.querySelector('#lrm-card-1 .legend')"
    wait_for(page, drawn)
    card = page.inner_text(".lrm-card-of-step").replace("\xa0", " ")
    for words in ("Backlash in joint 2", f"{before:.2f} → {after:.2f} mm", "torque_curve@joint2", "the noise", "°"):
        assert words in card
    wait_for(page, "document.querySelector('#lrm-card-1').data?.length === 4")
    page.keyboard.press("u")
    wait_for(page, "lrm.state.values.steps.length === 1")
    press(page, "redo")
    wait_for(page, TWO_STEPS)
    assert page.evaluate("lrm.state.values.story.steps[2].rms_mm") == after
    wait_for(page, drawn)
    assert page.inner_text(".lrm-card-of-step").replace("\xa0", " ") == card
    two = "".join(EXAMPLE.read_text().splitlines(keepends=True)[:3])
    page.evaluate("(text) => lrmOpen([new File([text], 'two.csv')])", two)
    says(page, "#lrm-failure", "2 poses for")
    assert page.evaluate(f"{TWO_STEPS} && lrm.state.values.poses === {FEW}")
    page.keyboard.press("u")
    wait_for(page, "lrm.state.values.steps.length === 1")
    page.context.close()
    assert [one for one in seen.errors if "400" not in one] == []


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A report of a fit and a step."""
    folder = tmp_path_factory.mktemp("report")
    data = part_of_example(folder)
    lrm.Study.of(lrm.load(data)).fit().add("backlash@joint2").save(folder / "m.toml")
    stdout_of("report", folder / "m.toml", data, "-o", folder / "r.html")
    return folder / "r.html"


@pytest.mark.slow
def test_the_report_on_paper_and_its_theme(browser: Any, report: Path) -> None:
    """Charts are as wide as the page and no part lies over another; the cards come first. Its theme is remembered."""
    page = browser.new_context(viewport=SIZE, color_scheme="dark").new_page()
    page.goto(report.as_uri())
    wait_for(page, "document.querySelector('#lrm-card-1 .main-svg')")
    assert "nominal" in page.inner_text("#lrm-fall")
    shot(page, "paper.pdf")
    page.emulate_media(media="print")
    page.evaluate("lrm.print(true)")
    top = "document.querySelector('{}').getBoundingClientRect().top"
    assert page.evaluate(f"{top.format('.lrm-card-of-step')} < {top.format('#lrm-field')}"), "the cards come first"
    wide, right = page.evaluate("[document.body.clientWidth, document.body.getBoundingClientRect().right]")
    for svg in page.evaluate("[...document.querySelectorAll('.main-svg')].map((s) => s.getBoundingClientRect().width)"):
        assert svg <= wide
    parts = "[...document.querySelectorAll('table, .js-plotly-plot, canvas, h2, h3')].map((one) => "
    parts += "one.getBoundingClientRect()).filter((box) => box.height)"
    boxes = page.evaluate(f"{parts}.map((box) => [box.top, box.bottom, box.left, box.right])")
    for i, one in enumerate(boxes):
        assert one[3] <= right + 1, "a part is cut at the right"
        for two in boxes[i + 1 :]:
            apart = one[1] <= two[0] + 1 or two[1] <= one[0] + 1 or one[3] <= two[2] + 1 or two[3] <= one[2] + 1
            assert apart, "two parts lie over one another on paper"
    page.evaluate("lrm.print(false)")
    page.emulate_media(media="screen")
    assert page.evaluate("document.documentElement.dataset.theme") == "dark"
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(13, 17, 23)"
    page.click("#lrm-theme")
    wait_for(page, "document.documentElement.dataset.theme === 'light'")
    settle(page, STORED_MS)
    page.reload()
    assert page.evaluate("document.documentElement.dataset.theme") == "light", "the theme is not remembered"
    page.context.close()


TEN = (
    "backlash@joint2",
    "cable_curve@joint1+joint2",
    "base_curve@base",
    *(f"eccentricity@joint{k}" for k in range(1, 7)),
)
"""Effects that make a history of ten steps with the fit, some with many coefficients."""
PAGE_MM, MARGIN_MM, MM_PER_PX = 297.0, 14.0, 25.4 / 96.0


@pytest.mark.slow
def test_of_ten_steps_the_first_card_is_on_page_one(browser: Any, tmp_path: Path, monkeypatch: Any) -> None:
    """All that stands above it fits with it on one page; and no card is more than half of one.

    With files in the working folder: commands on the page name files as they were given, and long paths wrap.
    """
    monkeypatch.chdir(tmp_path)
    data = part_of_example(tmp_path).relative_to(tmp_path)
    study = lrm.Study.of(lrm.load(data)).fit()
    screened = study.screen()  # for all steps: a screening before each is half of the time
    for effect in TEN:
        study = study.add(effect, screened)
    study.save(Path("m.toml"))
    stdout_of("report", "m.toml", data, "-o", "r.html")
    page = browser.new_context(viewport=SIZE).new_page()
    page.goto((tmp_path / "r.html").as_uri())
    page.wait_for_selector("#lrm-card-9 .main-svg", state="attached")
    assert page.evaluate("lrm.state.values.steps.length") == 10
    shot(page, "ten-steps.pdf")
    page.emulate_media(media="print")
    page.evaluate("lrm.print(true)")
    cards = "[...document.querySelectorAll('.lrm-card-of-step')].map((one) => one.getBoundingClientRect())"
    tops, heights = page.evaluate(f"[{cards}.map((box) => box.top + scrollY), {cards}.map((box) => box.height)]")
    room = (PAGE_MM - 2 * MARGIN_MM) / MM_PER_PX
    assert tops[0] + heights[0] <= room
    assert max(heights) <= 0.5 * room
    assert page.evaluate("getComputedStyle(document.querySelector('.lrm-card-of-step')).breakInside") == "avoid"
    assert page.evaluate("[...document.querySelectorAll('.new-page')].every((one) => !one.querySelector('#lrm-cards'))")
    page.context.close()


@pytest.mark.slow
def test_a_session_outlasts_its_server(browser: Any, tmp_path: Path) -> None:
    data = part_of_example(tmp_path)
    with workbench(data, cwd=tmp_path) as first:
        assert first.folder.is_relative_to(tmp_path / "state")
        page = opened(browser, first, SIZE)
        idle(page, RANKED)
        page.click("[data-name=add]")
        wait_for(page, TWO_STEPS)
        first.stop()
        wait_for(page, "!document.getElementById('lrm-banner').hidden")
        assert f"lrm-ident workbench {first.folder / 'step-1.toml'} {data}" in page.inner_text("#lrm-banner")
        page.context.close()
    with workbench(data, cwd=tmp_path) as second:
        page = opened(browser, second, SIZE)
        says(page, "#lrm-offer", "step-1.toml")
        page.click('[data-name="go on"]')
        wait_for(page, TWO_STEPS)
        page.wait_for_selector("#lrm-offer", state="hidden")
        page.context.close()


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["dark", *soak("light")])
def test_the_page_on_a_phone_and_for_a_screen_reader(browser: Any, small: RunningWorkbench, scheme: str) -> None:
    page = opened(browser, small, {"width": 390, "height": 844}, scheme=scheme)
    idle(page, RANKED)
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    seen = "[...document.querySelectorAll('button, select, input')].filter((one) => one.checkVisibility())"
    sizes = page.evaluate(f"{seen}.map((one) => [one.dataset.name || one.id, one.getBoundingClientRect().height])")
    assert [name for name, height in sizes if height and height < 44] == []
    assert page.evaluate("document.documentElement.lang") == "en"
    assert page.evaluate("[document.querySelectorAll('main').length, document.querySelectorAll('h1').length]") == [1, 1]
    press(page, "light or dark")
    wait_for(page, f"document.documentElement.dataset.theme && document.documentElement.dataset.theme !== '{scheme}'")
    turned = page.evaluate("document.documentElement.dataset.theme")
    page.reload()
    wait_for(page, "window.lrm && lrm.state.values")
    assert page.evaluate("document.documentElement.dataset.theme") == turned, "the theme is not remembered"
    shot(page, f"phone-{turned}.png", full_page=True)
    page.context.close()


@pytest.mark.slow
def test_a_study_draws_itself_in_a_notebook(browser: Any, tmp_path: Path) -> None:
    """In a frame, as Jupyter and marimo put it into their pages."""
    study = lrm.Study.of(lrm.load(part_of_example(tmp_path))).fit()
    page = browser.new_page(viewport=SIZE, color_scheme="null")  # the frame's colours are those of the notebook
    page.set_content(f"<!doctype html><body data-jp-theme-light=false>{study.view()._repr_html_()}")
    inside = page.frame_locator("iframe")
    inside.locator("html[data-theme=dark] #lrm-field canvas").wait_for()
    page.evaluate("document.body.dataset.jpThemeLight = true")
    inside.locator("html[data-theme=light] #lrm-field canvas").wait_for()
    assert "backlash" in inside.locator("#lrm-ranking").inner_text()
    shot(page, "notebook.png")
    own = "<style>:not(.jp-RenderedMarkdown).jp-RenderedHTMLCommon td { text-align: center }</style>"
    shown = f"<div class=jp-RenderedHTMLCommon>{study._repr_html_()}{study.compare()._repr_html_()}</div>"
    page.set_content(f"<!doctype html><body>{own}{shown}")
    side = "(all) => [...new Set(all.map((one) => getComputedStyle(one).textAlign))]"
    assert page.eval_on_selector_all("td.right", side) == ["right"], "numbers are not under one another"
    assert page.eval_on_selector_all("td:not(.right)", side) == ["left"]
    assert page.eval_on_selector("img", "(one) => one.naturalWidth") > 500
    page.close()
