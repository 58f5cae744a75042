"""Companion of an effect: a second one without which it may be refused, and a linear test before both are refitted."""

from __future__ import annotations

from lrm_ident.data.measurements import Measurements
from lrm_ident.diagnosis.diagnose import Diagnosis
from lrm_ident.diagnosis.forward_selection import improves_prediction
from lrm_ident.diagnosis.screening.score_test import ScoredCandidate
from lrm_ident.diagnosis.screening.screen import screen_one
from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_math.effects import variants


def companion_of(diagnosis: Diagnosis, scored: ScoredCandidate) -> ScoredCandidate | None:
    """The plain effect elsewhere that is selected beside one, or that a selected form is a form of; None without any.

    Two at one place are rather one cause whose form is wrong.
    """
    effects = [other.candidate.effect for other in diagnosis.supported]
    selected = [effect for effect in effects if effect.place != scored.candidate.effect.place]
    names = {name for effect in selected for name in (variants(effect) if effect.is_free_form else [effect.name])}
    plain = (other for other in diagnosis.scored if other.name in names - {scored.name} and not other.implausible)
    return next(plain, None)


def improves_beside(fitted: Fit, data: Measurements, companion: ScoredCandidate) -> bool:
    """Whether a companion improves the prediction of a fit, as every candidate has to before it is refitted.

    It was selected by a fit without the first effect; beside the refit of that one it may have nothing left to explain.
    """
    screening = screen_one(fitted, data, companion.candidate.effect)
    before = screening.linear.baseline
    return any(improves_prediction(scored.alone, before, before) for scored in screening.scored)
