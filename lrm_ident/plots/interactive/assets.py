"""The files that interactive figures need: Plotly's library, our script and style."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

from lrm_math.errors import LrmError

FOLDER = Path(__file__).resolve().parent
SCRIPT, STYLE = FOLDER / "figures.js", FOLDER / "figures.css"


def plotly_library() -> Path:
    """Plotly's JavaScript library. Raises `LrmError` if it is not installed."""
    found = find_spec("plotly")
    places = [] if found is None else [Path(folder) for folder in found.submodule_search_locations or ()]
    for folder in places:
        file = folder / "package_data" / "plotly.min.js"
        if file.is_file():
            return file
    raise LrmError("this needs the package 'plotly', which is not installed: pip install 'lrm-arm[page]'")
