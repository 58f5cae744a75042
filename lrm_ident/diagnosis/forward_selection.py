"""Effects taken one after the other as long as one helps, and what could not be told from each."""

from __future__ import annotations

from collections.abc import Sequence

from lrm_ident.diagnosis.linearised_fit import Bench, Explained, coincidence, paired
from lrm_ident.diagnosis.score_test import SURE, Scored, p_value_of
from lrm_ident.progress import Tick

SIGNIFICANT = 0.01  # p value after Benjamini and Yekutieli, of all candidates together
WORTHWHILE = 0.02  # part of the held-out RMS that an effect must save to be worth naming
COINCIDE = 0.95  # principal cosine above which two effects are one and the same to the data
MOST_EFFECTS = 8


def path_of(ranked: Sequence[Scored], on: Bench, progress: Tick) -> list[Scored]:
    """Effects taken one after the other as long as one is significant, plausible, and predicts better."""
    path: list[Scored] = []
    now = start = on.explain()
    harmonic = len(ranked) * sum(1.0 / k for k in range(1, len(ranked) + 1))
    while len(path) < MOST_EFFECTS:
        taken = [one.prepared for one in path]
        choices = []
        for one in ranked:
            if one not in path and not one.implausible:
                then = on.explain(*taken, one.prepared)
                p_value = p_value_of(now.in_sample, then.in_sample, one.size, on.freedom - sum(s.size for s in path))
                if p_value * harmonic * len(one.candidate.columns) < SIGNIFICANT and helps(then, now, start):
                    choices.append((then, one))
        progress(1 + len(path), MOST_EFFECTS)
        if not choices:
            break
        best = min(choices, key=lambda choice: choice[0].rms)[0]
        near = [choice for choice in choices if paired(best.held_out, choice[0].held_out) < 1.0]
        now, simplest = min(near, key=lambda choice: (choice[1].size, choice[0].rms))
        path.append(simplest)
    return path


def helps(then: Explained, now: Explained, start: Explained) -> bool:
    """Whether the prediction surely gets better, and by more than linearisation at the start may pretend."""
    gain = now.held_out.mean() - then.held_out.mean()
    enough = 1.0 - (1.0 - WORTHWHILE) ** 2
    return bool(gain > enough * start.held_out.mean()) and paired(then.held_out, now.held_out) > SURE


def rivals_of(one: Scored, path: Sequence[Scored], ranked: Sequence[Scored], on: Bench) -> tuple[str, ...]:
    """Candidates that, in its place, could not be told from it."""
    others = [other.prepared for other in path[: path.index(one)]]
    without, with_it = on.explain(*others), on.explain(*others, one.prepared)
    gain = float(without.held_out.mean() - with_it.held_out.mean())
    rivals = []
    for rival in ranked:
        if rival is one or rival.implausible:
            continue
        instead = on.explain(*others, rival.prepared)
        much = float(without.held_out.mean() - instead.held_out.mean()) > 0.5 * gain
        if much and (
            paired(with_it.held_out, instead.held_out) < SURE
            or coincidence(one.prepared.inside, rival.prepared.inside) > COINCIDE
        ):
            rivals.append(rival.name)
    return tuple(rivals)
