"""The picture of the arm: views, the scrubber, the filter, and a fair sample where poses are many."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.residual.picture.error_field import MOST_DRAWN, WORST_DRAWN, rows_to_draw
from lrm_ident.residual.picture.group_means import fair_rows
from tests.conftest import EXAMPLE
from tests.support.browser import (
    BrowserLog,
    RunningWorkbench,
    idle,
    opened,
    press,
    settle,
    shot,
    unfold,
    wait_for,
    workbench,
)
from tests.support.commands import FEW, stdout_of

SIZE = {"width": 1440, "height": 900}
RANKED = "lrm.state.values.ranking.length > 0"
SEEN = "lrm.state.values.pose.map((_, row) => row).filter((row) => lrm.scenes.field.seen(row))"

TURN_ROWS = "document.getElementById('lrm-turn').data?.[0].customdata"
"""Rows of the poses in the chart of the turn of a joint."""
FROM_ABOVE = """(() => {
  const v = lrm.state.values, dots = lrm.scenes.field.dots, flat = (p, q) => Math.hypot(p[0] - q[0], p[1] - q[1]);
  const scales = v.tcp.map((p, row) => flat(dots[row], dots[0]) / (flat(p, v.tcp[0]) || 1)).slice(1);
  return Math.max(...scales) - Math.min(...scales) < 1e-6 * Math.max(...scales);
})()"""
"""Whether all distances in the horizontal plane are on one scale on the screen."""

BLUE = """(() => {
  const { canvas, content } = lrm.scenes.field, ratio = canvas.width / canvas.clientWidth;
  lrm.scenes.field.show({ ...content, rows: new Set() });
  const at = lrmScene.projection(content.box, canvas.clientWidth, canvas.clientHeight);
  const areas = lrmSolids.capsules(content.arms[0], at).map((one) => 2 * one.size * one.length + 3.14 * one.size ** 2);
  const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  let blue = 0;
  for (let i = 0; i < data.length; i += 4) blue += data[i + 2] > data[i] + 40 && data[i + 3] === 255;
  return [blue / ratio ** 2, Math.max(...areas), areas.reduce((a, b) => a + b)];
})()"""
"""Pixels of the model's colour without any arrow, and the areas of the links: the largest, and their sum."""
BEFORE_AND_BEHIND = """(() => {
  const at = Object.assign((p) => [p[0], p[1], p[2]], { scale: 1 }), put = [];
  const pen = document.createElement("canvas").getContext("2d");
  const arm = { points: [[50, 50, 0], [150, 50, 0], [150, 50, 90]], links: [[0, 1, 20], [1, 2, 10]] };
  const thing = (name, x, y, z) => ({ at: [x, y, z], put: () => put.push(name) });
  lrmSolids.solid(pen, lrmSolids.capsules(arm, at), "#0072b2", [
    thing("behind", 100, 50, -5), thing("inside", 100, 50, 15), thing("before", 100, 50, 25),
    thing("beside", 100, 80, 25), thing("at the edge", 100, 69, 15), thing("under the end", 150, 50, 95),
    thing("over the end", 150, 50, 110)]);
  return put;
})()"""
"""What is put again after a link of radius 20 mm along x in the plane of the screen, or after one towards the viewer.

That under the end is before the first link, and put before the second one covers it.
"""


@given(st.integers(MOST_DRAWN + 1, 20_000), st.integers(0, 99))
def test_fair_sample_shows_errors_as_often_as_they_occur(poses: int, seed: int) -> None:
    every = np.random.default_rng(seed).exponential(size=(poses, 3))
    drawn = rows_to_draw(every)
    rows = fair_rows(every[drawn], poses)
    assert rows is not None
    assert len(set(rows.tolist())) == len(rows)
    size, bound = np.linalg.norm(every, axis=1), np.sort(np.linalg.norm(every, axis=1))[-WORST_DRAWN]
    shown = size[drawn[rows]]
    share = WORST_DRAWN / poses
    assert abs((shown >= bound).sum() - share * len(shown)) <= 2, "the worst are as rare as among all"
    assert np.array_equal(rows, fair_rows(every[drawn], poses)), "always the same"


def test_all_poses_are_drawn_where_they_are_few() -> None:
    assert fair_rows(np.ones((MOST_DRAWN, 3)), MOST_DRAWN) is None


@pytest.mark.slow
def test_views_scrubber_filter_and_links_that_are_solids(browser: Any, small: RunningWorkbench) -> None:
    seen = BrowserLog()
    page = opened(browser, small, SIZE, seen)
    idle(page, RANKED)
    unfold(page)
    shots = {}
    for name in ("top", "side", "tool", "oblique"):
        page.get_by_role("button", name=f"view from: {name}").click()
        settle(page, 200)
        shots[name] = page.locator("#lrm-field").screenshot()
    assert len(set(shots.values())) == 4
    page.get_by_role("button", name="view from: top").click()
    wait_for(page, FROM_ABOVE)
    page.locator("#lrm-scrub").focus()
    page.keyboard.press("Home")
    page.keyboard.press("ArrowRight")
    assert page.evaluate("lrm.state.pose === lrm.state.values.pose[1]")
    for key, values in (
        ("error", "v.steps[0].residual.map((r) => Math.hypot(...r))"),
        ("q1", "v.q.map((q) => q[1])"),
        ("load", "v.load"),
        ("pose", "v.pose"),
        ("session", "v.session"),
    ):
        page.select_option("#lrm-filter", key)
        every = page.evaluate(f"((v) => {values})(lrm.state.values)")
        low, high = np.quantile(every, [0.25, 0.75]).round(2)
        page.fill("#lrm-filter-low", str(low))
        page.fill("#lrm-filter-high", str(high))
        page.keyboard.press("Enter")
        assert page.evaluate(SEEN) == [row for row, value in enumerate(every) if low <= value <= high]
    shot(page, "filtered.png")
    page.select_option("#lrm-filter", "")
    assert len(page.evaluate(SEEN)) == FEW
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    links_are_solids_before_what_is_behind_them(page)
    page.context.close()
    assert not seen.errors, seen.errors


def links_are_solids_before_what_is_behind_them(page: Any) -> None:
    assert page.evaluate(BEFORE_AND_BEHIND) == ["before", "at the edge", "under the end", "over the end"]
    for view in ("top", "side", "oblique"):
        page.get_by_role("button", name=f"view from: {view}").click()
        settle(page, 200)
        blue, largest, together = page.evaluate(BLUE)
        assert 0.5 * largest < blue < together, view


@pytest.mark.slow
def test_many_poses_are_a_fair_sample_with_the_worst_at_hand(browser: Any, tmp_path: Path) -> None:
    header, *rows = EXAMPLE.read_text().splitlines()
    many = tmp_path / "many.csv"
    noise = np.random.default_rng(0)
    lines = [header]
    for number in range(1500):
        cells = rows[number % len(rows)].split(",")
        at = [k for k, name in enumerate(header.split(",")) if name in ("x_mm", "y_mm", "z_mm")]
        for k in at:
            cells[k] = f"{float(cells[k]) + noise.normal(0.0, 0.3):.4f}"
        lines.append(",".join([str(number + 1), *cells[1:]]))
    many.write_text("\n".join(lines) + "\n")
    many.with_suffix(".toml").write_text(EXAMPLE.with_suffix(".toml").read_text())
    stdout_of("fit", many, "-o", tmp_path / "m.toml")
    with workbench(tmp_path / "m.toml", many, cwd=tmp_path) as running:
        page = opened(browser, running, SIZE)
        unfold(page)
        fair = page.evaluate("lrm.state.values.fair")
        assert page.evaluate("lrm.state.values.pose.length") == MOST_DRAWN
        assert page.evaluate(SEEN) == fair
        says = f"shown: {len(fair)} of 1500 poses, a fair sample"
        assert page.inner_text("#lrm-picture-says") == says
        wait_for(page, TURN_ROWS)
        assert page.evaluate(TURN_ROWS) == fair, "flat charts show the same sample"
        assert page.inner_text("#panel-turn .lrm-sample") == says
        missing = page.evaluate("((v) => v.pose.find((_, row) => !v.fair.includes(row)))(lrm.state.values)")
        page.evaluate(f"lrm.brush(new Set([{missing}]))")
        wait_for(page, f"{TURN_ROWS}.length === {len(fair) + 1}")
        assert page.inner_text("#panel-turn .lrm-sample") == says.replace(str(len(fair)), str(len(fair) + 1))
        page.evaluate("lrm.brush(null)")
        page.click("text=fair sample / with the worst")
        wait_for(page, f"{SEEN}.length === {MOST_DRAWN}")
        wait_for(page, f"{TURN_ROWS}.length === {MOST_DRAWN}")
        assert "the worst among them" in page.inner_text("#panel-turn .lrm-sample")
        assert "the worst among them" in page.inner_text("#lrm-picture-says")
        page.context.close()


@pytest.mark.soak
@pytest.mark.slow
@pytest.mark.parametrize("width", [390, 800, 1440])
def test_nothing_is_wider_than_the_screen(browser: Any, small: RunningWorkbench, width: int) -> None:
    """Page and report, each from its top to its end."""
    page = opened(browser, small, {"width": width, "height": 900})
    idle(page, RANKED)
    settle(page, 1500)
    with page.context.expect_page() as other:
        press(page, "report")
    other.value.wait_for_selector("#lrm-field canvas")
    for name, one in (("page", page), ("report", other.value)):
        settle(one, 1500)
        assert one.evaluate("document.documentElement.scrollWidth <= innerWidth"), name
        shot(one, f"{name}-{width}.png", full_page=True)
    field = page.evaluate("(({ clientWidth, clientHeight }) => [clientWidth, clientHeight])(lrm.scenes.field.canvas)")
    assert min(field) > 240, "the field is squeezed"
    shot(page, f"workbench-{width}.pdf")
    page.context.close()
