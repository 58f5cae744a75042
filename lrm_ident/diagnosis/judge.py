"""The one judge of `diagnose`, `add` and `auto`: the best candidates refitted in full and cross-validated.

Screening (`diagnose`) is linear. What it selects is refitted here with everything else free, as `add` does it, and
counts only if the held-out error falls.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from lrm_ident.data.error_stats import ErrorStats, error_stats
from lrm_ident.diagnosis.add_effect import add_effects
from lrm_ident.diagnosis.diagnose import Diagnosis, Verdict
from lrm_ident.diagnosis.forward_selection import MIN_GAIN
from lrm_ident.diagnosis.score_test import ScoredCandidate
from lrm_ident.estimation.cross_validation import held_out_blocks, held_out_residual
from lrm_ident.estimation.levenberg_marquardt import Fit
from lrm_ident.nonparametric.predictability import HeldOutBlock, held_out_rows
from lrm_math.arrays import Array
from lrm_math.errors import LrmError

MAX_REFITS = 3  # candidates that are refitted and cross-validated in full


@dataclass(frozen=True, eq=False)
class Refit:
    """A model with one candidate added, everything refitted; `held_out`: (N, 3), its held-out residual (m)."""

    fit: Fit
    held_out: Array

    @property
    def error(self) -> ErrorStats:
        """Its held-out error."""
        return error_stats(self.held_out)


@dataclass(frozen=True, eq=False)
class Judgement:
    """A diagnosis with its best candidates refitted.

    Attributes:
        blocks: the model as it is, cross-validated.
        refits: by name, of the candidates that lower the held-out error when everything is refitted.
        supported: effects that are there as far as these data show, the one to add first.
    """

    diagnosis: Diagnosis
    blocks: tuple[HeldOutBlock, ...]
    refits: dict[str, Refit]
    supported: tuple[ScoredCandidate, ...]

    @property
    def held_out(self) -> Array:
        """(N, 3), held-out residual of the model as it is (m)."""
        return held_out_rows(self.blocks)

    @property
    def first(self) -> ScoredCandidate | None:
        """The effect to add, if any."""
        return self.supported[0] if self.supported else None

    @property
    def verdict(self) -> Verdict:
        """The diagnosis's, unless what it supports does not lower the held-out error when refitted."""
        lost = self.diagnosis.verdict == "effect_missing" and not self.supported
        return "unexplained_structure" if lost else self.diagnosis.verdict


def judge(diagnosis: Diagnosis, on_progress: Callable[[str], object] = str) -> Judgement:
    """Refits the first supported effect, those equivalent to it and the next ones, and keeps what predicts better.

    Args:
        on_progress: called with what is being done.
    """
    on_progress("cross-validating the model as it is")
    blocks = held_out_blocks(diagnosis.fit.model, diagnosis.data, loss=diagnosis.loss)
    before = error_stats(held_out_rows(blocks)).rms
    refits: dict[str, Refit] = {}
    tried = _to_refit(diagnosis)
    for scored in tried:
        on_progress(f"refitting with {scored.name}")
        found = _refit(diagnosis, scored)
        if found and found.error.rms < (1.0 - MIN_GAIN) * before:
            refits[scored.name] = found
    return Judgement(diagnosis, blocks, refits, _supported(diagnosis, tried, refits))


def _to_refit(diagnosis: Diagnosis) -> list[ScoredCandidate]:
    """The first supported effect, those equivalent to it, then the other supported ones."""
    by_name = {scored.name: scored for scored in diagnosis.scored}
    names = [scored.name for scored in diagnosis.supported]
    names[1:1] = [other for name in names[:1] for other in diagnosis.equivalent[name]]
    return [by_name[name] for name in dict.fromkeys(names)][:MAX_REFITS]


def _refit(diagnosis: Diagnosis, scored: ScoredCandidate) -> Refit | None:
    """The refit, held out as it was fitted; None if it does not converge."""
    try:
        effect, data, loss = scored.candidate.effect, diagnosis.data, diagnosis.loss
        fitted = add_effects(diagnosis.fit.model, data, [effect], scored.shape, loss)
        return Refit(fitted, held_out_residual(fitted.model, data, loss=loss, prior=fitted.weak_prior))
    except LrmError:
        return None


def _supported(
    diagnosis: Diagnosis, tried: list[ScoredCandidate], refits: dict[str, Refit]
) -> tuple[ScoredCandidate, ...]:
    """The supported effects whose refit, if there was one, predicts better; the first of them was refitted."""
    kept = [one for one in diagnosis.supported if one.name in refits or one not in tried]
    while kept and kept[0].name not in refits:
        kept.pop(0)
    return tuple(kept)
