"""Forward selection of effects by held-out error, and which effects the data cannot distinguish from each.

The ranking is by help. Of what prediction cannot separate, a refinement of what the model has comes before a plain
effect, and that before another form of an effect that the model does not have; but where a plain effect helps most,
what needs so many parameters more that Schwarz's criterion speaks very strongly against it is out (Kass and Raftery
1995).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from lrm_ident.diagnosis.candidates import FORM, REFINEMENT
from lrm_ident.diagnosis.linearised_fit import Explanation, LinearisedFit, ProjectedColumns, cosine_of_bases, paired_z
from lrm_ident.diagnosis.score_test import Z_THRESHOLD, ScoredCandidate, f_test_p_value, yekutieli_factor
from lrm_ident.fitting.progress import OnProgress
from lrm_math.effects import variants

SIGNIFICANCE = 0.01  # p value after Benjamini and Yekutieli, of all candidates together
MIN_GAIN = 0.02  # part of the held-out RMS that an effect must save to be worth naming
WORTH = 1.0 - (1.0 - MIN_GAIN) ** 2  # the same of the squares
EQUIVALENCE_COSINE = 0.95  # principal cosine above which the data cannot distinguish two effects
EQUIVALENT_GAIN = 0.5  # part of an effect's gain that an equivalent must have
SIMILAR_GAIN = 0.8  # part of an effect's gain that a simpler one must have to be taken instead
MAX_EFFECTS = 8
VERY_STRONG = 10.0  # difference of Schwarz's criterion that is very strong evidence
Choice = tuple[Explanation, ScoredCandidate]


def forward_select(
    ranked: Sequence[ScoredCandidate],
    linear: LinearisedFit,
    progress: OnProgress,
    weights: Mapping[str, float] | None = None,
) -> list[ScoredCandidate]:
    """Adds the best effect, one after the other, as long as one is significant, plausible, and predicts better.

    Where the model has effects with other forms, a new name must predict better than all these forms together, or
    explain what they do not: a formula that does not fit is no new cause.

    Args:
        weights: of the candidates' p values (`EffectRates.weights`): what is expected needs less evidence. Of
            those that predict alike, the one with the larger weight is taken. None: all alike.
    """
    expected = weights or {}
    selected: list[ScoredCandidate] = []
    now = start = linear.explain()
    while len(selected) < MAX_EFFECTS:
        taken = [one.projected for one in selected]
        freedom = linear.degrees_of_freedom - sum(one.size for one in selected)
        choices: list[Choice] = []
        for one in ranked:
            if one not in selected and not one.implausible:
                tried = linear.explain(*taken, one.projected)
                p_value = f_test_p_value(now.in_sample, tried.in_sample, one.size, freedom)
                adjusted = p_value * yekutieli_factor(len(ranked)) * len(one.candidate.columns)
                adjusted /= expected.get(one.name, 1.0)
                if adjusted < SIGNIFICANCE and improves_prediction(tried, now, start):
                    choices.append((tried, one))
        progress(1 + len(selected), MAX_EFFECTS)
        standing = {one.name: _standing(one, selected) for one in ranked}
        refinements = [one for one in ranked if _is_refinement(one, standing) and one not in selected]
        while choices:
            simple = _parsimonious(choices, standing, len(linear.residual))
            best = _choose(simple, now, standing, expected)
            then, chosen = best if standing[best[1].name] < FORM else _plain(best, choices)
            left_out = [one for _, one in choices if all(one is not other for _, other in simple)]
            forms = [one.projected for one in refinements if one not in left_out]
            if standing[chosen.name] == REFINEMENT or not forms:
                break
            by_forms = linear.explain(*taken, *forms)
            if paired_z(then.held_out, by_forms.held_out) > Z_THRESHOLD:
                break
            if improves_prediction(linear.explain(*taken, *forms, chosen.projected), by_forms, start):
                break
            choices.remove((then, chosen))
        if not choices:
            break
        now = then
        selected.append(chosen)
    return selected


def _standing(one: ScoredCandidate, selected: Sequence[ScoredCandidate]) -> int:
    """Its standing beside the effects of the model and those selected."""
    names = {other.name for other in selected}
    return REFINEMENT if names & set(variants(one.candidate.effect)) else one.candidate.standing


def _is_refinement(one: ScoredCandidate, standing: dict[str, int]) -> bool:
    return standing[one.name] == REFINEMENT and bool(one.candidate.effect.variant_of)


def _parsimonious(choices: Sequence[Choice], standing: Mapping[str, int], count: int) -> Sequence[Choice]:
    """Where a plain effect is the most helpful: it, and what the Bayesian information criterion of `count` coordinates
    does not speak very strongly against in its favour (Schwarz 1978). Else all: many parameters beside many."""

    def criterion(choice: Choice) -> float:
        return float(count * np.log(choice[0].in_sample) + choice[1].size * np.log(count))

    helpful = min(choices, key=lambda choice: choice[0].rms)
    if standing[helpful[1].name] == FORM:
        return choices
    limit = criterion(helpful) + VERY_STRONG
    return [choice for choice in choices if criterion(choice) < limit]


def _choose(
    choices: Sequence[Choice], now: Explanation, standing: Mapping[str, int], expected: Mapping[str, float]
) -> Choice:
    """The most helpful; of those that prediction cannot separate from it, by standing, then by how much it is expected,
    then by number of parameters."""
    best = min(choices, key=lambda choice: choice[0].rms)[0]

    def near(choice: Choice, z: float, share: float) -> bool:
        gain, most = (float(now.held_out.mean() - then.held_out.mean()) for then in (choice[0], best))
        return gain > share * most and paired_z(best.held_out, choice[0].held_out) < z

    first = min(standing[choice[1].name] for choice in choices if near(choice, Z_THRESHOLD, EQUIVALENT_GAIN))
    equal = [choice for choice in choices if standing[choice[1].name] == first]
    best = min(equal, key=lambda choice: choice[0].rms)[0]
    similar = [choice for choice in equal if near(choice, 1.0, SIMILAR_GAIN)]
    return min(similar, key=lambda choice: (-expected.get(choice[1].name, 1.0), choice[1].size, choice[0].rms))


def _plain(chosen: Choice, choices: Sequence[Choice]) -> Choice:
    """The best plain effect that this form refines, if one helps: it is named first; else the form itself."""
    names = variants(chosen[1].candidate.effect)
    return min((c for c in choices if c[1].name in names), key=lambda choice: choice[0].rms, default=chosen)


def improves_prediction(then: Explanation, now: Explanation, start: Explanation) -> bool:
    """Whether held-out error falls significantly, and by more than the error of linearising at `start` could feign."""
    gain = now.held_out.mean() - then.held_out.mean()
    return bool(gain > WORTH * start.held_out.mean()) and paired_z(then.held_out, now.held_out) > Z_THRESHOLD


def equivalent_effects(
    one: ScoredCandidate, selected: Sequence[ScoredCandidate], ranked: Sequence[ScoredCandidate], linear: LinearisedFit
) -> tuple[str, ...]:
    """Names of candidates that the data cannot distinguish from `one` in its place.

    Without forms of effects that the model does not have: they are no causes of their own.
    """
    others = [other.projected for other in selected[: selected.index(one)]]
    without, with_it = linear.explain(*others), linear.explain(*others, one.projected)
    gain = float(without.held_out.mean() - with_it.held_out.mean())
    alike = _same_form(one, others, with_it, ranked, linear)
    equivalent = []
    for rival in ranked:
        if rival is one or rival.implausible or rival.candidate.standing == FORM:
            continue
        instead = linear.explain(*others, rival.projected)
        saved = float(without.held_out.mean() - instead.held_out.mean())
        if (rival.name in alike and saved > WORTH * without.held_out.mean()) or (
            saved > EQUIVALENT_GAIN * gain and _inseparable(one, with_it, rival, instead)
        ):
            equivalent.append(rival.name)
    return tuple(equivalent)


def _inseparable(one: ScoredCandidate, with_it: Explanation, rival: ScoredCandidate, instead: Explanation) -> bool:
    """Whether two effects predict alike, or move the TCP alike."""
    close = paired_z(with_it.held_out, instead.held_out) < Z_THRESHOLD
    return close or cosine_of_bases(one.projected.orthonormal, rival.projected.orthonormal) > EQUIVALENCE_COSINE


def _same_form(
    one: ScoredCandidate,
    others: Sequence[ProjectedColumns],
    with_it: Explanation,
    ranked: Sequence[ScoredCandidate],
    linear: LinearisedFit,
) -> set[str]:
    """Effects of which a form that `one` needs is a form too: where a formula is wrong, formulas do not distinguish."""
    found: set[str] = set()
    for form in ranked:
        if one.name in variants(form.candidate.effect):
            beside = linear.explain(*others, one.projected, form.projected)
            if improves_prediction(beside, with_it, linear.explain()):
                found.update(variants(form.candidate.effect))
    return found
