"""The pictures of docs/tutorial.md, taken of the real pages: `python -m validation.workbench.tutorial_pictures`."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from PIL import Image

from tests.conftest import ROOT
from tests.support.browser import PATIENCE_MS, RunningWorkbench, chromium, idle, press, unfold, wait_for, workbench

PICTURES = ROOT / "docs" / "pictures" / "workbench"
RANKED, SETTLE_MS, COLOURS = "lrm.state.values.ranking.length > 0", 4000, 256


def main() -> None:
    """Takes every picture."""
    PICTURES.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory() as folder, chromium() as browser, workbench(cwd=Path(folder)) as running:
        page = _opened(browser, running, "light")
        page.click("[data-name=close-tour]")
        idle(page, RANKED)
        _take(page, "before")
        page.click("[data-name=add]")
        wait_for(page, "lrm.state.values.steps.length === 2")
        idle(page, RANKED)
        _take(page, "after")
        unfold(page)
        page.select_option("#lrm-beside", "0")
        _take(page, "side-by-side")
        page.context.close()
        page = _opened(browser, running, "dark")
        idle(page, RANKED)
        press(page, "undo")
        wait_for(page, "lrm.state.values.steps.length === 1 && lrm.state.candidate")
        _take(page, "dark")


def _opened(browser: Any, running: RunningWorkbench, scheme: str) -> Any:
    context = browser.new_context(viewport={"width": 1366, "height": 768}, color_scheme=scheme)
    context.set_default_timeout(PATIENCE_MS)
    page = context.new_page()
    page.goto(running.address)
    wait_for(page, "window.lrm && lrm.state.values")
    return page


def _take(page: Any, name: str) -> None:
    page.mouse.move(5, 5)
    page.evaluate("scrollTo(0, 0)")  # the tour scrolls to what it shows
    page.wait_for_timeout(SETTLE_MS)
    path = PICTURES / f"{name}.png"
    page.screenshot(path=path)
    Image.open(path).convert("RGB").quantize(COLOURS, Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE).save(
        path, optimize=True
    )
    print(f"{name}.png")


if __name__ == "__main__":
    main()
