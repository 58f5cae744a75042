"""The workbench and the report in a real browser, as a person uses them."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

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
    unfold,
    wait_for,
    workbench,
)
from tests.support.commands import part_of_example, stdout_of

SIZE, SMALL_SIZE = {"width": 1366, "height": 768}, {"width": 800, "height": 600}
"""Of the screen; the scene is drawn without a graphics card, and a small one costs less."""
ONE_STEP, TWO_STEPS = "lrm.state.values.steps.length === 1", "lrm.state.values.steps.length === 2"
RANKED = "lrm.state.values.ranking.length > 0"
ARROWS = "Math.max(...lrm.state.values.steps[lrm.state.step].residual.map((r) => Math.hypot(...r)))"

LONELY_DOT = """(() => {
  const { dots, canvas } = lrm.scenes.field, frame = canvas.getBoundingClientRect();
  const apart = (p, q) => p === q ? Infinity : Math.hypot(p[0] - q[0], p[1] - q[1]);
  const space = dots.map((p) => Math.min(...dots.map((q) => apart(p, q))));
  const row = space.indexOf(Math.max(...space));
  return [row, frame.left + dots[row][0], frame.top + dots[row][1]];
})()"""
"""The dot of the error field that is farthest from its neighbours: its row, and where it is on the screen."""


@pytest.fixture(scope="module")
def running(browser: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningWorkbench]:
    """A workbench on the shipped data set, started only where there is a browser."""
    assert browser
    with workbench(cwd=tmp_path_factory.mktemp("shipped")) as found:
        yield found


@pytest.fixture(scope="module")
def part(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A part of the shipped data set, in a folder of its own."""
    return part_of_example(tmp_path_factory.mktemp("own"))


@pytest.fixture(scope="module")
def small(browser: Any, part: Path) -> Iterator[RunningWorkbench]:
    """A workbench on the part, in which a test leaves a step, and the last one stops it."""
    assert browser
    with workbench(part, cwd=part.parent) as found:
        yield found


@pytest.mark.slow
def test_from_the_shipped_data_to_nothing_missing(browser: Any, running: RunningWorkbench) -> None:
    seen = BrowserLog()
    page = opened(browser, running, SIZE, seen)
    assert "1 of 6" in page.inner_text(".lrm-tour")
    for _ in range(6):
        page.click("[data-name=next]")
    page.wait_for_selector(".lrm-tour", state="hidden")
    idle(page, RANKED)
    first = page.inner_text(".lrm-candidate:has(:checked)")
    assert "backlash@joint2" in first
    assert "Missing from the model: backlash in joint 2" in page.inner_text("#lrm-verdict")
    shot(page, "before.png")
    arrows, history = page.evaluate(ARROWS), page.evaluate("lrm.state.values.story.steps[1].rms_mm")
    page.click("[data-name=add]")
    wait_for(page, TWO_STEPS)
    assert page.evaluate("lrm.state.values.story.steps[2].rms_mm") < 0.3 * history
    assert page.evaluate(ARROWS) < 0.3 * arrows
    idle(page, RANKED)
    assert "no further systematic error is seen" in page.inner_text("#lrm-verdict")
    shot(page, "after.png")
    unfold(page)
    page.select_option("#lrm-beside", "0")
    settle(page, 1500)
    shot(page, "side-by-side.png")
    page.select_option("#lrm-beside", "")
    page.keyboard.press("u")
    wait_for(page, ONE_STEP)
    assert page.evaluate(ARROWS) == pytest.approx(arrows)
    with page.context.expect_page() as other:
        press(page, "report")
    report = other.value
    seen.listen(report)
    report.wait_for_selector("#lrm-field canvas")
    assert "Missing from the model: backlash in joint 2" in report.inner_text("#lrm-verdict")
    report.pdf()  # it draws what is folded
    for figure in ("turn", "form", "added"):
        assert report.query_selector(f"#lrm-{figure} .main-svg"), f"{figure} is not on paper"
    page.context.close()
    assert not seen.errors, seen.errors
    assert not seen.foreign(running.origin)


@pytest.mark.slow
def test_pages_of_other_shapes(browser: Any, running: RunningWorkbench) -> None:
    """Dark, with the keyboard alone; poses that are marked in one view are marked in all; on a tablet."""
    dark = opened(browser, running, SIZE, scheme="dark")
    wait_for(dark, RANKED)
    settle(dark, 1500)
    shot(dark, "dark.png")
    assert dark.evaluate("document.documentElement.dataset.theme") == "dark"
    fits = "document.documentElement.scrollWidth <= innerWidth && "
    fits += "[...document.querySelectorAll('.lrm-head [data-name]')].every("
    fits += "(one) => { const r = one.getBoundingClientRect(); return r.bottom <= innerHeight || !r.height; })"
    assert dark.evaluate(fits), "buttons are off the screen, or the page is wider than it"
    dark.focus(".lrm-candidate input")
    dark.keyboard.press("ArrowDown")
    dark.keyboard.press("ArrowDown")
    chosen = dark.evaluate("lrm.state.candidate")
    says(dark, "[data-name=add]", chosen)
    dark.evaluate("scrollTo(0, 0)")
    row, x, y = dark.evaluate(LONELY_DOT)
    dark.mouse.move(x, y)
    wait_for(dark, f"lrm.state.pose === lrm.state.values.pose[{row}]")
    dark.focus("#lrm-field canvas")
    before = dark.evaluate(f"lrm.scenes.field.dots[{row}][0]")
    dark.keyboard.press("ArrowLeft")
    wait_for(dark, f"Math.abs(lrm.scenes.field.dots[{row}][0] - {before}) > 1")
    dark.evaluate("lrm.brush(new Set([3, 7]))")
    rows = dark.evaluate("[3, 7].map((pose) => lrm.state.values.pose.indexOf(pose))")
    for figure in ("turn", "form", "added"):
        marked = f"document.getElementById('lrm-{figure}').data[0].selectedpoints"
        wait_for(dark, f"JSON.stringify({marked}) === JSON.stringify({rows})")
    assert dark.evaluate("[...lrm.scenes.field.content.marked]") == rows
    dark.context.close()
    tablet = opened(browser, running, {"width": 820, "height": 1180})
    settle(tablet, 1500)
    assert "another tab" not in tablet.inner_text("#lrm-failure")
    assert tablet.evaluate("document.documentElement.scrollWidth <= innerWidth")
    shot(tablet, "tablet.png")
    tablet.context.close()


@pytest.mark.slow
def test_same_numbers_everywhere(browser: Any, small: RunningWorkbench, part: Path, tmp_path: Path) -> None:
    """Numbers of the first fit: the page, the report, the JSON files and the printed tables."""
    data = part
    page = opened(browser, small, SMALL_SIZE)
    wait_for(page, RANKED)
    wait_for(page, "document.querySelector('.lrm-numbers').textContent.includes('Not testable')")
    unfold(page)
    on_page = page.inner_text(".lrm-told") + page.inner_text(".lrm-numbers")
    ranked = dict(page.evaluate("lrm.state.values.ranking.map((one) => [one.name, one.heldOut])"))
    page.context.close()
    model = tmp_path / "model.toml"
    model.write_bytes((small.folder / "step-0.toml").read_bytes())
    files = {name: tmp_path / f"{name}.json" for name in ("compare", "diagnose", "report")}
    printed = stdout_of("compare", model, data, "--json", files["compare"], "--all")
    printed += stdout_of("diagnose", model, data, "--json", files["diagnose"], "--all")
    stdout_of("report", model, data, "-o", tmp_path / "r.html", "--json", files["report"])
    read = {name: json.loads(path.read_text()) for name, path in files.items()}
    html = (tmp_path / "r.html").read_text()
    inside = re.search(r'id="lrm-result">(.*?)</script>', html, re.S)
    assert inside is not None
    assert json.loads(inside[1]) == read["report"]
    for name, part in (("compare", "comparison"), ("diagnose", "diagnosis")):
        own = {key: value for key, value in read[name].items() if key != "schema"}
        for conclusion in (one["conclusion"] for one in (own, read["report"][part]) if "conclusion" in one):
            del conclusion["next"]  # the command knows the files, the page does not
        assert own == read["report"][part]
    for advice in read["diagnose"]["ranking"]:
        name = f"{advice['effect']}@{advice['place']}"
        assert ranked.get(name, advice["held_out_rms_mm"]) == pytest.approx(advice["held_out_rms_mm"], rel=1e-9)
    shown = [line.split("(Moran's I) ")[1] for line in printed.splitlines() if "Moran's I" in line]
    errors = read["compare"]["error"]
    shown += [f"{errors[kind][key]:.2f}" for kind in ("fit", "held_out") for key in ("mean_mm", "rms_mm", "max_mm")]
    shown += [read["diagnose"]["ranking"][0]["why"], read["diagnose"]["conclusion"]["headline"]]
    text = re.sub(r"<[^>]+>", " ", html.split('id="lrm-values"')[0]).replace("&#x27;", "'").replace("&gt;", ">")
    for number in shown:
        assert number in " ".join(printed.split()), number
        assert number in " ".join(on_page.split()), number
        assert number in " ".join(text.split()), number


@pytest.mark.slow
def test_auto_is_cancelled_and_a_law_is_proposed(browser: Any, small: RunningWorkbench) -> None:
    page = opened(browser, small, SMALL_SIZE)
    idle(page, RANKED)
    press(page, "auto")
    says(page, "#lrm-work", "auto")
    page.click("[data-name=cancel]")
    says(page, "#lrm-failure", "cancelled")
    assert page.evaluate(ONE_STEP)
    press(page, "propose a formula")
    says(page, "#lrm-work", "law")
    page.wait_for_selector("#lrm-search")
    assert "formulas were tried" in page.inner_text("#lrm-search")
    shot(page, "law.png")
    page.click("[data-name=close-search]")
    page.context.close()


@pytest.mark.slow
def test_second_tab_bad_files_and_a_tab_closed_in_the_middle(
    browser: Any, small: RunningWorkbench, tmp_path: Path
) -> None:
    (tmp_path / "bad.csv").write_text("pose,q1_deg\n1,nonsense\n")
    other = tmp_path / "other.toml"
    other.write_text('schema = "lrm/model/1"\narm = "two-joint"\neffects = ["offsets"]\n[parameters]\n')
    page = opened(browser, small, SMALL_SIZE)
    second = page.context.new_page()
    second.goto(small.address)
    says(second, "body", "open in another tab")
    for path in (tmp_path / "bad.csv", other):
        page.evaluate(
            "([name, text]) => lrmOpen([new File([text], name)])", [path.name, path.read_text(encoding="utf-8")]
        )
        says(page, "#lrm-failure", path.stem)
        assert "dropped-" not in page.inner_text("#lrm-failure"), "the file has the name that it came with"
    assert page.evaluate("lrm.state.values.steps.length") == 1
    shot(page, "bad-file.png")
    second.close()
    idle(page, RANKED)
    page.click("[data-name=add]")
    says(page, "#lrm-work", "adding")
    page.close()  # in the middle of a fit
    again = opened(browser, small, SMALL_SIZE)
    wait_for(again, TWO_STEPS)
    again.context.close()
    assert len(list(small.folder.glob("step-*.toml"))) == 2, "the fit and the effect added"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("query", "origin", "says"),
    [("?token=wrong", None, "token"), ("", None, "token"), (None, "http://evil.example", "other pages")],
)
def test_a_wrong_token_and_a_foreign_page_are_refused(
    browser: Any, small: RunningWorkbench, query: str | None, origin: str | None, says: str
) -> None:
    context = browser.new_context(extra_http_headers={} if origin is None else {"Origin": origin})
    page = context.new_page()
    answer = page.goto(small.address if query is None else f"{small.origin}/{query}")
    assert answer.status == 403
    assert says in page.inner_text("body")
    context.close()


@pytest.mark.slow
def test_a_growing_file_is_followed_and_a_stopped_server_is_told(
    browser: Any, small: RunningWorkbench, tmp_path: Path
) -> None:
    lines = EXAMPLE.read_text().splitlines(keepends=True)
    growing = tmp_path / "growing.csv"
    growing.write_text("".join(lines[:41]))
    growing.with_suffix(".toml").write_text(EXAMPLE.with_suffix(".toml").read_text())
    page = opened(browser, small, SMALL_SIZE)
    press(page, "live…")
    page.get_by_label("Follow the file").fill(str(growing))
    page.get_by_role("button", name="Follow the file").click()
    wait_for(page, "lrm.state.values.poses === 40")
    with growing.open("a") as file:
        file.write("".join(lines[41:61]) + lines[61][:20])
    wait_for(page, "lrm.state.values.poses === 60")
    small.stop()
    wait_for(page, "!document.getElementById('lrm-banner').hidden")
    assert str(small.folder) in page.inner_text("#lrm-banner")
    shot(page, "stopped.png")
    page.context.close()
