"""Seeds and cases of a law: a few in the suite, all of them in `make soak`, which has the profile of many examples."""

from __future__ import annotations

import pytest
from _pytest.mark import ParameterSet
from hypothesis import settings

USUAL_EXAMPLES = 12


def in_soak() -> bool:
    """Whether this is `make soak`; only there tests and cases marked `soak` run."""
    return settings.default is not None and settings.default.max_examples > USUAL_EXAMPLES


def examples(few: int, many: int) -> settings:
    """Examples of a law whose single one takes long, in `@examples(…) @given(…)`."""
    return settings(max_examples=many if in_soak() else few, deadline=None)


def seeds(few: int, many: int) -> range:
    """Seeds from 0 on."""
    return range(many if in_soak() else few)


def soak(*cases: object) -> list[ParameterSet]:
    """Cases of a `parametrize` that only `make soak` runs: each the value, or the tuple of values, of one."""
    return [pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.soak) for case in cases]
