"""axe-core on page and report with everything open: dialogs, notices and folds, narrow and wide, light and dark."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from tests.support.browser import (
    RunningWorkbench,
    axe_violations,
    idle,
    opened,
    press,
    says,
    settle,
    shot,
    wait_for,
    with_axe,
)

SIZE, WIDTHS = {"width": 1280, "height": 900}, (390, 1440)
RANKED = "lrm.state.values.ranking.length > 0"
THEME = "document.documentElement.dataset.theme"
SETTLED_MS = 600
"""Until a dialog stands where it is to stand."""


def faults(page: Any, name: str, turn: Callable[[], object]) -> list[tuple[object, ...]]:
    """Findings of axe-core in both themes at both widths; `turn`: from one theme to the other."""
    found: list[tuple[object, ...]] = []
    for _ in range(2):
        theme = page.evaluate(THEME)
        for width in WIDTHS:
            page.set_viewport_size({"width": width, "height": 900})
            settle(page, SETTLED_MS)
            shot(page, f"axe-{name}-{theme}-{width}.png")
            assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), (name, width)
            found += [(name, theme, width, *fault) for fault in axe_violations(page)]
        turn()
        wait_for(page, f"{THEME} !== '{theme}'")
    return found


@with_axe
@pytest.mark.slow
def test_axe_finds_nothing_in_any_dialog(browser: Any, small: RunningWorkbench) -> None:
    page = opened(browser, small, SIZE)
    idle(page, RANKED)
    found: list[tuple[object, ...]] = []

    def look(name: str) -> None:
        found.extend(faults(page, name, lambda: page.evaluate("lrmTurnDark()")))
        page.set_viewport_size(SIZE)

    page.locator("#lrm-what-if-size").press("End")
    for one in page.locator("details > summary").all():
        if one.is_visible():
            one.click()
    look("what-if-and-explain")
    for name in ("save…", "commands", "live…", "tour"):
        press(page, name)
        settle(page, SETTLED_MS)
        look(name.strip("…"))
        page.get_by_role("button", name="Close").locator("visible=true").last.click()
        settle(page, SETTLED_MS)
    for name, dialog, closing in (
        ("next poses", "#lrm-search", "close-search"),
        ("propose a formula", "#lrm-search", "close-search"),
    ):
        press(page, name)
        page.wait_for_selector(dialog)
        look(name)
        page.click(f"[data-name={closing}]")
        page.wait_for_selector(dialog, state="hidden")
    page.evaluate("lrmOpen([new File(['pose,q1_deg\\n1,nonsense\\n'], 'bad.csv')])")
    says(page, "#lrm-failure", "bad")
    page.keyboard.press("r")
    says(page, "body", "nothing to redo")
    look("errors")
    page.context.close()
    assert not found, "\n".join(map(str, found))


@with_axe
@pytest.mark.slow
def test_axe_finds_nothing_in_a_report_with_everything_unfolded(browser: Any, small: RunningWorkbench) -> None:
    page = opened(browser, small, SIZE)
    idle(page, RANKED)
    page.goto(f"{small.origin}/lrm/report")
    page.wait_for_selector("#lrm-ranking label")
    page.locator("#lrm-what-if-size").press("End")
    page.evaluate("for (const one of document.querySelectorAll('details')) one.open = true")
    found = faults(page, "report", lambda: page.click("#lrm-theme"))
    page.context.close()
    assert not found, "\n".join(map(str, found))
