"""Forward selection of effects by held-out error, and which effects the data cannot distinguish from each."""

from __future__ import annotations

from collections.abc import Sequence

from lrm_ident.diagnosis.linearised_fit import Explanation, LinearisedFit, paired_z, principal_cosine
from lrm_ident.diagnosis.score_test import Z_THRESHOLD, ScoredCandidate, f_test_p_value, yekutieli_factor
from lrm_ident.progress import OnProgress

SIGNIFICANCE = 0.01  # p value after Benjamini and Yekutieli, of all candidates together
MIN_GAIN = 0.02  # part of the held-out RMS that an effect must save to be worth naming
EQUIVALENCE_COSINE = 0.95  # principal cosine above which the data cannot distinguish two effects
MAX_EFFECTS = 8


def forward_select(
    ranked: Sequence[ScoredCandidate], linear: LinearisedFit, progress: OnProgress
) -> list[ScoredCandidate]:
    """Adds the best effect, one after the other, as long as one is significant, plausible, and predicts better."""
    selected: list[ScoredCandidate] = []
    now = start = linear.explain()
    while len(selected) < MAX_EFFECTS:
        taken = [one.projected for one in selected]
        freedom = linear.degrees_of_freedom - sum(one.size for one in selected)
        choices = []
        for one in ranked:
            if one not in selected and not one.implausible:
                then = linear.explain(*taken, one.projected)
                p_value = f_test_p_value(now.in_sample, then.in_sample, one.size, freedom)
                adjusted = p_value * yekutieli_factor(len(ranked)) * len(one.candidate.columns)
                if adjusted < SIGNIFICANCE and improves_prediction(then, now, start):
                    choices.append((then, one))
        progress(1 + len(selected), MAX_EFFECTS)
        if not choices:
            break
        best = min(choices, key=lambda choice: choice[0].rms)[0]
        near = [choice for choice in choices if paired_z(best.held_out, choice[0].held_out) < 1.0]
        now, simplest = min(near, key=lambda choice: (choice[1].size, choice[0].rms))
        selected.append(simplest)
    return selected


def improves_prediction(then: Explanation, now: Explanation, start: Explanation) -> bool:
    """Whether held-out error falls significantly, and by more than the error of linearising at `start` could feign."""
    gain = now.held_out.mean() - then.held_out.mean()
    enough = 1.0 - (1.0 - MIN_GAIN) ** 2
    return bool(gain > enough * start.held_out.mean()) and paired_z(then.held_out, now.held_out) > Z_THRESHOLD


def equivalent_effects(
    one: ScoredCandidate, selected: Sequence[ScoredCandidate], ranked: Sequence[ScoredCandidate], linear: LinearisedFit
) -> tuple[str, ...]:
    """Names of candidates that the data cannot distinguish from `one` in its place."""
    others = [other.projected for other in selected[: selected.index(one)]]
    without, with_it = linear.explain(*others), linear.explain(*others, one.projected)
    gain = float(without.held_out.mean() - with_it.held_out.mean())
    equivalent = []
    for rival in ranked:
        if rival is one or rival.implausible:
            continue
        instead = linear.explain(*others, rival.projected)
        if float(without.held_out.mean() - instead.held_out.mean()) > 0.5 * gain and (
            paired_z(with_it.held_out, instead.held_out) < Z_THRESHOLD
            or principal_cosine(one.projected.all_rows, rival.projected.all_rows) > EQUIVALENCE_COSINE
        ):
            equivalent.append(rival.name)
    return tuple(equivalent)
