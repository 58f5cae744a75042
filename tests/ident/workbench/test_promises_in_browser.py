"""How a step is seen: arrows that go from old to new, before beside after, progress, words explained, the keyboard."""

from __future__ import annotations

import re
from typing import Any

import pytest

from tests.support.browser import BrowserLog, RunningWorkbench, idle, opened, press, settle, shot, unfold, wait_for

SIZE = {"width": 1440, "height": 900}
RANKED = "lrm.state.values.ranking.length > 0"
ONE_STEP, TWO_STEPS = "lrm.state.values.steps.length === 1", "lrm.state.values.steps.length === 2"
SEEN_FROM_STEP = """(number) => {
  const seen = [];
  lrm.showStep(number);
  return new Promise((done) => {
    const look = () => {
      seen.push(lrm.scenes.field.content.residual[0][0]);
      const end = lrm.state.values.steps[number].residual[0][0], there = Math.abs(seen[seen.length - 1] - end) < 1e-9;
      if (there || seen.length > 1000) done(seen); else requestAnimationFrame(look);
    };
    look();
  });
}"""
"""Of the first arrow, x as it was drawn on the way to a step, from frame to frame."""
FOCUSED = """(() => {
  const one = document.activeElement, style = getComputedStyle(one);
  return [one.tagName, !one.closest('.modebar'), style.outlineStyle !== 'none' || style.boxShadow !== 'none'];
})()"""


def floor_line(page: Any) -> Any:
    """Noise (mm) whose line the waterfall shows; None where it shows none."""
    shown = "document.querySelector('.lrm-waterfall')?.style.getPropertyValue('--noise')"
    return page.evaluate(f"parseFloat({shown}) > 0 ? lrm.state.values.story.noise.rms_mm : null")


@pytest.mark.slow
def test_a_step_is_seen_to_happen(browser: Any, small: RunningWorkbench) -> None:
    """Arrows on the way, none where motion is not wished; before left of after; the noise's line stays."""
    seen = BrowserLog()
    page = opened(browser, small, SIZE, seen)
    idle(page, RANKED)
    floor = floor_line(page)
    page.click("[data-name=add]")
    wait_for(page, TWO_STEPS)
    assert page.evaluate("lrm.state.values.floor") == floor == floor_line(page), "it stays before the new diagnosis"
    idle(page, RANKED)
    assert page.evaluate("lrm.state.beside") == 0, "before and after beside each other"
    unfold(page)
    page.select_option("#lrm-beside", "")
    first, second = page.evaluate("lrm.state.values.steps.map((one) => one.residual[0][0])")
    low, high = sorted((first, second))
    for number, end in ((0, first), (1, second)):
        way = page.evaluate(SEEN_FROM_STEP, number)
        assert way[-1] == pytest.approx(end)
        assert all(low - 1e-9 <= x <= high + 1e-9 for x in way)
        assert len(set(way)) > 2, "there is no arrow between old and new"
    page.emulate_media(reduced_motion="reduce")
    assert page.evaluate(SEEN_FROM_STEP, 0) == [first], "it moves although that is not wished"
    for shown, beside in (("1", "0"), ("0", "1")):
        page.select_option("#lrm-step", shown)
        page.select_option("#lrm-beside", beside)
        settle(page, 300)
        left, right = page.evaluate("['field', 'field-b'].map((id) => lrm.scenes[id].content.title)")
        assert (left[:7], right[:6]) == ("before:", "after:"), "before stands left, after right"
    boxes = page.evaluate(
        "['field', 'field-b'].map((id) => document.getElementById('lrm-' + id).getBoundingClientRect())"
        ".map((box) => [box.top, box.height, box.left])"
    )
    assert boxes[0][:2] == boxes[1][:2]
    assert boxes[0][2] < boxes[1][2]
    assert boxes[0][1] > 0.5 * page.evaluate("document.getElementById('panel-field').clientHeight"), "full height"
    shot(page, "before-after.png")
    values = [one for one in seen.addresses if "/lrm/values" in one]
    assert len(values) == len(set(values)), "values are sent once"
    page.keyboard.press("u")
    wait_for(page, ONE_STEP)
    page.context.close()
    assert not seen.errors, seen.errors


@pytest.mark.slow
def test_progress_says_the_round_the_error_and_how_far_it_is(browser: Any, small: RunningWorkbench) -> None:
    page = opened(browser, small, SIZE)
    idle(page, RANKED)
    page.evaluate("""(() => {
      window.told = new Set();
      const work = document.querySelector('#lrm-work'), note = () => told.add(work.innerText);
      new MutationObserver(note).observe(work, { subtree: true, childList: true, characterData: true });
    })()""")
    press(page, "auto")
    wait_for(page, TWO_STEPS)
    idle(page, RANKED)
    before = page.evaluate("lrm.state.values.story.steps[1].rms_mm.toFixed(2)")
    told = page.evaluate("[...told].filter((one) => one.includes('round'))")
    assert any(re.search(r"auto, round 1 of at most \d+; .*: \d+ of \d+", one) for one in told), told
    after = page.evaluate("lrm.state.values.story.steps[2].rms_mm.toFixed(2)")
    fall = f"{before} → {after} mm"
    assert any(re.search(rf"auto, round 2 of at most \d+: {fall}; .*: \d+ of \d+", one) for one in told), told
    page.keyboard.press("u")
    wait_for(page, ONE_STEP)
    page.context.close()


@pytest.mark.slow
def test_words_are_explained_and_the_keyboard_reaches_all_but_the_icons_of_charts(
    browser: Any, small: RunningWorkbench
) -> None:
    page = opened(browser, small, SIZE)
    idle(page, RANKED)
    for place in ("workbench", "report"):
        if place == "report":
            page.goto(f"{small.origin}/lrm/report")
        page.wait_for_selector("abbr >> text=black-box model", state="attached")
        words = page.evaluate("[...document.querySelectorAll('abbr')].map((one) => [one.textContent, one.title])")
        known = {word for word, _ in words}
        assert {"held-out", "RMS", "measurement noise", "Moran's I", "black-box model"} <= known, place
        assert all(title for _, title in words)
        focused = []
        for _ in range(40):
            page.keyboard.press("Tab")
            focused.append(page.evaluate(FOCUSED))
        assert all(reached for _, reached, _ in focused), f"{place}: an icon of a chart takes the focus"
        shot(page, f"focus-{place}.png")
        unseen = [tag for tag, _, visible in focused if tag != "BODY" and not visible]
        assert not unseen, f"{place}: focus is not seen on {unseen}"
    page.context.close()
