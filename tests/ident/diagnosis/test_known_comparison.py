"""A comparison that is known spares a diagnosis its cross-validation, and changes nothing of what it says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import lrm_ident as lrm
from lrm_ident.diagnosis import confirm, diagnosis_report
from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_ident.study.study import Study
from tests.conftest import EXAMPLE


@pytest.fixture(scope="module")
def study() -> Study:
    """The first 80 poses of the shipped data set, fitted."""
    return Study.of(lrm.load(EXAMPLE).take(np.arange(80))).fit()


@pytest.mark.slow
def test_a_known_comparison_changes_nothing(study: Study, monkeypatch: pytest.MonkeyPatch) -> None:
    screened, compared = study.screen(), study.compare()
    alone = study.diagnose(screened=screened)
    assert diagnosis_report._same_fit(screened, compared)
    monkeypatch.setattr(confirm, "blocks_of_fit", _only_with_a_candidate(confirm.blocks_of_fit, study))
    known = study.diagnose(screened=screened, compared=compared)
    assert known.verdict == alone.verdict
    assert known.held_out.rms == pytest.approx(alone.held_out.rms, abs=1e-9)
    assert known.patterns.predictable.error.rms == pytest.approx(alone.patterns.predictable.error.rms, abs=1e-9)
    for one, other in zip(known.ranking, alone.ranking, strict=True):
        assert (one.scored.name, one.verdict, one.equivalent) == (other.scored.name, other.verdict, other.equivalent)
        assert one.held_out_rms == pytest.approx(other.held_out_rms, abs=1e-9)

    part = study.data.take(np.arange(60))
    others = (
        replace(compared, data=part),
        replace(compared, held_out=replace(compared.held_out, residual=None)),
        replace(
            compared,
            equilibrium=replace(compared.equilibrium, model=compared.equilibrium.model.with_free(study.model.free[1:])),
        ),
    )
    for other in others:  # of other poses, of poses that no fit saw, of other parameters
        assert not diagnosis_report._same_fit(screened, other)


def _only_with_a_candidate(blocks_of_fit: Callable[..., Any], study: Study) -> Callable[..., Any]:
    """The cross-validation, which the model as it is must not go through again."""

    def checked(fitted: Fit, *args: Any, **words: Any) -> Any:
        assert set(fitted.model.free) != set(study.model.free)
        return blocks_of_fit(fitted, *args, **words)

    return checked
