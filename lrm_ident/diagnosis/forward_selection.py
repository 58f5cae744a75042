"""Forward selection of effects by held-out error, and their equivalence classes: which the data cannot tell apart.

Candidates are ranked by held-out error. Among those that prediction cannot separate, a refinement of an effect of the
model comes before a plain effect, and that before another form of an effect that the model does not have; of each rank
the arm and its installation come before what measures them, so a tracker is named only where it leaves two standard
errors less than they do, and than pairs of them (`effect_pairs`). Where a plain effect helps most, candidates with so
many more parameters that Schwarz's criterion is very strong evidence against them are left out (Kass and Raftery 1995).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lrm_ident.diagnosis.effect_pairs import EffectPairs, Pair
from lrm_ident.diagnosis.screening.candidates import FORM, REFINEMENT
from lrm_ident.diagnosis.screening.column_spaces import cosine_of_bases
from lrm_ident.diagnosis.screening.linearised_fit import LinearEstimate, LinearisedFit
from lrm_ident.diagnosis.screening.score_test import ScoredCandidate
from lrm_ident.fitting.progress import OnProgress
from lrm_ident.residual.better_prediction import falls_by_share, paired_z, predicts_better
from lrm_ident.residual.significance import f_test_p_value, yekutieli_factor
from lrm_ident.residual.thresholds import (
    EQUIVALENCE_COSINE,
    EQUIVALENT_GAIN,
    MIN_GAIN,
    MOST_SELECTED,
    SIGNIFICANCE,
    SIMILAR_GAIN,
    VERY_STRONG,
    Z_THRESHOLD,
)
from lrm_math.effects import ModelPart, variants


class Choice(NamedTuple):
    """A candidate that may be added, and its estimate beside the effects selected so far."""

    estimate: LinearEstimate
    scored: ScoredCandidate


@dataclass(frozen=True, eq=False)
class SelectionStep:
    """Fit with the effects selected so far, and the estimate of each candidate (by name) beside them."""

    linear: LinearisedFit
    beside: Mapping[str, LinearEstimate]


@dataclass(frozen=True, eq=False)
class Selection:
    """Selected effects, in order; `steps`: before each of them, and after the last."""

    effects: tuple[ScoredCandidate, ...]
    steps: tuple[SelectionStep, ...]


def forward_select(
    start: EffectPairs,
    progress: OnProgress,
    weights: Mapping[str, float] | None = None,
    possible: Sequence[ScoredCandidate] | None = None,
) -> Selection:
    """Adds the best effect, one after the other, as long as one is significant, plausible, and predicts better.

    Where effects of the model have other forms, a new effect must predict better than all these forms together, or
    improve the prediction beside them: it may only stand for a wrong formula of what is there.

    Args:
        start: all that were screened, and pairs of them, beside the fit; what is known of it serves every selection.
        weights: of the candidates' p values (`EffectRates.weights`): a frequent effect needs less evidence, and is
            preferred to others that predict alike. None: equal.
        possible: candidates that may be selected, the best first; the others are only tried. None: all.
    """
    ranked = start.screened if possible is None else possible
    selected: list[ScoredCandidate] = []
    steps: list[SelectionStep] = []
    pairs = start
    while True:
        step = SelectionStep(pairs.fit, pairs.beside)
        steps.append(step)
        progress(1 + len(selected), MOST_SELECTED)
        full = len(selected) == MOST_SELECTED
        chosen = None if full else _next_effect(ranked, selected, step, start.fit.baseline, weights or {}, pairs)
        if chosen is None:
            return Selection(tuple(selected), tuple(steps))
        selected.append(chosen)
        pairs = pairs.extended_by(chosen)


def _next_effect(
    ranked: Sequence[ScoredCandidate],
    selected: Sequence[ScoredCandidate],
    step: SelectionStep,
    start: LinearEstimate,
    expected: Mapping[str, float],
    pairs: EffectPairs,
) -> ScoredCandidate | None:
    """The effect to add, if any."""
    priority = {candidate.name: _priority(candidate, selected) for candidate in ranked}
    refinements = [
        candidate for candidate in ranked if _is_form_of_present(candidate, priority) and candidate not in selected
    ]
    choices = [
        candidate for candidate in _significant(ranked, step, start, expected) if candidate.scored not in selected
    ]
    formed: dict[tuple[str, ...], LinearisedFit] = {}
    while choices:
        simple = _parsimonious(choices, priority, len(step.linear.residual))
        best = _most_helpful(simple, step.linear.baseline, priority, expected)
        choice = best if priority[best.scored.name] < FORM else _plain_effect_of(best, choices)
        if pair := _pair_instead_of(choice.scored, pairs):
            choices = [candidate for candidate in choices if candidate.scored is not choice.scored]
            if not (members := [candidate for candidate in choices if candidate.scored in pair]):
                continue
            choice = min(members, key=lambda candidate: candidate.estimate.rms)
        chosen, left_out = choice.scored, [candidate.scored for candidate in choices if candidate not in simple]
        forms = [candidate for candidate in refinements if candidate not in left_out]
        if priority[chosen.name] == REFINEMENT or not forms:
            return chosen
        names = tuple(candidate.name for candidate in forms)
        if names not in formed:
            formed[names] = step.linear.beside(*(candidate.projected for candidate in forms))
        by_forms = formed[names]
        if paired_z(choice.estimate.held_out, by_forms.baseline.held_out) > Z_THRESHOLD:
            return chosen
        if improves_prediction(by_forms.explain(chosen.projected), by_forms.baseline, start):
            return chosen
        choices.remove(choice)
    return None


def _pair_instead_of(scored: ScoredCandidate, pairs: EffectPairs) -> Pair | None:
    """The pair of effects of arm and installation that predicts as well as one of the measurement, if it is one."""
    return pairs.pair_instead_of(scored) if scored.candidate.effect.part is ModelPart.MEASUREMENT else None


def _significant(
    ranked: Sequence[ScoredCandidate], step: SelectionStep, start: LinearEstimate, expected: Mapping[str, float]
) -> Iterator[Choice]:
    """The plausible candidates that are significant and predict better."""
    before, freedom, tests = step.linear.baseline, step.linear.degrees_of_freedom, yekutieli_factor(len(ranked))
    for scored in ranked:
        tried = step.beside[scored.name]
        p_value = f_test_p_value(before.in_sample, tried.in_sample, scored.size, freedom)
        adjusted = p_value * tests * scored.candidate.trials / expected.get(scored.name, 1.0)
        if not scored.implausible and adjusted < SIGNIFICANCE and improves_prediction(tried, before, start):
            yield Choice(tried, scored)


def _priority(scored: ScoredCandidate, selected: Sequence[ScoredCandidate]) -> int:
    """Priority of a candidate beside the effects of the model and the selected ones."""
    names = {other.name for other in selected}
    return REFINEMENT if names & set(variants(scored.candidate.effect)) else scored.candidate.priority


def _is_form_of_present(scored: ScoredCandidate, priority: dict[str, int]) -> bool:
    """Whether a candidate is another form of an effect of the model or a selected one."""
    return priority[scored.name] == REFINEMENT and scored.candidate.effect.is_free_form


def _parsimonious(choices: Sequence[Choice], priority: Mapping[str, int], count: int) -> Sequence[Choice]:
    """Choices without those against which the BIC (Schwarz 1978; `count` coordinates) is very strong evidence in favour
    of the most helpful one; all, if that is a form."""

    def criterion(choice: Choice) -> float:
        return float(count * np.log(choice.estimate.in_sample) + choice.scored.size * np.log(count))

    helpful = min(choices, key=lambda choice: choice.estimate.rms)
    if priority[helpful.scored.name] == FORM:
        return choices
    limit = criterion(helpful) + VERY_STRONG
    return [choice for choice in choices if criterion(choice) < limit]


def _most_helpful(
    choices: Sequence[Choice], before: LinearEstimate, priority: Mapping[str, int], expected: Mapping[str, float]
) -> Choice:
    """The most helpful choice; among those that prediction cannot separate from it the first by priority, the arm and
    its installation before the measurement, then by weight, then by number of parameters."""
    best = min(choices, key=lambda choice: choice.estimate.rms).estimate

    def near(choice: Choice, z: float, share: float) -> bool:
        gain, most = (float(before.held_out.mean() - after.held_out.mean()) for after in (choice.estimate, best))
        return gain > share * most and paired_z(best.held_out, choice.estimate.held_out) < z

    def rank(choice: Choice) -> tuple[int, bool]:
        return priority[choice.scored.name], choice.scored.candidate.effect.part is ModelPart.MEASUREMENT

    first = min(rank(choice) for choice in choices if near(choice, Z_THRESHOLD, EQUIVALENT_GAIN))
    equal = [choice for choice in choices if rank(choice) == first]
    best = min(equal, key=lambda choice: choice.estimate.rms).estimate
    similar = [choice for choice in equal if near(choice, 1.0, SIMILAR_GAIN)]
    return min(
        similar,
        key=lambda alternative: (
            -expected.get(alternative.scored.name, 1.0),
            alternative.scored.size,
            alternative.estimate.rms,
        ),
    )


def _plain_effect_of(chosen: Choice, choices: Sequence[Choice]) -> Choice:
    """The best plain effect of which a form is another form, if one is among the choices; else the form itself."""
    names = variants(chosen.scored.candidate.effect)
    plain = [choice for choice in choices if choice.scored.name in names]
    return min(plain, key=lambda choice: choice.estimate.rms, default=chosen)


def improves_prediction(after: LinearEstimate, before: LinearEstimate, start: LinearEstimate) -> bool:
    """Whether the held-out error falls significantly, and by a share of that at the `start`: linearising there errs."""
    return predicts_better(after.held_out, before.held_out, MIN_GAIN, start.held_out)


def equivalent_effects(selection: Selection, number: int, ranked: Sequence[ScoredCandidate]) -> tuple[str, ...]:
    """Equivalence class: names of candidates that the data cannot distinguish from a selected one in its place.

    Forms of effects that the model does not have are left out, as they name no cause.
    """
    scored, step = selection.effects[number], selection.steps[number]
    without, with_it = step.linear.baseline, step.beside[scored.name]
    gain = float(without.held_out.mean() - with_it.held_out.mean())
    alike = _sharing_a_form(scored, with_it, selection.steps[number + 1], ranked, selection.steps[0].linear.baseline)
    equivalent = []
    for rival in ranked:
        if rival is scored or rival.implausible or rival.candidate.priority == FORM:
            continue
        instead = step.beside[rival.name]
        saved = float(without.held_out.mean() - instead.held_out.mean())
        if (rival.name in alike and falls_by_share(instead.held_out, without.held_out, MIN_GAIN)) or (
            saved > EQUIVALENT_GAIN * gain and _inseparable(scored, with_it, rival, instead)
        ):
            equivalent.append(rival.name)
    return tuple(equivalent)


def _inseparable(
    scored: ScoredCandidate, with_it: LinearEstimate, rival: ScoredCandidate, instead: LinearEstimate
) -> bool:
    """Whether two effects predict alike, or move the TCP alike."""
    return paired_z(with_it.held_out, instead.held_out) < Z_THRESHOLD or moves_alike(scored, rival)


def moves_alike(scored: ScoredCandidate, other: ScoredCandidate) -> bool:
    """Whether two effects move the TCP alike, be it in a part of what the larger one can do."""
    return cosine_of_bases(scored.orthonormal, other.orthonormal) > EQUIVALENCE_COSINE


def _sharing_a_form(
    candidate: ScoredCandidate,
    with_it: LinearEstimate,
    after: SelectionStep,
    ranked: Sequence[ScoredCandidate],
    start: LinearEstimate,
) -> set[str]:
    """Effects that share with `candidate` a form that still improves the prediction: its formula is wrong, and then
    formulas do not tell them apart."""
    names_sharing: set[str] = set()
    for form in ranked:
        plain = variants(form.candidate.effect)
        if candidate.name in plain and improves_prediction(after.beside[form.name], with_it, start):
            names_sharing.update(plain)
    return names_sharing
