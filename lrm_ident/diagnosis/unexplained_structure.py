"""Structure that no known effect explains: free functions on what the selected effects leave, and spurious effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from lrm_ident.data.weights.row_weights import RowWeights
from lrm_ident.diagnosis.forward_selection import improves_prediction
from lrm_ident.diagnosis.linearised_fit import LinearisedFit, ProjectedColumns, paired_z
from lrm_ident.diagnosis.score_test import Z_THRESHOLD, ScoredCandidate
from lrm_ident.residual.free_functions import FreeFunction

MIN_FREE_GAIN = 0.10  # part of the held-out RMS that a free function must save to be unexplained structure
MAX_FREE_FUNCTIONS = 3
Projected = tuple[FreeFunction, ProjectedColumns]


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
    selected: Sequence[ScoredCandidate], linear: LinearisedFit, functions: Sequence[FreeFunction], weigh: RowWeights
) -> UnexplainedStructure:
    """Tries free functions on what the selected effects leave. `weigh`: relative weights of the rows."""
    taken = [one.projected for one in selected]
    ready = list(zip(functions, linear.project_each([weigh(one.columns) for one in functions]), strict=True))
    tried = [(function, linear.explain(*taken, columns).rms) for function, columns in ready]
    ranking = tuple(sorted(tried, key=lambda one: one[1])[:5])
    free = _select_free(taken, [one for one in ready if not one[0].in_catalogue], linear)
    spurious: dict[str, str] = {}
    if free:
        names = {name for function, _ in free for name in function.covariates}
        joint = free[0][0].joint
        beside = [p for f, p in ready if len(f.covariates) == 1 and f.joint == joint and f.covariates[0] in names]
        among = [*(columns for _, columns in free), *beside]
        for one in selected:
            others = [other.projected for other in selected if other is not one]
            without, with_it = linear.explain(*others, *among), linear.explain(*others, one.projected, *among)
            if not improves_prediction(with_it, without, linear.explain()):
                spurious[one.name] = free[0][0].name
    return UnexplainedStructure(tuple(function for function, _ in free), spurious, ranking)


def _select_free(
    taken: Sequence[ProjectedColumns], candidates: Sequence[Projected], linear: LinearisedFit
) -> list[Projected]:
    """Forward selection of free functions while one saves enough, all at the joint of the first."""
    chosen: list[Projected] = []
    now = linear.explain(*taken)
    while len(chosen) < MAX_FREE_FUNCTIONS:
        left = [one for one in candidates if not chosen or one[0].joint == chosen[0][0].joint]
        tried = [(linear.explain(*taken, *(p for _, p in chosen), one[1]), one) for one in left if one not in chosen]
        then, best = min(tried, key=lambda pair: pair[0].rms)
        if then.rms > (1.0 - MIN_FREE_GAIN) * now.rms or paired_z(then.held_out, now.held_out) < Z_THRESHOLD:
            break
        chosen.append(best)
        now = then
    return chosen
