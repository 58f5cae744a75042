"""Report of `selftest`: what would be named for each injected effect."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING

from lrm_ident.data.wording import enumerate_words
from lrm_ident.diagnosis.screening.candidates import Refusal
from lrm_ident.report.diagnosis.diagnosis import untestable
from lrm_ident.report.document import Block, Document, ResultTable, heading, section

if TYPE_CHECKING:
    from lrm_ident.diagnosis.inject_recover import InjectionTrial

SHOWN = 8
OUTCOMES = {"found": "● found", "one of a class": "◐ one of several", "missed": "○ missed", "wrong": "✕ wrong",
            "failed": "! failed"}  # fmt: skip


def selftest_document(poses: int, trials: Sequence[InjectionTrial], refused: Sequence[Refusal]) -> Document:
    """Result of `lrm-ident selftest`, schema `lrm/selftest/1`: what would be named for each injected effect."""
    counts = Counter(trial.outcome for trial in trials)
    not_found = [trial for trial in trials if trial.outcome != "found"]
    named = f"{counts['found']} of {len(trials)} effects would be found with these {poses} poses"
    rest = ", ".join(f"{counts[outcome]} {outcome}" for outcome in OUTCOMES if outcome != "found" and counts[outcome])
    blocks: list[Block] = [heading(f"{named}{f' ({rest})' if rest else ''}.")]
    if not_found:
        blocks.append(_table(not_found[:SHOWN], "Not found, or not alone"))
    if len(not_found) > SHOWN:
        blocks.append(f"… and {len(not_found) - SHOWN} more; --all shows them")
    details = [_table(trials, "What would be named"), *section("\nNot testable", untestable(refused))]
    records = [
        {"truth": t.truth, "moved_rms_mm": t.moved * 1e3, "outcome": t.outcome, "named": t.named} for t in trials
    ]
    values = {"poses": poses, "trials": records}
    return Document(blocks, "lrm/selftest/1", values, details=details, about="every effect, and those not testable")


def _table(trials: Sequence[InjectionTrial], title: str) -> ResultTable:
    columns = ("hidden", "moves TCP mm|.2f", "outcome", "named")
    rows = [
        (t.truth, t.moved * 1e3, OUTCOMES[t.outcome], enumerate_words(t.named, 4) or t.error or t.verdict)
        for t in trials
    ]
    return ResultTable(columns, rows, title)
