"""The files that interactive figures need: Plotly's library, our scripts and style.

`page/`: what is chosen, and the words. `charts/`: flat charts. `scene/`: the picture of the arm.

`plotly/plotly-basic.min.js` is that of the npm package plotly.js-basic-dist-min 3.7.0 (MIT, `plotly-LICENSE`),
unchanged: the part of Plotly that draws flat charts, a quarter of the whole. To renew it: `npm pack` that package. The
spatial scene is our own: Plotly's needs WebGL, which takes seconds to start where no graphics card helps, and prints
blank.
"""

from __future__ import annotations

from pathlib import Path

from lrm_ident.report.glossary import terms_json

FOLDER = Path(__file__).resolve().parent
LIBRARY, STYLE = FOLDER / "plotly" / "plotly-basic.min.js", FOLDER / "page" / "figures.css"
PROLOGUE = f"const lrmTerms = {terms_json()};\n{(FOLDER / 'page' / 'theme.js').read_text(encoding='utf-8')}"
"""Runs before anything is drawn: the words that are explained; light or dark."""
TOLD, BESIDE, BELOW = (FOLDER / "page" / "panels.html").read_text(encoding="utf-8").split("<!-- next -->\n")
"""Of page and report: the words of the verdict, to be formatted; the panels beside them; those below."""
NAMES = (
    "page/elements", "charts/chart", "page/glossary", "page/sketches", "scene/pen", "scene/axes", "scene/arrows",
    "scene/solids", "scene/scene", "page/brush", "charts/candidates", "page/story", "page/steps", "scene/field",
    "page/controls", "page/figures",
)  # fmt: skip
SCRIPTS = tuple(FOLDER / f"{name}.js" for name in NAMES)
"""In the order in which they are loaded; the library may come after them."""
SCRIPTS_OF_FLEET, SCRIPTS_OF_MOTION = ((*SCRIPTS[:2], FOLDER / f"charts/{name}.js") for name in ("fleet", "motion"))
