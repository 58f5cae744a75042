"""The files that interactive figures need: Plotly's library, our script and style.

`plotly-gl3d.min.js` is that of the npm package plotly.js-gl3d-dist-min 3.7.0 (MIT, `plotly-LICENSE`), unchanged: the
part of Plotly that draws flat and spatial scatters, a third of the whole. To renew it: `npm pack` that package.
"""

from __future__ import annotations

from pathlib import Path

FOLDER = Path(__file__).resolve().parent
LIBRARY, SCRIPT, STYLE = FOLDER / "plotly-gl3d.min.js", FOLDER / "figures.js", FOLDER / "figures.css"
