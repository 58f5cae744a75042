"""`lrm-ident report`: findings as one self-contained HTML file that needs no network and prints well."""

from __future__ import annotations

from html import escape

from lrm_ident.plots.interactive.assets import LIBRARY, STYLE, scripts
from lrm_ident.plots.interactive.values import figure_values, values_text
from lrm_ident.report.document import Block, Document
from lrm_ident.report.document_html import blocks_html, table_html
from lrm_ident.workflow.findings import Findings

PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; script-src 'unsafe-inline';
 style-src 'unsafe-inline'; img-src data: blob:">
<title>{title}</title>
{theme}
<style>
{style}
{own_style}
</style>
</head>
<body>
<header>
<h1>{title}</h1>
<p class="verdict" id="lrm-verdict">{verdict}</p>
<p class="lrm-soft">{summary}</p>
<button type="button" class="screen-only" id="lrm-theme">Light or dark</button>
</header>
<main>
<section>
<h2>Where the arm is, and how far off the model</h2>
<p class="lrm-soft" id="lrm-scale"></p>
<div class="lrm-controls screen-only">
<label>step <select id="lrm-step"></select></label><label>shown <select id="lrm-beside"></select></label>
<label>pose <input id="lrm-pose" type="number"></label>
<select id="lrm-marked" aria-label="mark poses"></select><button type="button" id="lrm-clear">clear the marks</button>
<span id="lrm-brushed"></span>
</div>
<div class="lrm-fields"><div id="lrm-field" class="lrm-figure tall"></div>
<div id="lrm-field-b" class="lrm-figure tall"></div></div>
<div id="lrm-arm"></div>
<p class="lrm-soft">nominal arm dashed, bent arm solid, measured tool circled</p>
<p id="lrm-pose-note" class="lrm-soft"></p>
</section>
<section>
<h2>Where it fails</h2>
<div class="lrm-controls screen-only"><label>as a turn of <select id="lrm-joint"></select></label>
<label>against the <select id="lrm-driver"></select></label>
<span>drag a box around poses to mark them in every figure</span></div>
<div id="lrm-turn" class="lrm-figure medium"></div>
{comparison}
</section>
<section>
<h2>Which effect</h2>
<div class="two"><div><div id="lrm-ranking" aria-label="candidates"></div></div><div id="lrm-detail"></div></div>
<p class="lrm-soft screen-only">Choose an effect to see what it would add to the model.</p>
<div class="two"><div id="lrm-added" class="lrm-figure medium"></div>
<div id="lrm-form" class="lrm-figure medium"></div></div>
{diagnosis}
</section>
<section>
<h2>The steps so far</h2>
<div id="lrm-history" class="lrm-figure medium"></div>
{history}
</section>
<section>
<h2>Parameters</h2>
{parameters}
</section>
<section>
<h2>Provenance</h2>
{provenance}
</section>
</main>
<script type="application/json" id="lrm-values">{values}</script>
<script type="application/json" id="lrm-result">{result}</script>
<script>{script}</script>
<script>
document.getElementById("lrm-theme").onclick = () =>
  lrm.theme(document.documentElement.dataset.theme === "dark" ? "light" : "dark");
lrm.show(JSON.parse(document.getElementById("lrm-values").textContent));
window.addEventListener("beforeprint", () => lrm.print(true));
window.addEventListener("afterprint", () => lrm.print(false));
</script>
<script>{library}</script>
<script>lrm.ready();</script>
</body>
</html>
"""
THEME = """<script>
document.documentElement.dataset.theme = window.matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
</script>"""
"""Light or dark, as the browser asks for."""
OWN_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; margin: 0 auto; max-width: 1200px; padding: 16px; }
h1 { font-size: 22px; margin: 0; } h2 { font-size: 18px; border-bottom: 1px solid var(--grid); } h3 { font-size: 15px; }
.verdict { font-size: 18px; font-weight: 600; margin: 4px 0; }
.tall { height: 560px; } .medium { height: 380px; } .two .lrm-empty { display: none; }
.two { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(420px, 100%), 1fr)); gap: 16px; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; margin: 8px 0 16px; font-size: 13px; font-variant-numeric: tabular-nums; }
caption { text-align: left; font-weight: 600; padding: 4px 0; }
th, td { padding: 2px 10px 2px 0; text-align: left; vertical-align: top; border-bottom: 1px solid var(--grid); }
th.right, td.right { text-align: right; white-space: nowrap; }
td { overflow-wrap: anywhere; } ul { margin: 4px 0 8px; padding-left: 20px; } h4 { margin: 12px 0 2px; }
@media print {
  :root { color-scheme: light; }
  @page { size: A4; margin: 14mm; }
  body { max-width: none; padding: 0; font-size: 10pt; }
  .screen-only { display: none !important; }
  h2, h3, h4, caption { break-after: avoid; } tr, .lrm-figure, img { break-inside: avoid; }
  .medium { height: 300px; } .modebar { display: none; } details > * { display: block; }
}
"""


def html_report(found: Findings) -> str:
    """The report's text."""
    title = f"{found.file.arm}: model and measurements {found.poses.path.name}"
    document = found.document()
    return PAGE.format(
        title=escape(title),
        theme=THEME,
        style=STYLE.read_text(encoding="utf-8"),
        own_style=OWN_STYLE,
        library=LIBRARY.read_text(encoding="utf-8"),
        script=scripts(),
        verdict=escape(found.verdict),
        summary=escape(_summary(found)),
        comparison=blocks_html(_blocks(found.comparison)),
        diagnosis=blocks_html(_blocks(found.diagnosis)),
        history=table_html(found.history),
        parameters=table_html(found.parameters),
        provenance=table_html(found.provenance),
        values=values_text(figure_values(found)),
        result=document.json().replace("</", "<\\/"),
    )


def _blocks(part: Document | None) -> list[Block]:
    return [] if part is None else list(part.blocks)


def _summary(found: Findings) -> str:
    known = found.file.provenance
    made = "" if known is None else f"; fitted {known.date} with {known.tool}"
    return f"{found.field.poses} poses of {found.poses.path.name}{made}"
