"""Head of the page: styles, scripts, and the colours that the browser asks for."""

from __future__ import annotations

from pathlib import Path

from lrm_ident.report.plots.interactive import assets

FOLDER = Path(__file__).parent
FILES = {
    "/lrm/static": (assets.LIBRARY, *assets.SCRIPTS, assets.STYLE),
    "/lrm/tab": (FOLDER / "workbench.css", FOLDER / "workbench.js"),
}
"""Files that the page fetches, by their folder in the address."""


def head_html() -> str:
    """HTML of the head. The library of charts is the largest file; nothing waits for it."""
    addresses = [f"{folder}/{file.name}" for folder, files in FILES.items() for file in files]
    styles = "".join(f'<link rel="stylesheet" href="{one}">' for one in addresses if one.endswith(".css"))
    library, *scripts = [one for one in addresses if one.endswith(".js")]
    return f"""{styles}
<script async src="{library}" onload="window.lrm && lrm.ready()"></script>
{"".join(f'<script defer src="{one}"></script>' for one in scripts)}
<script>{assets.THEME.read_text(encoding="utf-8")}
document.documentElement.lang = "en";
addEventListener("load", () => Quasar.LoadingBar.setDefaults({{ hijackFilter: () => false }}));
addEventListener("load", () => Quasar.Dark.set(document.documentElement.dataset.theme === "dark"));
window.lrmEmit = (name, value) => emitEvent(name, value);</script>"""
