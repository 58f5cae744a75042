"""The page of `lrm-ident fleet`: the command's result as one self-contained HTML file."""

from __future__ import annotations

from html import escape

from lrm_ident.page.html_report import OWN_STYLE, THEME
from lrm_ident.plots.interactive.assets import STYLE
from lrm_ident.report.document import Document
from lrm_ident.report.document_html import blocks_html

PAGE_OF_FLEET = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; script-src 'unsafe-inline';
 style-src 'unsafe-inline'">
<title>{title}</title>
{theme}
<script>window.addEventListener("beforeprint", () => {{ document.documentElement.dataset.theme = "light"; }});</script>
<style>
{style}
{own_style}
</style>
</head>
<body>
<header><h1>{title}</h1></header>
<main>
{blocks}
</main>
<script type="application/json" id="lrm-result">{result}</script>
</body>
</html>
"""


def fleet_page(document: Document, name: str) -> str:
    """The page's text; `name`: of the manifest."""
    return PAGE_OF_FLEET.format(
        title=escape(f"Fleet: {name}"),
        theme=THEME,
        style=STYLE.read_text(encoding="utf-8"),
        own_style=OWN_STYLE,
        blocks=blocks_html(document.blocks),
        result=document.json().replace("</", "<\\/"),
    )
