"""Speed of the workbench in a headless Chromium: `python -m validation.workbench.speed [MODEL] [DATA]`.

Prints one line per figure, with what is wanted of 393 poses; then the same page with 10 000. The browser runs already,
and the package is compiled, as an installed one is.
"""

from __future__ import annotations

import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from lrm_ident.study.api import EXAMPLE
from tests.support.browser import PATIENCE_MS, RunningWorkbench, chromium, wait_for, workbench
from tests.support.commands import stdout_of
from validation.options import asked

DRAWN = "window.lrm?.scenes.field?.dots.length > 0 && document.querySelector('#lrm-turn .main-svg')"
"""The error field and the chart beside it are on the screen."""
SEEN_AFTER_CLICK = """(selectors) => new Promise((done) => {
  const start = performance.now(), times = {};
  const look = () => {
    for (const one of selectors) {
      if (!(one in times) && document.querySelector(one).checkVisibility()) times[one] = performance.now() - start;
    }
    if (selectors.every((one) => one in times)) done(times); else setTimeout(look, 2);
  };
  document.querySelector("[data-name=add]").click();
  look();
})"""
HOVER = """async () => {
  const times = [];
  for (let row = 0; row < 40; row++) {
    const start = performance.now();
    lrm.hover(row);
    await new Promise((next) => requestAnimationFrame(() => setTimeout(next)));
    times.push(performance.now() - start);
  }
  return times.sort((a, b) => a - b);
}"""


MANY = 10_000


def main() -> None:
    """Measures and prints."""
    given = asked(__doc__, "model?", "data?")
    words = [path.resolve() for path in (given.model, given.data) if path]
    data = words[-1] if words else EXAMPLE
    with TemporaryDirectory() as name, chromium() as browser:
        folder = Path(name)
        with workbench(*words, cwd=folder) as running:
            page = _usable(browser, running)
            wait_for(page, "window.lrm && lrm.state.values?.ranking.length > 0 && lrm.state.candidate")
            page.wait_for_timeout(3000)
            _hover(page)
            seen = page.evaluate(SEEN_AFTER_CLICK, ["#lrm-asked", "#lrm-work"])
            print(f"a click on Add is answered after {seen['#lrm-asked']:.0f} ms (200)", end="")
            print(f", the work shows its progress after {seen['#lrm-work']:.0f} ms")
            wait_for(page, "lrm.state.values.steps.length > 1")
            model = folder / "model.toml"
            model.write_bytes((running.folder / "step-0.toml").read_bytes())
        _report(browser, model, data, folder)
        with workbench(model, _many(data, folder), cwd=folder) as running:
            page = _usable(browser, running)
            print(f"said: {page.inner_text('#lrm-scale')}")
            page.wait_for_timeout(3000)
            _hover(page)


def _usable(browser: Any, running: RunningWorkbench) -> Any:
    """A tab that has drawn the first figures; prints how long that took from the start of the command."""
    page = browser.new_context(viewport={"width": 1366, "height": 768}).new_page()
    page.set_default_timeout(PATIENCE_MS)
    page.goto(running.address)
    wait_for(page, DRAWN)
    poses = page.evaluate("lrm.state.values.poses")
    print(f"{poses} poses: usable after {time.monotonic() - running.started:.1f} s (3)")
    return page


def _hover(page: Any) -> None:
    times = page.evaluate(HOVER)
    print(f"hover: median {times[len(times) // 2]:.1f} ms, worst {times[-1]:.1f} ms (50)")


def _many(data: Path, folder: Path) -> Path:
    """The measurements again and again, numbered anew, until there are 10 000."""
    head, *rows = data.read_text(encoding="utf-8").splitlines()
    columns = head.split(",")
    pose, kept = columns.index("pose"), [k for k, name in enumerate(columns) if name not in ("t_s", "repeat_of")]
    lines = [",".join(columns[k] for k in kept)]
    for number in range(1, MANY + 1):
        cells = rows[(number - 1) % len(rows)].split(",")
        cells[pose] = str(number)
        lines.append(",".join(cells[k] for k in kept))
    path = folder / "many.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    path.with_suffix(".toml").write_text(data.with_suffix(".toml").read_text(encoding="utf-8"), encoding="utf-8")
    return path


def _report(browser: Any, model: Path, data: Path, folder: Path) -> None:
    path = folder / "report.html"
    stdout_of("report", model, data.resolve(), "-o", path)
    page = browser.new_page()
    page.set_default_timeout(PATIENCE_MS)
    started = time.monotonic()
    page.goto(f"file://{path}", wait_until="commit")
    page.wait_for_selector("#lrm-verdict")
    read = time.monotonic() - started
    page.wait_for_selector("#lrm-field canvas")
    field = time.monotonic() - started
    page.wait_for_selector("#lrm-form .main-svg")
    charts = time.monotonic() - started
    print(f"report: {path.stat().st_size / 1e6:.1f} MB (6), text after {read:.1f} s, ", end="")
    print(f"what is in view after {field:.1f} s (3), all charts after {charts:.1f} s")


if __name__ == "__main__":
    main()
