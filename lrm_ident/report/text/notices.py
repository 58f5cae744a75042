"""Notices in words: what a user should know of the files and steps of a study, one line each."""

from __future__ import annotations

from collections.abc import Sequence

from lrm_ident.data.wording import enumerate_words, poses_count, poses_words
from lrm_ident.study.notices import Notice, NoticeKind

NAMED = 12  # effects or poses in a line


def _held(count: int) -> str:
    subject = "1 offset or compliance that the model's fit held is"
    return subject if count == 1 else f"{count} offsets and compliances that the model's fit held are"


def notice_words(notice: Notice) -> str:
    """A notice in one line."""
    names = notice.names
    match notice.kind:
        case NoticeKind.READ:
            return notice.said
        case NoticeKind.AS_FITTED:
            return f"as in the model's fit: {fit_words(names[0], notice.poses)}"
        case NoticeKind.OTHER_DATA:
            here = f"{names[0] or 'the file of these poses'} is not what the model was fitted to"
            return f"{here}; left out, as of that session alone: {enumerate_words(names[1:], NAMED)}"
        case NoticeKind.OTHER_EFFECTS:
            return f"{names[0]} is not the file that {names[1]} was fitted with (its SHA-256 differs)"
        case NoticeKind.OTHER_PRIOR:
            return prior_words(names[0])
        case NoticeKind.DIMENSIONS_HELD:
            return f"{_held(len(names))} fitted first: what they explain would count for an effect that is added"
        case NoticeKind.DIMENSIONS_KEPT:
            return f"{_held(len(names) - 1)} not fitted, so an effect may be added for what they explain: {names[-1]}"
        case NoticeKind.FIELD_LEFT_OUT:
            return "the residual field is left out here: it is no cause; add it again when all causes are in the model"
        case NoticeKind.OUTLIERS:
            return f"outliers, left out: {poses_words(notice.poses)}"


def prior_words(name: str) -> str:
    """Of a model that was fitted with another prior than that of its diagnosis."""
    return f"the model was fitted with the prior '{name}'; the diagnosis and the next steps have that of typical sizes"


def fit_words(loss: str, left_out: Sequence[int]) -> str:
    """Loss and left-out poses of a fit; empty for least squares of all poses."""
    how = [] if loss == "squared" else [f"loss {loss}"]
    if left_out:
        how.append(f"{poses_count(len(left_out))} left out: {enumerate_words(list(map(str, left_out)), NAMED)}")
    return "; ".join(how)
