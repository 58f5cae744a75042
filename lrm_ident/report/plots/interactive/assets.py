"""The files that interactive figures need: Plotly's library, our scripts and style.

`plotly-basic.min.js` is that of the npm package plotly.js-basic-dist-min 3.7.0 (MIT, `plotly-LICENSE`), unchanged: the
part of Plotly that draws flat charts, a quarter of the whole. To renew it: `npm pack` that package. The spatial scene
is our own: Plotly's needs WebGL, which takes seconds to start where no graphics card helps, and prints blank.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

FOLDER = Path(__file__).resolve().parent
LIBRARY, STYLE = FOLDER / "plotly-basic.min.js", FOLDER / "figures.css"
THEME = FOLDER / "theme.js"
"""Runs before anything is drawn."""
NAMES = (
    "chart",
    "glossary",
    "scene_input",
    "scene",
    "arm_views",
    "candidates",
    "what_if",
    "steps",
    "picture",
    "figures",
)
SCRIPTS = tuple(FOLDER / f"{name}.js" for name in NAMES)
"""In the order in which they are loaded; the library may come after them."""
SCRIPTS_OF_FLEET = tuple(FOLDER / f"{name}.js" for name in ("chart", "fleet"))


def text_of(scripts: Iterable[Path]) -> str:
    """Scripts one after the other."""
    return "\n".join(path.read_text(encoding="utf-8") for path in scripts)
