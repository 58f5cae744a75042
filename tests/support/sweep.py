"""Seeds of a law: a few in the suite, all of them in `make soak`, which has the profile of many examples."""

from __future__ import annotations

from hypothesis import settings

USUAL_EXAMPLES = 20


def seeds(few: int, many: int) -> range:
    """Seeds from 0 on."""
    return range(many if settings.default is not None and settings.default.max_examples > USUAL_EXAMPLES else few)
