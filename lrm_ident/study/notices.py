"""Notices of a study: what a user should know of its files and steps, as values; `str` gives their words."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from importlib import import_module

WORDS = "lrm_ident.report.text.notices"
"""The module above that writes notices; it is looked up when a person asks, and not before."""


class NoticeKind(StrEnum):
    """Kinds of notices, with what `names` and `poses` of a `Notice` are of each."""

    READ = "read"
    """Said: by the reader of a file, or by an effect."""
    AS_FITTED = "as_fitted"
    """Name: of the loss of the model's fit. Poses: that it left out. The same holds here."""
    OTHER_DATA = "other_data"
    """Names: the file that the model was not fitted to, "" where it has none; then the effects that are left out."""
    OTHER_EFFECTS = "other_effects_file"
    """Names: the file of effects, which has changed since; the model file."""
    OTHER_PRIOR = "other_prior"
    """Name: the prior of the model's fit, which the next steps do not have."""
    DIMENSIONS_HELD = "dimensions_held"
    """Names: keys of offsets and compliances that the model's fit held, and the next steps fit."""
    DIMENSIONS_KEPT = "dimensions_kept"
    """Names: keys of offsets and compliances that the model's fit held; the last one is the reason for it."""
    FIELD_LEFT_OUT = "field_left_out"
    OUTLIERS = "outliers"
    """Poses: that are left out."""


@dataclass(frozen=True)
class Notice:
    """Something that a user should know. See `NoticeKind`."""

    kind: NoticeKind
    names: tuple[str, ...] = ()
    poses: tuple[int, ...] = ()
    said: str = ""

    def __str__(self) -> str:
        words: str = import_module(WORDS).notice_words(self)
        return words


def as_read(words: Iterable[str]) -> tuple[Notice, ...]:
    """What a reader of a file says."""
    return tuple(Notice(NoticeKind.READ, said=said) for said in words)
