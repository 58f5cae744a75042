"""Structure that no known effect explains: free functions on what the selected effects leave, and spurious effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lrm_ident.data.weights.row_weights import RowWeights
from lrm_ident.diagnosis.column_sets import ColumnSets
from lrm_ident.diagnosis.forward_selection import Selection, improves_prediction
from lrm_ident.diagnosis.linearised_fit import Explanation, LinearisedFit, paired_z
from lrm_ident.diagnosis.score_test import Z_THRESHOLD
from lrm_ident.residual.free_functions import FreeFunction

MIN_FREE_GAIN = 0.10  # part of the held-out RMS that a free function must save to be unexplained structure
MAX_FREE_FUNCTIONS = 3


@dataclass(frozen=True, eq=False)
class UnexplainedStructure:
    """Free functions that explain what the selected effects leave.

    Attributes:
        functions: those outside the catalogue that save much, all at one joint.
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
    ready = linear.project_each([weigh(one.columns) for one in functions])
    beside = fit.up_to_date(ready)
    tried = fit.explain_each(beside)
    ranking = sorted(((one, found.rms) for one, found in zip(functions, tried, strict=True)), key=lambda one: one[1])
    free = _select_free(functions, beside, tried, fit)
    spurious: dict[str, str] = {}
    if free:
        names = {name for number in free for name in functions[number].covariates}
        joint = functions[free[0]].joint
        own = [
            number
            for number, function in enumerate(functions)
            if len(function.covariates) == 1 and function.joint == joint and function.covariates[0] in names
        ]
        among = [ready[number] for number in (*free, *own)]
        for one in selection.effects:
            others = [other.projected for other in selection.effects if other is not one]
            without = linear.beside(*others, *among)
            if not improves_prediction(without.explain(one.projected), without.now, linear.now):
                spurious[one.name] = functions[free[0]].name
    return UnexplainedStructure(tuple(functions[number] for number in free), spurious, tuple(ranking[:5]))


def _select_free(
    functions: Sequence[FreeFunction], sets: ColumnSets, tried: Sequence[Explanation], fit: LinearisedFit
) -> list[int]:
    """Forward selection of free functions outside the catalogue while one saves enough, all at the joint of the first.

    Args:
        sets: their columns. tried: what each explains beside the fit.
    """
    chosen: list[int] = []
    left = [number for number, function in enumerate(functions) if not function.in_catalogue]
    while left and len(chosen) < MAX_FREE_FUNCTIONS:
        best = min(left, key=lambda number: tried[number].rms)
        then, now = tried[best], fit.now
        if then.rms > (1.0 - MIN_FREE_GAIN) * now.rms or paired_z(then.held_out, now.held_out) < Z_THRESHOLD:
            break
        chosen.append(best)
        left = [one for one in left if one != best and functions[one].joint == functions[best].joint]
        fit = fit.beside(sets[best])
        sets = fit.up_to_date(sets)
        tried = fit.explain_each(sets)
    return chosen
