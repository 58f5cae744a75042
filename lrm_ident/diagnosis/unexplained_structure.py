"""Structure that no known effect explains: free functions of the remaining residual, and spurious effects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lrm_ident.data.weights.whitening import RowWeights
from lrm_ident.diagnosis.forward_selection import Selection, improves_prediction
from lrm_ident.diagnosis.screening.candidates import FORM
from lrm_ident.diagnosis.screening.column_sets import ColumnSets
from lrm_ident.diagnosis.screening.linearised_fit import LinearEstimate, LinearisedFit
from lrm_ident.residual.better_prediction import predicts_better
from lrm_ident.residual.free_functions import FreeFunction
from lrm_ident.residual.thresholds import MAX_FREE_FUNCTIONS, MIN_FREE_GAIN, PROMISING, SIMILAR_GAIN

RANKED, LIKELY = 5, 20  # functions ranked by held-out error; functions of least AIC that are cross-validated for it


@dataclass(frozen=True, eq=False)
class UnexplainedStructure:
    """Free functions of the residual beside the selected effects.

    Attributes:
        functions: selected ones outside the catalogue, all at one place; empty if none saves enough.
        spurious: names of the selected effects that they make needless, each with the first function.
        in_sample: residual sum of squares (m²) that each function would leave alone.
        fit, weigh: the fit with the selected effects; relative weights of the rows.
    """

    functions: tuple[FreeFunction, ...]
    spurious: dict[str, FreeFunction]
    in_sample: Mapping[FreeFunction, float]
    fit: LinearisedFit
    weigh: RowWeights

    @cached_property
    def ranking(self) -> tuple[tuple[FreeFunction, float], ...]:
        """The best functions by held-out RMS (m), which is computed for those of least AIC (Akaike 1974)."""
        count = len(self.fit.residual)
        likely = sorted(
            self.in_sample, key=lambda function: count * np.log(self.in_sample[function]) + 2 * function.size
        )[:LIKELY]
        tried = _explained(likely, self.fit, self.weigh)
        return tuple(
            (function, tried[function].rms)
            for function in sorted(likely, key=lambda function: tried[function].rms)[:RANKED]
        )


def unexplained_structure(
    selection: Selection, functions: Sequence[FreeFunction], weigh: RowWeights
) -> UnexplainedStructure:
    """Selects free functions beside the selected effects, and finds effects that do not improve the prediction beside
    these functions: they are spurious.

    A form of an effect that the model does not have may be part of a free function. As it names no cause, it is
    spurious only where the functions explain much more.

    Args:
        weigh: relative weights of the rows.
    """
    linear, fit = selection.steps[0].linear, selection.steps[-1].linear
    in_sample = _squares(functions, fit, weigh)
    free = _select_free(in_sample, fit, weigh)
    spurious: dict[str, FreeFunction] = {}
    if free:
        names = {name for function in free for name in function.covariates}
        followed = [
            quantity
            for quantity in functions
            if len(quantity.covariates) == 1 and quantity.place == free[0].place and quantity.covariates[0] in names
        ]
        among = _projected([*free, *followed], linear, weigh)
        most = linear.beside(*(scored.projected for scored in selection.effects), *among).baseline
        for scored in selection.effects:
            if scored.candidate.priority == FORM and _saves_as_much(scored.alone, most, linear.baseline):
                continue
            others = [other.projected for other in selection.effects if other is not scored]
            without = linear.beside(*others, *among)
            if not improves_prediction(without.explain(scored.projected), without.baseline, linear.baseline):
                spurious[scored.name] = free[0]
    return UnexplainedStructure(tuple(free), spurious, in_sample, fit, weigh)


def _saves_as_much(after: LinearEstimate, best: LinearEstimate, before: LinearEstimate) -> bool:
    """Whether an estimate saves `SIMILAR_GAIN` of the held-out squares that the best one saves."""
    saved, possible = (float((before.held_out - each.held_out).mean()) for each in (after, best))
    return saved > SIMILAR_GAIN * possible


def _projected(functions: Sequence[FreeFunction], fit: LinearisedFit, weigh: RowWeights) -> ColumnSets:
    """Weighted columns of each function, the fit's projected out."""
    return fit.project_each(
        (weigh(function.columns) for function in functions), [function.size for function in functions]
    )


def _by_place(functions: Sequence[FreeFunction]) -> list[list[FreeFunction]]:
    """Functions grouped by place, since the columns of all together need much memory."""
    return [
        [function for function in functions if function.place == place]
        for place in {function.place: None for function in functions}
    ]


def _explained(
    functions: Sequence[FreeFunction], fit: LinearisedFit, weigh: RowWeights
) -> dict[FreeFunction, LinearEstimate]:
    """Linear estimate of each function alone beside the fit."""
    return {
        function: estimate
        for here in _by_place(functions)
        for function, estimate in zip(here, fit.explain_each(_projected(here, fit, weigh)), strict=True)
    }


def _squares(functions: Sequence[FreeFunction], fit: LinearisedFit, weigh: RowWeights) -> dict[FreeFunction, float]:
    """Residual sum of squares (m²) that each function would leave alone, in the sample."""
    return {
        function: squares
        for here in _by_place(functions)
        for function, squares in zip(here, fit.residual_squares([weigh(f.columns) for f in here]).tolist(), strict=True)
    }


def _select_free(in_sample: Mapping[FreeFunction, float], fit: LinearisedFit, weigh: RowWeights) -> list[FreeFunction]:
    """Forward selection of functions outside the catalogue while one saves enough, all at the place of the first.

    Only functions that save enough in the sample to be `PROMISING` are cross-validated.
    """
    chosen: list[FreeFunction] = []
    candidates = {function: squares for function, squares in in_sample.items() if not function.in_catalogue}
    while len(chosen) < MAX_FREE_FUNCTIONS:
        most = fit.baseline.in_sample * (1.0 - PROMISING * (1.0 - (1.0 - MIN_FREE_GAIN) ** 2))
        tried = _explained([function for function, squares in candidates.items() if squares < most], fit, weigh)
        best = min(tried, key=lambda function: tried[function].rms, default=None)
        if best is None or not predicts_better(tried[best].held_out, fit.baseline.held_out, MIN_FREE_GAIN):
            break
        chosen.append(best)
        fit = fit.beside(_projected([best], fit, weigh))
        candidates = _squares(
            [function for function in candidates if function is not best and function.place == best.place], fit, weigh
        )
    return chosen
