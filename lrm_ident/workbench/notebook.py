"""HTML of results for a notebook: tables of the commands with the picture of `lrm.plot`, and the page of a report."""

from __future__ import annotations

import base64
from collections.abc import Iterable
from html import escape
from io import BytesIO

from lrm_ident.diagnosis.auto import AutoRun
from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport
from lrm_ident.diagnosis.symbolic_regression.proposal import LawProposal
from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_ident.report.diagnosis.course import attribution_blocks, proposal_document, step_blocks
from lrm_ident.report.diagnosis.diagnosis import diagnosis_document
from lrm_ident.report.document import Block, blocks_html, heading
from lrm_ident.report.fit import comparison_document, parameter_table
from lrm_ident.report.model_report import history_table, quick_report, with_comparison, with_diagnosis
from lrm_ident.report.plots.plot import plot
from lrm_ident.report.plots.style import DPI
from lrm_ident.report.story import story_of_file
from lrm_ident.residual.error_breakdown import ModelComparison
from lrm_ident.study.study import Study
from lrm_ident.workbench.html_report import html_report
from lrm_math.errors import LrmError

FRAME = (
    "<style>.lrm-page {{ width: 100%; height: 900px; border: 0; }} "
    ':is([data-jp-theme-light="false"], .vscode-dark, .dark) .lrm-page {{ color-scheme: dark; }}</style>'
    '<iframe class="lrm-page" title="error field and report" sandbox="allow-scripts" srcdoc="{page}"></iframe>'
)
"""A frame as dark as the notebook around it: of Jupyter, VS Code or marimo."""

STYLE = (
    "<style>.lrm-shown table { border-collapse: collapse; margin: 4px 0 12px; font-variant-numeric: tabular-nums; } "
    ".lrm-shown caption { text-align: left; font-weight: 600; } .lrm-shown :is(th, td) { text-align: left !important; "
    "padding: 2px 10px 2px 0; vertical-align: top !important; } "
    ".lrm-shown :is(th, td).right { text-align: right !important; } .lrm-shown p { margin: 4px 0 10px; } "
    ".lrm-shown :is(h2, h3, h4) { font-size: 1.15em; font-weight: 600; margin: 12px 0 4px; } "
    ".lrm-shown ul { list-style: disc; padding-left: 1.5em; }</style>"
)
"""Of text and tables, which a notebook shows without the page's style, and with one of its own that goes before."""


def html_of(result: object) -> str:
    """HTML of a result. Raises `LrmError` for what is none."""
    match result:
        case ModelComparison():
            return _tables(comparison_document(result).whole) + _picture(result)
        case DiagnosisReport():
            return _tables(diagnosis_document(result).whole) + _picture(result)
        case AutoRun(steps=taken):
            steps: list[Block] = [block for k in range(len(taken)) for block in step_blocks(taken[: k + 1])]
            return _tables([*steps, *attribution_blocks(result)]) + html_of(result.report)
        case LawProposal():
            return _tables(proposal_document(result).blocks)
        case Fit():
            return _tables([parameter_table(result)])
        case Study():
            try:
                story = story_of_file(result.file)
                told: list[Block] = [] if story is None else [heading(story.sentence), story.table()]
                return _tables([*told, history_table(result.file), *map(str, result.notices)])
            except LrmError as error:
                return f"<p>{escape(str(error))}</p>"
    raise LrmError(f"no picture is known for a {type(result).__name__}")


def page_of(study: Study) -> str:
    """A frame with the page that `lrm-ident report` writes: error field, where it fails, what is missing, cards."""
    report = with_comparison(quick_report(study), study.compare())
    page = html_report(with_diagnosis(report, study.diagnose()))
    return FRAME.format(page=escape(page, quote=True))


def _tables(blocks: Iterable[Block]) -> str:
    return f'{STYLE}<div class="lrm-shown">{blocks_html(blocks)}</div>'


def _picture(result: object) -> str:
    drawn = BytesIO()
    plot(result).savefig(drawn, dpi=DPI, format="png")
    text = base64.b64encode(drawn.getvalue()).decode()
    return f'<img alt="figure of the tables above" style="max-width:100%" src="data:image/png;base64,{text}">'
