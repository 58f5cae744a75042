"""`lrm-ident report`: a model report as one self-contained HTML file."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from pathlib import Path

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.wording import in_mm
from lrm_ident.report.document import Document, Facts, blocks_html, table_html
from lrm_ident.report.model_report import ModelReport
from lrm_ident.report.plain_names import step_title
from lrm_ident.report.plots.interactive.assets import LIBRARY, SCRIPTS, STYLE, THEME
from lrm_ident.report.plots.interactive.values import figure_values, values_text

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
BODY = """<header>
<h1>{title}</h1>
<p id="lrm-fall" class="lrm-fall"></p>
<p class="verdict" id="lrm-verdict">{verdict}</p>
<div id="lrm-facts">{facts}</div>
<p id="lrm-next"></p>
<p class="lrm-soft">{summary}</p>
<div class="lrm-controls screen-only"><button type="button" id="lrm-theme">Light or dark</button></div>
</header>
<main>
<section>
<h2>How the error fell</h2>
<p class="lrm-ladder">{ladder}</p>
<div id="lrm-history" class="lrm-figure low"></div>
<div id="lrm-cards"></div>
</section>
<section class="new-page">
<h2>Where the arm is, and how far off the model</h2>
<p class="lrm-soft" id="lrm-scale"></p>
<div class="lrm-controls screen-only">
<label>step <select id="lrm-step"></select></label><label>shown <select id="lrm-beside"></select></label>
<label>pose <input id="lrm-pose" type="number"></label>
<select id="lrm-marked" aria-label="mark poses"></select><button type="button" id="lrm-clear">clear the marks</button>
<span id="lrm-brushed"></span>
</div>
<div id="lrm-picture" class="lrm-controls screen-only"></div>
<div class="lrm-fields"><div id="lrm-field" class="lrm-figure tall"></div>
<div id="lrm-field-b" class="lrm-figure tall"></div></div>
<div id="lrm-arm"></div>
<p class="lrm-soft">bent arm solid, nominal arm outlined and dashed, measured tool circled</p>
<p id="lrm-pose-note" class="lrm-soft"></p>
</section>
<section>
<h2>Where it fails</h2>
<div class="lrm-controls screen-only"><label>as a turn of <select id="lrm-joint"></select></label>
<label>against the <select id="lrm-driver"></select></label>
<span>drag a box around poses to mark them in every figure</span></div>
<div id="lrm-turn" class="lrm-figure medium"></div>
<p class="lrm-sample lrm-soft"></p>
{comparison}
</section>
<section>
<h2>Which effect</h2>
<div class="two"><div><div id="lrm-ranking-head"></div><div id="lrm-ranking" aria-label="candidates"></div></div>
<div><div id="lrm-what-if" class="lrm-controls screen-only" hidden></div><div id="lrm-detail"></div></div></div>
<p class="lrm-soft screen-only">Choose an effect to see what it would add to the model.</p>
<div class="two"><div id="lrm-added" class="lrm-figure medium"></div>
<div id="lrm-form" class="lrm-figure medium"></div></div>
<p class="lrm-sample lrm-soft"></p>
{diagnosis}
</section>
<section>
<h2>The steps so far</h2>
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
"""
START = """
document.getElementById("lrm-theme").onclick = () => lrm.theme(lrmTheme());
lrmTheme.follow(lrm.theme);
lrm.show(lrmValues);
lrmGlossary(document.querySelector("main"));
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
        scripts="\n".join(path.read_text(encoding="utf-8") for path in scripts),
        start=f"<script>{start}</script>\n<script>{library}</script>\n<script>{end}</script>",
    )


def html_report(found: ModelReport) -> str:
    """The report's text."""
    arm, known = found.file.arm, found.file.provenance
    name = Path(arm).stem if arm.endswith(".toml") else arm  # of an arm file without its folder
    title = f"{name}: model and measurements {found.poses.path.name}"
    made = "" if known is None else f"; fitted {known.date[:10]} with {known.tool}"
    document = found.document()
    body = BODY.format(
        title=escape(title),
        verdict=escape(found.verdict),
        facts=blocks_html([Facts(found.facts)] if found.facts else ()),
        summary=escape(f"{found.field.poses} poses of {found.poses.path.name}{made}"),
        ladder=escape(_ladder(found)),
        comparison=blocks_html(found.comparison.whole if found.comparison else ()),
        diagnosis=blocks_html(found.diagnosis.whole if found.diagnosis else ()),
        history=table_html(found.history),
        parameters=table_html(found.parameters),
        provenance=table_html(found.provenance),
    )
    return standalone_page(title, body, values_text(figure_values(found)), document, SCRIPTS, START, "lrm.ready();")


def _ladder(found: ModelReport) -> str:
    """The error from the nominal arm over the fit to the last step, all on the open data."""
    nominal = f"nominal {in_mm(error_stats(found.field.nominal_residual).rms)} mm"
    steps = (f"{step_title(step.name)} {in_mm(step.error.rms)} mm" for step in found.field.steps)
    noise = "" if found.floor_mm is None else f"; noise {in_mm(found.floor_mm * 1e-3)} mm"
    return f"RMS on these data: {' → '.join([nominal, *steps])}{noise}."
