"""View of a step on the page, made where it was computed, so that the page's process only passes it on."""

from __future__ import annotations

from lrm_ident.report.document import Block, Document
from lrm_ident.report.document_html import blocks_html, table_html
from lrm_ident.report.model_report import ModelReport
from lrm_ident.report.plots.interactive.values import figure_values, values_text
from lrm_ident.study.model_history import model_text, undo_step
from lrm_ident.workbench.section import section_html
from lrm_ident.workbench.work.tasks import StepView


def step_shown(found: ModelReport) -> StepView:
    """Title, verdict, figures and tables of a report."""
    file = found.file
    return StepView(
        title=f"{file.arm} · {found.poses.path.name} · {found.field.poses} poses",
        data_sha256=found.poses.sha256,
        verdict=found.verdict,
        diagnosed=found.diagnosis is not None,
        values=values_text(figure_values(found)),
        numbers=_numbers(found),
        model=model_text(file),
        before=model_text(undo_step(file)) if len(file.history) > 1 else None,
    )


def _numbers(found: ModelReport) -> str:
    sections = {
        "What is missing, and what these data cannot show": _html(found.diagnosis),
        "Where it fails": _html(found.comparison),
        "Steps": table_html(found.history),
        "Parameters": table_html(found.parameters),
        "Provenance": table_html(found.provenance),
    }
    return "".join(section_html(title, text) for title, text in sections.items())


def _html(part: Document | None) -> str:
    blocks: list[Block] = [] if part is None else list(part.blocks)
    return blocks_html(blocks)
