"""A page as one HTML file that needs no network and prints well: the report and a fleet's page."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from pathlib import Path

from lrm_ident.report.document import Document
from lrm_ident.report.plots.interactive.assets import LIBRARY, STYLE, THEME, text_of

PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; script-src 'unsafe-inline';
 style-src 'unsafe-inline'; img-src data: blob:">
<title>{title}</title>
<script>
{theme}
</script>
<style>
{style}
{own_style}
</style>
</head>
<body>
{body}
<script type="application/json" id="lrm-values">{values}</script>
<script type="application/json" id="lrm-result">{result}</script>
<script>{scripts}</script>
<script>const lrmValues = JSON.parse(document.getElementById("lrm-values").textContent);</script>
{start}
</body>
</html>
"""
OWN_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; margin: 0 auto; max-width: 1200px; padding: 16px; }
h1 { font-size: 22px; margin: 0; overflow-wrap: anywhere; }
h2 { font-size: 18px; border-bottom: 1px solid var(--grid); } h3 { font-size: 15px; }
.verdict { font-size: 18px; font-weight: 600; margin: 4px 0; }
.tall { height: 560px; } .medium { height: 380px; } .low { height: 260px; }
.lrm-ladder { font-weight: 600; } .two .lrm-empty { display: none; }
.two { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(420px, 100%), 1fr)); gap: 16px; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; margin: 8px 0 16px; font-size: 13px; font-variant-numeric: tabular-nums; }
caption { text-align: left; font-weight: 600; padding: 4px 0; }
th, td { padding: 2px 10px 2px 0; text-align: left; vertical-align: top; border-bottom: 1px solid var(--grid); }
th.right, td.right { text-align: right; }
td { overflow-wrap: break-word; } ul { margin: 4px 0 8px; padding-left: 20px; } h4 { margin: 12px 0 2px; }
@media screen { th.right, td.right { white-space: nowrap; } .wide td:not(.right) { min-width: 7em; }
  .wide td:last-child:not(.right) { min-width: 12em; } .wide td:empty { min-width: 0; } }
/* On a phone tables are smaller, with a shadow where more is beside. */
@media screen and (max-width: 500px) {
  .tall { height: 400px; } table { font-size: 12px; } th, td { padding-right: 6px; } th.right { white-space: normal; }
  .wide td:last-child:not(.right) { min-width: 0; } .stacked td:last-child { overflow-wrap: anywhere; }
  .wide { background: linear-gradient(to right, var(--paper) 30%, transparent) left / 24px 100% no-repeat local,
    linear-gradient(to left, var(--paper) 30%, transparent) right / 24px 100% no-repeat local,
    linear-gradient(to right, var(--line), transparent) left / 8px 100% no-repeat scroll,
    linear-gradient(to left, var(--line), transparent) right / 8px 100% no-repeat scroll; }
}
.lrm-paper body { max-width: none; padding: 0; font-size: 10pt; }
.lrm-paper .two { display: block; } .lrm-paper header p { margin: 3px 0; }
.lrm-paper h1 { font-size: 15px; font-weight: 600; }
.lrm-paper .verdict { font-size: 14px; } .lrm-paper h2 { font-size: 16px; margin: 3mm 0 1mm; }
.lrm-paper .lrm-ladder { margin: 1mm 0; font-size: 9pt; font-weight: 400; }
.lrm-paper .tall { height: 150mm; } .lrm-paper .medium { height: 72mm; } .lrm-paper .low { height: 38mm; }
"""


def standalone_page(
    title: str, body: str, values: str, document: Document, scripts: Sequence[Path], start: str, end: str = ""
) -> str:
    """The page's text.

    Args:
        body: HTML. values: what the figures show, as JSON that may stand in a `<script>` element.
        document: kept in the page as JSON.
        scripts: that draw the figures. start, end: JavaScript run before and after Plotly is loaded; both find the
            figures' values in `lrmValues`.
    """
    library = LIBRARY.read_text(encoding="utf-8")
    return PAGE.format(
        title=escape(title),
        theme=THEME.read_text(encoding="utf-8"),
        style=STYLE.read_text(encoding="utf-8"),
        own_style=OWN_STYLE,
        body=body,
        values=values,
        result=document.json().replace("</", "<\\/"),
        scripts=text_of(scripts),
        start=f"<script>{start}</script>\n<script>{library}</script>\n<script>{end}</script>",
    )
