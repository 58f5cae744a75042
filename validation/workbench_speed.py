"""How fast the workbench is in a headless Chromium: `python -m validation.workbench_speed [MODEL] [DATA]`.

Prints one line per figure; the browser draws the spatial scene in software here, a graphics card is faster.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from lrm_ident.api import EXAMPLE
from tests.support.browser import PATIENCE_MS, chromium, wait_for, workbench
from tests.support.commands import stdout_of

PROGRESS_AFTER_CLICK = """() => new Promise((done) => {
  const work = document.querySelector("#lrm-work"), start = performance.now();
  const look = () => work.checkVisibility() ? done(performance.now() - start) : setTimeout(look, 2);
  document.querySelector("[data-name=add]").click();
  look();
})"""
HOVER = """async () => {
  const times = [];
  for (let row = 0; row < 40; row++) {
    const start = performance.now();
    lrm.hover(row);
    times.push(performance.now() - start);
    await new Promise((next) => setTimeout(next, 10));
  }
  return times.sort((a, b) => a - b);
}"""


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="*", type=Path, help="as lrm-ident workbench takes them")
    words = parser.parse_args().files
    with TemporaryDirectory() as folder, chromium() as browser:
        started = time.monotonic()
        with workbench(*(path.resolve() for path in words), cwd=Path(folder)) as running:
            told = time.monotonic()
            page = browser.new_context(viewport={"width": 1366, "height": 768}).new_page()
            page.set_default_timeout(PATIENCE_MS)
            page.goto(running.address)
            wait_for(page, "window.lrm && lrm.state.values")
            poses = page.evaluate("lrm.state.values.poses")
            print(f"{poses} poses; address after {told - started:.1f} s, usable {time.monotonic() - told:.1f} s later")
            wait_for(page, "lrm.state.values.ranking.length > 0 && lrm.state.candidate")
            print(f"candidates after {time.monotonic() - started:.1f} s")
            page.wait_for_timeout(3000)
            times = page.evaluate(HOVER)
            print(f"hover: median {times[len(times) // 2]:.1f} ms, worst {times[-1]:.1f} ms")
            print(f"progress after a click on Add: {page.evaluate(PROGRESS_AFTER_CLICK):.0f} ms")
            wait_for(page, "lrm.state.values.steps.length > 1")
            print(f"Add took {time.monotonic() - started:.1f} s in all")
            model = running.folder / "step-0.toml"
            _report(browser, model, words[-1] if words else EXAMPLE, Path(folder))


def _report(browser: Any, model: Path, data: Path, folder: Path) -> None:
    path = folder / "report.html"
    stdout_of("report", model, data.resolve(), "-o", path)
    page = browser.new_page()
    page.set_default_timeout(PATIENCE_MS)
    started = time.monotonic()
    page.goto(f"file://{path}", wait_until="commit")
    page.wait_for_selector("#lrm-verdict")
    read = time.monotonic() - started
    page.wait_for_selector("#lrm-form .main-svg")
    size = path.stat().st_size / 1e6
    print(f"report: {size:.1f} MB, text after {read:.1f} s, charts after {time.monotonic() - started:.1f} s")


if __name__ == "__main__":
    main()
