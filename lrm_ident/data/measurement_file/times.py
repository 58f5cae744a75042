"""Times of poses as programs write them: numbers, ISO 8601, or the usual dates of Europe and America, as seconds."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from datetime import datetime

import numpy as np

from lrm_ident.data.table_text.csv_file import is_number
from lrm_math.arrays import Array

DAYS = ("%d.%m.%Y", "%Y/%m/%d", "%Y.%m.%d", "%d-%m-%Y", "%d/%m/%Y", "%m/%d/%Y")
CLOCKS = ("%H:%M:%S.%f", "%H:%M:%S", "%H:%M", "%I:%M:%S.%f %p", "%I:%M:%S %p", "%I:%M %p")
FORMS = (*(f"{day} {clock}" for day in DAYS for clock in CLOCKS), *CLOCKS)


def seconds_of(words: Sequence[str]) -> Array | None:
    """(N,), numbers as they are, dates and times of day since the first; None if they are no times, or of two meanings.

    An apostrophe before them, by which Excel keeps text, and a comma before fractions of a second are read over.
    """
    plain = [word.strip().lstrip("'").strip() for word in words]
    if all(is_number(word) for word in plain):
        values = np.array([float(word) for word in plain])
        return values if np.isfinite(values).all() else None
    instants = [
        since for read in _readers() if (since := _since_first([w.replace(",", ".") for w in plain], read)) is not None
    ]
    alike = all(np.array_equal(since, instants[0]) for since in instants)  # 3/4 is a day of April or of March
    return instants[0] if instants and alike else None


def _readers() -> Iterator[Callable[[str], datetime]]:
    yield datetime.fromisoformat
    for form in FORMS:
        yield lambda word, form=form: datetime.strptime(word, form)  # type: ignore[misc]


def _since_first(words: Sequence[str], read: Callable[[str], datetime]) -> Array | None:
    try:
        dates = [read(word) for word in words]
        return np.array([(date - dates[0]).total_seconds() for date in dates])
    except (ValueError, TypeError):
        return None
