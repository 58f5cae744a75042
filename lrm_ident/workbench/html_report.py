"""`lrm-ident report`: a model report as one self-contained HTML file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import Any

from lrm_ident.report.document import Block, Document, Facts, blocks_html, table_html
from lrm_ident.report.model_report import ModelReport, history_table, provenance_table
from lrm_ident.report.plots.interactive.assets import BELOW, BESIDE, LIBRARY, PROLOGUE, SCRIPTS, STYLE, TOLD
from lrm_ident.report.plots.interactive.values import figure_values, values_text
from lrm_ident.workbench.work.tasks import section_html

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
body { font: 15px/1.45 system-ui, sans-serif; margin: 0 auto; max-width: 1280px; padding: 12px 16px 40px; }
h1 { font-size: 15px; font-weight: 600; margin: 0; overflow-wrap: anywhere; }
h2 { font-size: 18px; } h3 { font-size: 15px; }
header { display: flex; flex-wrap: wrap; gap: 4px 16px; align-items: center; } header p { margin: 0; }
.verdict { font-size: 18px; font-weight: 600; margin: 4px 0; }
.medium { height: 380px; }
@media (max-width: 500px) {
  header { flex-wrap: wrap; } header h1 { flex: 1; } header p { order: 1; flex-basis: 100%; font-size: 12px; }
  header .lrm-controls:has(label) { order: 2; }
}
.lrm-paper body { max-width: none; padding: 0; font-size: 10pt; }
.lrm-paper header p { margin: 3px 0; }
.lrm-paper .verdict { font-size: 14px; } .lrm-paper h2 { font-size: 16px; margin: 3mm 0 1mm; }
.lrm-paper .medium { height: 72mm; }
"""
FRAME = """<header>
<h1>{title}</h1>
{said}
<div class="lrm-controls screen-only">{controls}<button type="button" id="lrm-theme">Light or dark</button></div>
{marked}</header>
<main>
{main}
</main>
"""
MAIN = """<div class="lrm-hero">
<div class="lrm-told">
{told}
</div>
{beside}
</div>
{below}
<div class="lrm-numbers">
{numbers}
</div>"""
MARKED = '<p class="lrm-soft" id="lrm-marked"></p>\n'
START = 'lrm.show(lrmValues);\nlrmGlossary(document.querySelector(".lrm-numbers"));'


def standalone_page(
    title: str, body: str, values: str, document: Document, scripts: Sequence[Path], start: str = "", end: str = ""
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
        theme=PROLOGUE,
        style=STYLE.read_text(encoding="utf-8"),
        own_style=OWN_STYLE,
        body=body,
        values=values,
        result=document.json().replace("</", "<\\/"),
        scripts="\n".join(path.read_text(encoding="utf-8") for path in scripts),
        start=f"<script>{start}</script>\n<script>{library}</script>\n<script>{end}</script>",
    )


def plain_page(
    title: str,
    verdict: str,
    figures: Mapping[str, str],
    values: Mapping[str, Any],
    document: Document,
    blocks: Sequence[Block],
    scripts: Sequence[Path],
    controls: str = "",
) -> str:
    """A page of figures below each other; the last of the `scripts`, `lrm*.show`, draws them.

    Args:
        figures: HTML of each, by its heading. blocks: the result in words and numbers. controls: HTML beside the title.
    """
    numbers = f'<div class="lrm-numbers">\n{blocks_html(blocks)}\n</div>'
    parts = {**figures, "In words and numbers": numbers}
    sections = "\n".join(f"<section>\n<h2>{heading}</h2>\n{html}\n</section>" for heading, html in parts.items())
    said = f'<p class="verdict">{escape(verdict)}</p>'
    body = FRAME.format(title=escape(title), said=said, controls=controls, marked=MARKED, main=sections)
    show = f"lrm{scripts[-1].stem.capitalize()}.show(lrmValues);"
    return standalone_page(title, body, values_text(values), document, scripts, end=show)


def html_report(report: ModelReport) -> str:
    """The report's text."""
    arm, provenance = report.file.arm, report.file.provenance
    name = Path(arm).stem if arm.endswith(".toml") else arm  # of an arm file without its folder
    title = f"{name}: model and measurements {report.poses.source.path.name}"
    made = "" if provenance is None else f"; fitted {provenance.date[:10]} with {provenance.tool}"
    document = report.document()
    sentence = "" if report.story is None else report.story.sentence
    facts = blocks_html([Facts(report.facts)] if report.facts else ())
    said = f'<p class="lrm-soft">{escape(f"{report.field.poses} poses of {report.poses.source.path.name}{made}")}</p>'
    told = TOLD.format(verdict=escape(report.verdict), sentence=escape(sentence), facts=facts)
    main = MAIN.format(told=told, beside=BESIDE, below=BELOW, numbers=numbers_html(report))
    body = FRAME.format(title=escape(title), said=said, controls="", marked="", main=main)
    return standalone_page(title, body, values_text(figure_values(report)), document, SCRIPTS, START, "lrm.ready();")


def numbers_html(report: ModelReport) -> str:
    """All tables of a report, each section folded."""
    sections = {
        "Details of the diagnosis": blocks_html(report.diagnosis.details if report.diagnosis else ()),
        "Details of the comparison": blocks_html(report.comparison.whole if report.comparison else ()),
        "Steps": table_html(replace(history_table(report.file), title="")),
        "Parameters": table_html(report.parameters),
        "Where the model comes from": table_html(replace(provenance_table(report.file), title="")),
    }
    return "".join(section_html(title, text) for title, text in sections.items())
