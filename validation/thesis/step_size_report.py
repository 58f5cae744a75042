"""Report of `step-size`: the steps of central differences that are good enough."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lrm_ident.report.document import Block, Document, ResultTable
from validation.thesis.finite_difference_study import MAX_RELATIVE_ERROR, StepSizeStudy


def steps_document(studies: Sequence[StepSizeStudy], units: str) -> Document:
    """Result of `step-size`, schema `lrm/step-size/1`; its figure shows norm and error by step."""
    words = "rad, mm, rad/Nmm" if units == "thesis" else "typical sizes"
    good = f"error < {MAX_RELATIVE_ERROR:g} from … to|"
    columns = ("joints at", "parameters", "norm|.4g", "best step|.0e", "error|.0e", good)
    rows = []
    for study in studies:
        span = "never" if study.usable_range is None else "{:.0e} … {:.0e}".format(*study.usable_range)
        rows.append((f"{np.degrees(study.angle):.0f} deg", study.option, study.exact, *study.best, span))
    blocks: list[Block] = [ResultTable(columns, rows, f"Central differences, steps in {words}"), _common_span(studies)]
    collapsed = min((step for study in studies for step in study.no_equilibrium), default=None)
    if collapsed is not None:
        blocks.append(f"From {collapsed:.0e} on the arm collapses: a compliance that large has no equilibrium.")
    values = {
        "units": units,
        "studies": [
            {
                "joints_deg": round(float(np.degrees(study.angle)), 9),
                "parameters": study.option,
                "exact_norm": study.exact,
                "best_step": study.best[0],
                "best_relative_error": study.best[1],
                "good_steps": study.usable_range,
                "steps": study.steps,
                "norm": study.norm,
                "relative_error": study.error,
            }
            for study in studies
        ],
    }
    behind = ResultTable(
        ("joints_deg|g", "parameters", "step|.6g", "norm|.12g", "relative_error|.6g"),
        [
            (np.degrees(study.angle), study.option, *row)
            for study in studies
            for row in zip(study.steps, study.norm, study.error, strict=True)
        ],
    )
    return Document(blocks, "lrm/step-size/1", values, behind)


def _common_span(studies: Sequence[StepSizeStudy]) -> str:
    spans = [study.usable_range for study in studies if study.usable_range is not None]
    low, high = max((span[0] for span in spans), default=np.inf), min((span[1] for span in spans), default=0.0)
    if len(spans) == len(studies) and low <= high:
        return f"One step for all of them: {low:.0e} to {high:.0e}."
    return "No one step is good for all of them."
