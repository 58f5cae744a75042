"""The page of `lrm-ident fleet`: pictures and the command's result as one self-contained HTML file."""

from __future__ import annotations

from html import escape

from lrm_ident.fleet.fleet_figures import fleet_figures
from lrm_ident.fleet.fleet_report import FleetResult, fleet_document
from lrm_ident.report.document import blocks_html
from lrm_ident.report.plain_names import plain_name
from lrm_ident.report.plots.interactive.assets import SCRIPTS_OF_FLEET
from lrm_ident.report.plots.interactive.values import values_text
from lrm_ident.workbench.html_report import standalone_page

BODY = """<header>
<h1>{title}</h1>
<p class="verdict">{verdict}</p>
<div class="lrm-controls screen-only"><label>sorted and coloured by <select id="lrm-tag"></select></label>
<span>a column is an arm, in all figures; click one to mark it</span>
<button type="button" id="lrm-theme">Light or dark</button></div>
<p class="lrm-soft" id="lrm-marked"></p>
</header>
<main>
<section>
<h2>Error of the tip, nominal and identified</h2>
<div id="lrm-errors" class="lrm-figure medium"></div>
</section>
<section>
<h2>Which effect is missing in which arm</h2>
<p class="lrm-soft">beside each name: in how many of the arms that could show it it was found, and how many of the kind
have it by that count (95 % interval); hollow: one of several causes that this arm's data cannot distinguish</p>
<div id="lrm-effects" class="lrm-figure"></div>
</section>
<section>
<h2>How alike the arms are</h2>
<div class="lrm-controls screen-only"><label>parameter <select id="lrm-key"></select></label></div>
<p class="lrm-soft">estimates with standard errors; the band is the spread from arm to arm about the mean</p>
<div id="lrm-parameter" class="lrm-figure medium"></div>
</section>
<section>
<h2>In words and numbers</h2>
<div class="lrm-numbers">
{blocks}
</div>
</section>
</main>
"""


def fleet_page(found: FleetResult, name: str) -> str:
    """The page's text; `name`: of the manifest."""
    title, document = f"Fleet: {name}", fleet_document(found)
    body = BODY.format(title=escape(title), verdict=escape(_verdict(found)), blocks=blocks_html(document.blocks))
    figures = values_text(fleet_figures(found))
    return standalone_page(title, body, figures, document, SCRIPTS_OF_FLEET, end="lrmFleet.show(lrmValues);")


def _verdict(found: FleetResult) -> str:
    """One sentence: how many arms, how far off, and the most frequent effect."""
    done = [record for record in found.records if not record.reason]
    words = f"{len(done)} of {len(found.records)} arms identified"
    common = None if isinstance(found.known, str) or not found.known.rates else found.known.rates[0]
    if common is not None and common.found > 0:
        words += f"; most often missing: {plain_name(common.name)}, in {common.words}"
    if odd := list(dict.fromkeys(one.arm for one in found.outliers)):
        words += f"; unlike its sisters: {', '.join(odd[:3])}" + (" and more" if len(odd) > 3 else "")
    return words + "."
