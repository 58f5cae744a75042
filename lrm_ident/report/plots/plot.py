"""Figures of results, by their kind: `lrm.plot`."""

from __future__ import annotations

from pathlib import Path

from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport
from lrm_ident.report.plots.comparison import draw_comparison
from lrm_ident.report.plots.diagnosis import draw_report
from lrm_ident.residual.error_breakdown import ModelComparison
from lrm_math.errors import LrmError


def plot(result: object, path: str | Path) -> None:
    """Draws a comparison or a diagnosis as PNG, SVG or PDF. Raises `FileError`."""
    if isinstance(result, ModelComparison):
        draw_comparison(result, Path(path))
    elif isinstance(result, DiagnosisReport):
        draw_report(result, Path(path))
    else:
        raise LrmError(f"{path}: cannot plot a {type(result).__name__}; should be the result of compare or diagnose")
