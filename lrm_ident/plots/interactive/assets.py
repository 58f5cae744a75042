"""The files that interactive figures need: Plotly's library, our scripts and style.

`plotly-basic.min.js` is that of the npm package plotly.js-basic-dist-min 3.7.0 (MIT, `plotly-LICENSE`), unchanged: the
part of Plotly that draws flat charts, a quarter of the whole. To renew it: `npm pack` that package. The spatial scene
is our own: Plotly's needs WebGL, which takes seconds to start where no graphics card helps, and prints blank.
"""

from __future__ import annotations

from pathlib import Path

FOLDER = Path(__file__).resolve().parent
LIBRARY, STYLE = FOLDER / "plotly-basic.min.js", FOLDER / "figures.css"
SCRIPTS = tuple(FOLDER / f"{name}.js" for name in ("scene_input", "scene", "arm_views", "figures"))
"""In the order in which they are loaded; the library may come after them."""


def scripts() -> str:
    """All of our scripts, one after the other."""
    return "\n".join(path.read_text(encoding="utf-8") for path in SCRIPTS)
