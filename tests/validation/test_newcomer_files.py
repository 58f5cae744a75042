"""Single changes of healthy files are refused by name, said, or without effect: a few dozen of the fuzz."""

from __future__ import annotations

import pytest

from tests.support.sweep import seeds
from validation.newcomer_files.__main__ import run
from validation.newcomer_files.outcome import SILENT, TRACEBACK


@pytest.mark.slow
@pytest.mark.usefixtures("one_step_folds")
def test_no_change_is_silently_wrong_or_a_traceback() -> None:
    bad = [one for one in run(seeds(3, 35)) if one.outcome in (SILENT, TRACEBACK)]
    assert not bad, bad
