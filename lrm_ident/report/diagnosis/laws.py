"""Report of `propose`: the proposed law, how it was judged, its class, and poses that would be informative."""

from __future__ import annotations

import numpy as np

from lrm_ident.data.wording import in_mm, p_words
from lrm_ident.diagnosis.symbolic_regression.proposal import LawProposal
from lrm_ident.report.document import Block, Document, ResultTable, heading

SHOWN = 8


def proposal_document(found: LawProposal) -> Document:
    """Result of `lrm-ident propose`, schema `lrm/proposal/1`."""
    judged = (
        f"{found.tried} laws were tried at all joints. Held out, the model alone has {in_mm(found.before.rms)} mm; "
        f"with a law chosen anew in every block (nested) about {in_mm(found.nested)} mm. Against pure noise: "
        f"p {p_words(found.p_value)}."
    )
    best = found.best
    values: dict[str, object] = {
        "laws_tried": found.tried,
        "p_value": found.p_value,
        "held_out_before": found.before,
        "nested_held_out_rms_mm": found.nested * 1e3,
        "proposed": None if best is None else {"joint": best.law.joint + 1, "formula": best.law.formula},
        "held_out": None if best is None else best.error,
        "reason": found.reason,
        "indistinguishable_from": [
            {"joint": law.joint + 1, "formula": law.formula, "held_out_rms_mm": rms * 1e3}
            for law, rms in found.equivalent
        ],
        "next_poses_deg": None if found.next_poses is None else np.degrees(found.next_poses).round(1),
    }
    if best is None:
        return Document([heading(f"No law is proposed: {found.reason}."), judged], "lrm/proposal/1", values)
    blocks: list[Block] = [
        heading(f"Proposed: {best.law.formula}"),
        judged,
        f"Refitted with everything else, it leaves {in_mm(best.error.rms)} mm held out.",
    ]
    if found.equivalent:
        rows = [(law.formula, rms * 1e3) for law, rms in found.equivalent[:SHOWN]]
        blocks.append(ResultTable(("law", "held out ≈ mm|.2f"), rows, "These data cannot tell it from"))
    if found.next_poses is not None and len(found.next_poses):
        columns = ("pose|", *(f"q{i + 1}|.0f" for i in range(found.next_poses.shape[1])))
        lines = [(number, *row) for number, row in enumerate(np.degrees(found.next_poses).tolist(), start=1)]
        blocks.append(ResultTable(columns, lines, "Poses (deg) at which they differ most"))
    return Document(blocks, "lrm/proposal/1", values)
