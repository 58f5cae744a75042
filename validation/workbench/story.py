"""The moving picture of README and site, and the social card: `python -m validation.workbench.story`.

Taken of the real page in a headless Chromium: the arm sags, the card names the cause, the error falls.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from PIL import Image

from tests.conftest import ROOT
from tests.support.browser import PATIENCE_MS, chromium, idle, wait_for, workbench
from validation.workbench.tutorial_pictures import RANKED

PICTURES = ROOT / "docs" / "pictures"
VIEW, WIDTH, COLOURS, MOST_BYTES = {"width": 1280, "height": 720}, 860, 96, 2_000_000
HOLD_MS, TURN_MS = 2600, 160
RARE = Image.Quantize.MAXCOVERAGE
"""Keeps colours of few px: what is wrong in a sketch is orange."""
CAPTION = """(words) => {
  const bar = document.getElementById("story") || document.body.appendChild(document.createElement("div"));
  bar.id = "story"; bar.textContent = words;
  bar.style = "position: fixed; left: 0; right: 0; bottom: 0; z-index: 9999; padding: .7em 1em; text-align: center;" +
              "font: 600 26px system-ui, sans-serif; color: #fff; background: rgba(20, 32, 74, .93)";
}"""
CARD = """<!doctype html><meta charset="utf-8"><style>
body {{ margin: 0; width: 1280px; height: 640px; overflow: hidden; background: #14204a; color: #fff;
       font-family: system-ui, "DejaVu Sans", sans-serif }}
h1 {{ font-size: 43px; line-height: 1.25; margin: 40px 56px 0 }}
p {{ font-size: 25px; margin: 14px 56px; color: #cfd8ff }}
img {{ position: absolute; left: 56px; bottom: -255px; width: 1168px; border-radius: 14px 14px 0 0 }}
</style><h1>Find out what is wrong with a cheap robot arm,<br>and drive it there anyway</h1>
<p>Measure the tip. See which physical effect is missing. Correct it.</p><img src="data:image/png;base64,{picture}">"""


def main() -> None:
    """Takes both pictures."""
    with chromium() as browser, _page(browser) as page:
        frames = list(_frames(page))
        card = _card(browser, frames[0][0])
    _write_gif(PICTURES / "story.gif", frames)
    Image.open(io.BytesIO(card)).convert("RGB").quantize(128, RARE).save(PICTURES / "social-card.png", optimize=True)
    for name in ("story.gif", "social-card.png"):
        print(f"{name}: {(PICTURES / name).stat().st_size / 1e3:.0f} kB")


@contextmanager
def _page(browser: Any) -> Iterator[Any]:
    with TemporaryDirectory() as folder, workbench(cwd=Path(folder)) as running:
        context = browser.new_context(viewport=VIEW, color_scheme="light")
        context.set_default_timeout(PATIENCE_MS)
        page = context.new_page()
        page.goto(running.address)
        wait_for(page, "window.lrm && lrm.state.values")
        page.click("[data-name=close-tour]")
        idle(page, RANKED)
        yield page
        context.close()


def _frames(page: Any) -> Iterator[tuple[bytes, int]]:
    """Screenshots (PNG) and how long each is shown (ms)."""
    page.evaluate("scrollTo(0, 0)")
    page.evaluate(CAPTION, "The arm bends and has play: every arrow is an error of its tip")
    yield page.screenshot(), HOLD_MS
    page.evaluate(CAPTION, "The sentence on the left names the cause; the list below has its rivals")
    page.wait_for_timeout(300)
    yield page.screenshot(), HOLD_MS
    page.evaluate(CAPTION, "Add it …")
    yield page.screenshot(), HOLD_MS // 3
    page.click("[data-name=add]")
    wait_for(page, "lrm.state.values.steps.length === 2")
    for _ in range(6):  # the arrows shrink for a second
        yield page.screenshot(), TURN_MS
    idle(page, RANKED)
    page.evaluate("scrollTo(0, 0)")
    page.evaluate(CAPTION, "… and the error falls to the noise of the measurement")
    page.wait_for_timeout(1500)
    yield page.screenshot(), 2 * HOLD_MS


def _card(browser: Any, picture: bytes) -> bytes:
    page = browser.new_page(viewport={"width": 1280, "height": 640})
    page.set_content(CARD.format(picture=base64.b64encode(picture).decode()))
    return bytes(page.screenshot())


def _write_gif(path: Path, frames: list[tuple[bytes, int]]) -> None:
    """Raises `SystemExit` if it would be too large to load."""
    pictures = [Image.open(io.BytesIO(shot)).convert("RGB") for shot, _ in frames]
    height = round(WIDTH * pictures[0].height / pictures[0].width)
    palette = pictures[-1].quantize(COLOURS, RARE)
    small = [one.resize((WIDTH, height), Image.Resampling.LANCZOS) for one in pictures]
    flat = [one.quantize(palette=palette, dither=Image.Dither.NONE) for one in small]
    flat[0].save(path, save_all=True, append_images=flat[1:], duration=[ms for _, ms in frames], loop=0, optimize=True)
    if path.stat().st_size > MOST_BYTES:
        raise SystemExit(f"{path.name}: {path.stat().st_size} bytes, more than {MOST_BYTES}")


if __name__ == "__main__":
    main()
