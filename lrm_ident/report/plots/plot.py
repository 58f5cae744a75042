"""Figures of results, by their kind: `lrm.plot`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport
from lrm_ident.report.plots.comparison import draw_comparison
from lrm_ident.report.plots.diagnosis import draw_report
from lrm_ident.report.plots.story import draw_story
from lrm_ident.report.story import story_of_file
from lrm_ident.residual.error_breakdown import ModelComparison
from lrm_ident.study.study import Study
from lrm_math.errors import LrmError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHOULD = "should be a study with a fit, or the result of compare or diagnose"


def plot(result: object, path: str | Path | None = None) -> Figure:
    """Draws a study's fall of the error, a comparison or a diagnosis; also to a PNG, SVG or PDF file.

    Raises `LrmError`: nothing that can be drawn; `FileError`: a format or place that cannot be written.
    """
    to = None if path is None else Path(path)
    if isinstance(result, ModelComparison):
        return draw_comparison(result, to)
    if isinstance(result, DiagnosisReport):
        return draw_report(result, to)
    story = story_of_file(result.file) if isinstance(result, Study) else None
    if story is None:
        raise LrmError(f"{path or 'figure'}: cannot plot a {type(result).__name__}; {SHOULD}")
    return draw_story(story, to)
