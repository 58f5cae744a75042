"""Report of `selftest`: what would be named for each injected effect."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from lrm_ident.data.wording import enumerate_words
from lrm_ident.report.diagnosis.diagnosis import untestable
from lrm_ident.report.document import Document, ResultTable, section
from lrm_math.effects import Effect

if TYPE_CHECKING:
    from lrm_ident.diagnosis.inject_recover import InjectionTrial

OUTCOMES = {"found": "● found", "one of a class": "◐ one of a class", "missed": "○ missed", "wrong": "✕ wrong"}


def selftest_document(poses: int, trials: Sequence[InjectionTrial], refused: Sequence[tuple[Effect, str]]) -> Document:
    """Result of `lrm-ident selftest`, schema `lrm/selftest/1`: what would be named for each injected effect."""
    columns = ("hidden", "moves TCP mm|.2f", "outcome", "named")
    rows = [(t.truth, t.moved * 1e3, OUTCOMES[t.outcome], enumerate_words(t.named, 4) or t.verdict) for t in trials]
    counts = (f"{sum(trial.outcome == outcome for trial in trials)} {outcome}" for outcome in OUTCOMES)
    blocks = [
        ResultTable(columns, rows, "What would be named"),
        *section("\nNot testable", untestable(refused)),
        f"\n{len(trials)} effects: {', '.join(counts)}",
    ]
    records = [
        {"truth": t.truth, "moved_rms_mm": t.moved * 1e3, "outcome": t.outcome, "named": t.named} for t in trials
    ]
    return Document(blocks, "lrm/selftest/1", {"poses": poses, "trials": records})
