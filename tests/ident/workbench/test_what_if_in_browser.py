"""Chosen effect of another size: linear, before any refit; and what the page says of the effect."""

from __future__ import annotations

from typing import Any

import pytest

from tests.support.browser import BrowserLog, RunningWorkbench, idle, opened, shot

SIZE = {"width": 1280, "height": 800}
RANKED = "lrm.state.values.ranking.length > 0"
SHOWN = "Number(document.querySelector('#lrm-what-if-says').textContent.match(/RMS ([0-9.]+) mm/)?.[1])"
"""The RMS (mm) that the sentence beside the slider says."""


def moved_to(page: Any, size: float) -> float:
    """The RMS (mm) that is said with the slider at so many times the estimate."""
    page.evaluate(
        "(size) => { const one = document.getElementById('lrm-what-if-size'); one.value = size; "
        "one.dispatchEvent(new Event('input')); }",
        size,
    )
    return float(page.evaluate(SHOWN))


@pytest.mark.slow
def test_an_effect_is_explained_and_its_size_moves_arrows_and_rms_before_any_refit(
    browser: Any, small: RunningWorkbench
) -> None:
    seen = BrowserLog()
    page = opened(browser, small, SIZE, seen)
    idle(page, RANKED)
    before = float(page.evaluate("lrm.state.values.steps[0].rms"))
    said = {size: moved_to(page, size) for size in (0.5, 1.0, 1.5, 2.0)}
    assert said[1.0] < said[0.5] < before
    assert said[1.0] < said[1.5] < said[2.0], "least at the estimate: it is the least-squares one"
    moved_to(page, 1.0)
    words = page.inner_text("#lrm-what-if-says")
    assert "backlash in joint 2 of 2." in words
    assert "linear, before any refit" in words
    assert page.evaluate("lrm.scenes.field.content.title").startswith("what if: RMS")
    arrows = page.evaluate("lrm.scenes.field.content.residual")
    measured = page.evaluate("lrm.state.values.steps[0].residual")
    added = page.evaluate("lrm.state.values.ranking.find((one) => one.name === lrm.state.candidate).added")
    assert arrows[3] == pytest.approx([r - a for r, a in zip(measured[3], added[3], strict=True)])
    shot(page, "what-if.png")
    page.click(".lrm-explain summary")
    assert "shaft" in page.inner_text(".lrm-explain") or "gear" in page.inner_text(".lrm-explain").lower()
    other = page.evaluate("lrm.state.values.ranking[1].name")
    page.click(f"#lrm-ranking [data-name='{other}']")
    assert page.evaluate("lrm.state.size") == 0
    assert page.evaluate("lrm.scenes.field.content.residual") == measured
    assert page.evaluate("lrm.scenes.field.content.title").startswith("lengths, angles and stiffness fitted: RMS")
    page.context.close()
    assert not seen.errors
