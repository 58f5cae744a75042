"""A real browser without a screen, and a workbench process for it."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import ROOT

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
ARGUMENTS = ["--no-sandbox"]
PATIENCE_MS, POLLING_MS = 120_000, 100
"""How long a test waits, and how often it looks; a tab in the background draws no frames to look at."""
FRAMES = """([frames, atMost]) => new Promise((done) => {
  const next = () => (frames-- > 0 ? requestAnimationFrame(next) : done());
  next();
  setTimeout(done, atMost);
})"""
FRAMES_HZ = 60
SHOTS = ROOT / "out" / "workbench"
AXE = Path(os.environ.get("AXE_CORE", ROOT / "node_modules" / "axe-core" / "axe.min.js"))
NO_AXE = "no axe-core: `npm install axe-core` in the project's folder, or set AXE_CORE to its axe.min.js"
with_axe = pytest.mark.skipif(not AXE.is_file(), reason=NO_AXE)
"""For tests of nothing but axe-core: without it no page is opened."""


@dataclass
class BrowserLog:
    """Messages and requests of a page for while it was open."""

    errors: list[str] = field(default_factory=list)
    addresses: list[str] = field(default_factory=list)

    def listen(self, page: Any) -> None:
        """Notes console errors, exceptions, and every request."""
        page.on("console", lambda message: self.errors.append(message.text) if message.type == "error" else None)
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("request", lambda request: self.addresses.append(request.url))

    def foreign(self, own: str) -> list[str]:
        """Requests that went elsewhere than to the page's own server."""
        return [one for one in self.addresses if not one.startswith((own, "data:", "blob:", "file:", "about:"))]


def browser_path() -> str:
    """Where the system's Chromium is; the test is skipped, and says so, where there is none."""
    pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    path = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if path is None:
        pytest.skip("no Chromium on this machine: the tests of the page in a real browser are left out")
    return path


@contextmanager
def chromium() -> Iterator[Any]:
    """A headless Chromium of the system; the test is skipped, and says so, where there is none."""
    path = browser_path()
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=ARGUMENTS)
        try:
            yield browser
        finally:
            browser.close()


@dataclass
class RunningWorkbench:
    """A workbench process; `address` with its token, `folder` of its steps, `started`: monotonic time (s)."""

    process: subprocess.Popen[str]
    address: str
    folder: Path
    started: float

    @property
    def origin(self) -> str:
        """Scheme, host and port."""
        return self.address.split("/?")[0]

    def stop(self) -> None:
        """Stops it as Ctrl-C does."""
        self.process.send_signal(signal.SIGINT)
        self.process.wait(timeout=30)


@contextmanager
def workbench(*words: object, cwd: Path) -> Iterator[RunningWorkbench]:
    """`lrm-ident workbench WORDS`, until the block ends."""
    command = [sys.executable, "-m", "lrm_ident", "workbench", "--no-open", *map(str, words)]
    environment = {**os.environ, "XDG_STATE_HOME": str(cwd / "state"), "PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1"}
    started = time.monotonic()
    environment.pop("PYTHONDONTWRITEBYTECODE", None)  # an installed package is compiled
    environment.pop("PYTEST_CURRENT_TEST", None)  # NiceGUI would take itself to be under test
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=cwd, env=environment
    ) as process:
        try:
            said = [process.stdout.readline(), process.stdout.readline()]  # type: ignore[union-attr]
            found = re.search(r"http://\S+", said[0]), re.search(r"kept in (\S+);", said[1])
            assert all(found), "".join(said) + process.stdout.read()  # type: ignore[union-attr]
            threading.Thread(target=process.stdout.read, daemon=True).start()  # type: ignore[union-attr]
            address, folder = found[0][0], found[1][1]  # type: ignore[index]
            yield RunningWorkbench(process, address, Path(folder), started)
        finally:
            process.kill()


def opened(
    browser: Any, running: RunningWorkbench, size: dict[str, int], seen: BrowserLog | None = None, scheme: str = "light"
) -> Any:
    """A new tab. `scheme`: of colours, that the browser asks for."""
    context = browser.new_context(viewport=size, color_scheme=scheme)
    context.set_default_timeout(PATIENCE_MS)
    page = context.new_page()
    if seen:
        seen.listen(page)
    page.goto(running.address)
    wait_for(page, "window.lrm && lrm.state.values")
    return page


def press(page: Any, name: str) -> None:
    """Presses a button by its name, in the menu where it stands there."""
    button = f"[data-name='{name}']"
    if not page.is_visible(button):
        page.click("#lrm-menu > summary")
    page.click(button)


def shot(page: Any, name: str, *, full_page: bool = False) -> None:
    """A picture for a person, or a PDF, in `out/workbench` where SCREENSHOTS is set, as `make browser` sets it."""
    if "SCREENSHOTS" not in os.environ:
        return
    SHOTS.mkdir(parents=True, exist_ok=True)
    if name.endswith(".pdf"):
        page.pdf(path=SHOTS / name)
    else:
        page.screenshot(path=SHOTS / name, full_page=full_page)


def unfold(page: Any) -> None:
    """Opens all that is folded but the menu."""
    page.evaluate("for (const one of document.querySelectorAll('details:not(#lrm-menu)')) one.open = true")


def idle(page: Any, also: str = "true") -> None:
    """Waits until the workbench has done its work and `also` holds in the page."""
    wait_for(page, f"document.querySelector('#lrm-work')?.checkVisibility() === false && ({also})")


def says(page: Any, selector: str, words: str) -> None:
    """Waits until an element shows some words."""
    found = "([at, words]) => document.querySelector(at)?.innerText.includes(words)"
    page.wait_for_function(found, arg=[selector, words], timeout=PATIENCE_MS, polling=POLLING_MS)


def wait_for(page: Any, condition: str) -> None:
    """Waits until a condition holds in the page."""
    page.wait_for_function(condition, timeout=PATIENCE_MS, polling=POLLING_MS)


def settle(page: Any, milliseconds: int) -> None:
    """Waits for what is drawn later than it is asked for: as many frames as fit into a time on an idle computer.

    A tab in the background draws none: at most ten times as long.
    """
    page.evaluate(FRAMES, [max(1, milliseconds * FRAMES_HZ // 1000), 10 * milliseconds])


def axe_violations(page: Any) -> list[tuple[str, list[str]]]:
    """The rules of axe-core that a page breaks, each with where; the test is skipped, and says so, without axe-core."""
    if not AXE.is_file():
        pytest.skip(NO_AXE)
    page.evaluate(AXE.read_text(encoding="utf-8"))
    faults = page.evaluate("axe.run().then((result) => result.violations)")
    return [(fault["id"], [node["html"][:120] for node in fault["nodes"]][:3]) for fault in faults]
