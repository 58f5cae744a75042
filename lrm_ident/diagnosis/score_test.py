"""Every candidate alone on the residual: its best shape, its p value, and whether its estimate can be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import f as f_distribution

from lrm_ident.diagnosis.candidates import Candidate
from lrm_ident.diagnosis.linearised_fit import Bench, Explained, Prepared, rank_of
from lrm_ident.progress import Tick
from lrm_math.arrays import Array
from lrm_math.effects import Effect

SURE = 2.0  # standard errors by which one prediction must beat another to be told from it
VISIBLE = 3.0  # times the noise that a typical size must move all TCPs together to be testable


@dataclass(frozen=True, eq=False)
class Scored:
    """A candidate at its best shape, alone on the residual.

    Attributes:
        columns: (3 N, m) of typical sizes, in m. p_value: after the scan over shapes, before Benjamini and Yekutieli.
        implausible: why its estimate cannot be, or empty.
    """

    candidate: Candidate
    shape: int
    columns: Array
    prepared: Prepared
    alone: Explained
    p_value: float
    implausible: str

    @property
    def name(self) -> str:
        """`effect@place`."""
        return self.candidate.name

    @property
    def size(self) -> int:
        """Number of parameters."""
        return int(self.columns.shape[1])


def score_all(
    found: Sequence[Candidate], on: Bench, weight: Array, progress: Tick
) -> tuple[list[Scored], list[tuple[Effect, str]]]:
    """Scores every candidate; those that could not show at their typical size come apart, with the reason.

    Args:
        weight: (3 N, 1), relative weight of each row.
    """
    scored, invisible = [], []
    for number, candidate in enumerate(found):
        best = _score(candidate, on, weight)
        if isinstance(best, str):
            invisible.append((candidate.effect, best))
        else:
            scored.append(best)
        progress(number + 1, 2 * len(found))
    return scored, invisible


def _score(candidate: Candidate, on: Bench, weight: Array) -> Scored | str:
    """The candidate at the shape that explains most, or why it cannot show."""
    tried = []
    for number, raw in enumerate(candidate.columns):
        columns = raw * weight
        prepared = on.prepare(columns)
        tried.append((on.explain(prepared), number, columns, prepared))
    alone, shape, columns, prepared = min(tried, key=lambda one: one[0].in_sample)
    moved = float(np.linalg.norm(prepared.inside))
    rank = rank_of(prepared.inside, columns)
    if rank == 0 or moved < VISIBLE * on.sigma:
        beyond = moved / np.sqrt(len(on.residual) / 3) * 1e3
        return f"a typical size moves the TCP by only {beyond:.2g} mm beyond what the fitted parameters already explain"
    p_value = p_value_of(on.explain().in_sample, alone.in_sample, rank, on.freedom)
    return Scored(
        candidate, shape, columns, prepared, alone, min(1.0, p_value * len(tried)), _implausible(candidate, alone)
    )


def p_value_of(before: float, after: float, rank: int, freedom: int) -> float:
    """F test of `rank` further parameters."""
    rest = max(freedom - rank, 1)
    return float(f_distribution.sf((before - after) / rank / (after / rest), rank, rest)) if after > 0 else 0.0


def _implausible(candidate: Candidate, alone: Explained) -> str:
    for parameter, theta, error in zip(candidate.parameters, alone.theta, alone.error, strict=True):
        below, above = theta + SURE * error < parameter.lower, theta - SURE * error > parameter.upper
        if below or above:
            return f"{parameter.name} would have to be {theta * parameter.typical / parameter.si:.3g}, against physics"
    return ""


def benjamini_yekutieli(p_values: dict[str, float]) -> dict[str, float]:
    """p values that allow for the number of candidates under any dependence (Benjamini & Yekutieli 2001)."""
    m = len(p_values)
    factor = m * sum(1.0 / k for k in range(1, m + 1))
    adjusted, smallest = {}, 1.0
    for rank, name in reversed(list(enumerate(sorted(p_values, key=lambda name: p_values[name]), start=1))):
        smallest = min(smallest, p_values[name] * factor / rank)
        adjusted[name] = smallest
    return adjusted
