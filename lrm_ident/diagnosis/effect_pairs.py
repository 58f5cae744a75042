"""Whether arm and installation explain together what an effect of the measurement would explain.

What measures is named only where the arm and its installation, at their best, leave two standard errors more. Single
effects are compared by forward selection. Two may do together what none does alone: a base that leans and yields moves
the tip much like a tracker that errs. So the effect of the measurement beside its best companion is compared with pairs
of effects of arm and installation, found greedily: the best partner of each of those that are best alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from lrm_ident.diagnosis.screening.candidates import FORM
from lrm_ident.diagnosis.screening.column_sets import ColumnSets
from lrm_ident.diagnosis.screening.linearised_fit import LinearEstimate, LinearisedFit
from lrm_ident.diagnosis.screening.score_test import ScoredCandidate
from lrm_ident.residual.better_prediction import paired_z
from lrm_ident.residual.thresholds import Z_THRESHOLD
from lrm_math.effects import ModelPart

STARTS = 4
"""Effects, best alone, of which the best partner is sought: a bound on time."""
Pair = tuple[ScoredCandidate, ScoredCandidate]


@dataclass(frozen=True, eq=False)
class EffectPairs:
    """Pairs of effects of arm and installation beside a fit.

    Attributes:
        screened: all candidates. sets: their columns, in this order, up to date with the fit.
        fit: with the effects selected so far. beside: estimate of each candidate (by name) alone beside it.
    """

    screened: Sequence[ScoredCandidate]
    sets: ColumnSets
    fit: LinearisedFit
    beside: Mapping[str, LinearEstimate]

    def extended_by(self, one: ScoredCandidate) -> EffectPairs:
        """The same beside the fit with one more effect, projected out of all candidates once."""
        fit = self.fit.beside(one.projected)
        sets = fit.up_to_date(self.sets)
        names = (scored.name for scored in self.screened)
        return EffectPairs(self.screened, sets, fit, dict(zip(names, fit.explain_each(sets), strict=True)))

    def pair_instead_of(self, measuring: ScoredCandidate) -> Pair | None:
        """The first pair that predicts as well as an effect of the measurement beside its best companion, if any."""
        if not self._pairs:
            return None
        _, most = self._with_partner(measuring)
        alike = (pair for pair, both in self._pairs if paired_z(most.held_out, both.held_out) < Z_THRESHOLD)
        return next(alike, None)

    @cached_property
    def _pairs(self) -> list[tuple[Pair, LinearEstimate]]:
        """Each of the best rivals with its best partner, and their estimate together; the best first."""
        if len(self._rivals) < 2:
            return []
        alone = sorted((self.screened[row] for row in self._rivals), key=lambda scored: self.beside[scored.name].rms)
        pairs = [(scored, *self._with_partner(scored)) for scored in alone[:STARTS]]
        return sorted((((scored, other), both) for scored, other, both in pairs), key=lambda pair: pair[1].rms)

    @cached_property
    def _rivals(self) -> list[int]:
        """Numbers of the plausible effects of arm and installation; free forms of the installation alone."""
        return [
            number
            for number, scored in enumerate(self.screened)
            if not scored.implausible
            and scored.candidate.effect.part is not ModelPart.MEASUREMENT
            and (scored.candidate.priority != FORM or scored.candidate.effect.part is ModelPart.INSTALLATION)
        ]

    def _with_partner(self, scored: ScoredCandidate) -> tuple[ScoredCandidate, LinearEstimate]:
        """The rival that predicts best beside an effect, and the estimate of both."""
        with_it = self.fit.beside(scored.projected)
        estimates = with_it.explain_each(self.sets)
        best = min(
            (row for row in self._rivals if self.screened[row] is not scored), key=lambda row: estimates[row].rms
        )
        return self.screened[best], estimates[best]
