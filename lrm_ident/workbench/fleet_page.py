"""The page of `lrm-ident fleet`: pictures and the command's result as one self-contained HTML file."""

from __future__ import annotations

from lrm_ident.fleet.fleet_figures import fleet_figures
from lrm_ident.fleet.fleet_report import FleetResult, fleet_document, rate_words
from lrm_ident.report.plain_names import plain_name
from lrm_ident.report.plots.interactive.assets import SCRIPTS_OF_FLEET
from lrm_ident.workbench.html_report import plain_page

CONTROLS = """<label>sorted and coloured by <select id="lrm-tag"></select></label>
<span>a column is an arm, in all figures; click one to mark it</span>
"""
MISSING = "Which effect is missing in which arm"
NONE_MISSING = '<p id="lrm-effects">No arm has an effect beyond the plain model.</p>'
FIGURES = {
    "Error of the tip, nominal and identified": '<div id="lrm-errors" class="lrm-figure medium"></div>',
    MISSING: """<p class="lrm-soft">beside each name: in how many of the arms that could
show it it was found, and how many of the kind have it by that count (95 % interval); hollow: one of several causes that
this arm's data cannot distinguish</p>
<div id="lrm-effects" class="lrm-figure"></div>""",
    "How alike the arms are": """<div class="lrm-controls screen-only">
<label>parameter <select id="lrm-key"></select></label></div>
<p class="lrm-soft">estimates with standard errors; the band is the spread from arm to arm about the mean</p>
<div id="lrm-parameter" class="lrm-figure medium"></div>""",
}


def fleet_page(result: FleetResult, name: str) -> str:
    """The page's text; `name`: of the manifest."""
    title, document, figures = f"Fleet: {name}", fleet_document(result), fleet_figures(result)
    blocks = document.blocks
    panels = FIGURES if figures["effects"] else {**FIGURES, MISSING: NONE_MISSING}
    return plain_page(title, _verdict(result), panels, figures, document, blocks, SCRIPTS_OF_FLEET, CONTROLS)


def _verdict(result: FleetResult) -> str:
    """One sentence: how many arms, how far off, and the most frequent effect."""
    done = [record for record in result.records if not record.reason]
    words = f"{len(done)} of {len(result.records)} arms identified"
    common = None if isinstance(result.known, str) or not result.known.rates else result.known.rates[0]
    if common is not None and common.found > 0:
        words += f"; most often missing: {plain_name(common.name)}, in {rate_words(common)}"
    if odd := list(dict.fromkeys(outlier.arm for outlier in result.outliers)):
        words += f"; unlike its sisters: {', '.join(odd[:3])}" + (" and more" if len(odd) > 3 else "")
    return words + "."
