"""`lrm-ident report`: a model report as one self-contained HTML file."""

from __future__ import annotations

from html import escape
from pathlib import Path

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.wording import in_mm
from lrm_ident.report.document import Block, Document
from lrm_ident.report.document_html import blocks_html, table_html
from lrm_ident.report.model_report import ModelReport
from lrm_ident.report.plain_names import step_title
from lrm_ident.report.plots.interactive.assets import SCRIPTS
from lrm_ident.report.plots.interactive.values import figure_values, values_text
from lrm_ident.workbench.standalone import standalone_page

BODY = """<header>
<h1>{title}</h1>
<p id="lrm-fall" class="lrm-fall"></p>
<p class="verdict" id="lrm-verdict">{verdict}</p>
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


def html_report(found: ModelReport) -> str:
    """The report's text."""
    title = f"{_arm_name(found.file.arm)}: model and measurements {found.poses.path.name}"
    document = found.document()
    body = BODY.format(
        title=escape(title),
        verdict=escape(found.verdict),
        summary=escape(_summary(found)),
        ladder=escape(_ladder(found)),
        comparison=blocks_html(_blocks(found.comparison)),
        diagnosis=blocks_html(_blocks(found.diagnosis)),
        history=table_html(found.history),
        parameters=table_html(found.parameters),
        provenance=table_html(found.provenance),
    )
    return standalone_page(title, body, values_text(figure_values(found)), document, SCRIPTS, START, "lrm.ready();")


def _arm_name(arm: str) -> str:
    """A shipped arm's name, or that of an arm file without its folder."""
    return Path(arm).stem if arm.endswith(".toml") else arm


def _blocks(part: Document | None) -> list[Block]:
    return [] if part is None else list(part.blocks)


def _ladder(found: ModelReport) -> str:
    """The error from the nominal arm over the fit to the last step, all on the open data."""
    nominal = f"nominal {in_mm(error_stats(found.field.nominal_residual).rms)} mm"
    steps = (f"{step_title(step.name)} {in_mm(step.error.rms)} mm" for step in found.field.steps)
    noise = "" if found.floor_mm is None else f"; noise {in_mm(found.floor_mm * 1e-3)} mm"
    return f"RMS on these data: {' → '.join([nominal, *steps])}{noise}."


def _summary(found: ModelReport) -> str:
    known = found.file.provenance
    made = "" if known is None else f"; fitted {known.date[:10]} with {known.tool}"
    return f"{found.field.poses} poses of {found.poses.path.name}{made}"
