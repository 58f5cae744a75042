"""Report of what is left to find: what a nameless model predicts, the bound of the noise, and regimes in words."""

from __future__ import annotations

from lrm_ident.data.wording import in_mm
from lrm_ident.report.document import Block, section
from lrm_ident.residual.predictable_residual import PredictableResidual


def left_blocks(left: PredictableResidual) -> list[Block]:
    """One sentence on what could be predicted, and one on each regime."""
    regimes = section("\nWhere what is left is concentrated", (regime.sentence for regime in left.regimes))
    return [left.predictable.sentence, *regimes]


def left_values(left: PredictableResidual) -> dict[str, object]:
    """The entries `nameless`, `noise_bound_rms_mm` and `regimes` of a diagnosis."""
    return {
        "nameless": left.predictable,
        "noise_bound_rms_mm": left.predictable.noise_bound * 1e3,
        "regimes": left.regimes,
    }


def noise_words(floor_mm: float | None, source: str, left: PredictableResidual) -> str:
    """The noise floor, or its upper bound where it is not known."""
    if floor_mm is None:
        return f"unknown (at most {in_mm(left.predictable.noise_bound)} mm: the rest can be predicted)"
    return f"{in_mm(floor_mm * 1e-3)} mm ({source})"
