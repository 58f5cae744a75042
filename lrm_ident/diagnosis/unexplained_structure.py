"""Structure that no known effect explains: free functions on what the selected effects leave, and spurious effects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from lrm_ident.data.weights.row_weights import RowWeights
from lrm_ident.diagnosis.forward_selection import Selection, improves_prediction
from lrm_ident.diagnosis.screening.column_sets import ColumnSets
from lrm_ident.diagnosis.screening.linearised_fit import LinearEstimate, LinearisedFit
from lrm_ident.residual.better_prediction import predicts_better
from lrm_ident.residual.free_functions import FreeFunction
from lrm_ident.residual.thresholds import MAX_FREE_FUNCTIONS, MIN_FREE_GAIN


@dataclass(frozen=True, eq=False)
class UnexplainedStructure:
    """Free functions that explain what the selected effects leave.

    Attributes:
        functions: those outside the catalogue that save much, all at one place.
        spurious: name of a selected effect that they replace -> name of the first of them.
        ranking: the best five of all, with their held-out RMS (m).
    """

    functions: tuple[FreeFunction, ...]
    spurious: dict[str, str]
    ranking: tuple[tuple[FreeFunction, float], ...]


def unexplained_structure(
    selection: Selection, functions: Sequence[FreeFunction], weigh: RowWeights
) -> UnexplainedStructure:
    """Tries free functions on what the selected effects leave. `weigh`: relative weights of the rows."""
    linear, fit = selection.steps[0].fit, selection.steps[-1].fit
    tried: dict[FreeFunction, LinearEstimate] = {}
    for place in {one.place: None for one in functions}:  # one after the other: all columns together need much memory
        own = [one for one in functions if one.place == place]
        tried |= dict(zip(own, fit.explain_each(_projected(own, fit, weigh)), strict=True))
    ranking = sorted(((one, tried[one].rms) for one in functions), key=lambda one: one[1])
    free = _select_free(functions, tried, fit, weigh)
    spurious: dict[str, str] = {}
    if free:
        names = {name for function in free for name in function.covariates}
        own = [
            one
            for one in functions
            if len(one.covariates) == 1 and one.place == free[0].place and one.covariates[0] in names
        ]
        among = _projected([*free, *own], linear, weigh)
        for scored in selection.effects:
            others = [other.projected for other in selection.effects if other is not scored]
            without = linear.beside(*others, *among)
            if not improves_prediction(without.explain(scored.projected), without.now, linear.now):
                spurious[scored.name] = free[0].name
    return UnexplainedStructure(tuple(free), spurious, tuple(ranking[:5]))


def _projected(functions: Sequence[FreeFunction], fit: LinearisedFit, weigh: RowWeights) -> ColumnSets:
    return fit.project_each((weigh(one.columns) for one in functions), [one.size for one in functions])


def _select_free(
    functions: Sequence[FreeFunction],
    tried: Mapping[FreeFunction, LinearEstimate],
    fit: LinearisedFit,
    weigh: RowWeights,
) -> list[FreeFunction]:
    """Forward selection of free functions outside the catalogue while one saves enough, all at the place of the first.

    Args:
        tried: what each explains beside the fit.
    """
    chosen: list[FreeFunction] = []
    left = [one for one in functions if not one.in_catalogue]
    while left and len(chosen) < MAX_FREE_FUNCTIONS:
        best = min(left, key=lambda one: tried[one].rms)
        if not predicts_better(tried[best].held_out, fit.now.held_out, MIN_FREE_GAIN):
            break
        chosen.append(best)
        left = [one for one in left if one is not best and one.place == best.place]
        fit = fit.beside(_projected([best], fit, weigh))
        tried = dict(zip(left, fit.explain_each(_projected(left, fit, weigh)), strict=True)) if left else {}
    return chosen
