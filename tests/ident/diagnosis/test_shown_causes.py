"""Which steps of `auto` show a cause: none in worlds whose cause the catalogue lacks, all in worlds of known causes."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.diagnosis.auto import run_auto
from lrm_ident.diagnosis.shown_causes import Claim, claim, unexplained_square
from lrm_ident.fitting.loss import SQUARED
from lrm_ident.fitting.model_fit import fit_model
from lrm_ident.report.step_card import ErrorFall
from lrm_ident.residual.thresholds import LEFT_PER_TAKEN
from tests.support.upright_arm import upright_measurements
from validation.hidden_effects.unforeseen_cases import CatchingCable, OccludedMarker, SharedSupply
from validation.synthetic import FrictionLag, HiddenEffect, SoftPlay

UNKNOWN: tuple[HiddenEffect, ...] = (
    OccludedMarker(3e-3),
    SharedSupply(2, 3, 0.4),
    CatchingCable(2, {3: 0.4, 4: -0.3}, 0.45, 0.03),
)
KNOWN: tuple[tuple[HiddenEffect, ...], ...] = (
    (SoftPlay(2, 0.02, 0.04),),
    (FrictionLag(3, 0.02, 0.01),),
    (SoftPlay(2, 0.02, 0.04), FrictionLag(4, 0.02, 0.01)),
)


def run(folder: Path, seed: int, *hidden: HiddenEffect) -> tuple[Claim, ...]:
    model, data = upright_measurements(folder, seed, 300, 3e-4, hidden)
    course = run_auto(fit_model(model, data, "identifiable", SQUARED).fit.model, data)
    for step, claimed, taken in zip(course.steps[1:], course.claims, course.taken, strict=True):
        assert (claimed == "description") == step.describes
        assert claimed != "finding" or unexplained_square(course.report) <= LEFT_PER_TAKEN * taken
    return course.claims


@pytest.mark.slow
@pytest.mark.parametrize("hidden", UNKNOWN, ids=lambda hidden: type(hidden).__name__)
@pytest.mark.parametrize("seed", range(3))
def test_a_cause_without_a_form_is_no_finding_of_another(tmp_path: Path, seed: int, hidden: HiddenEffect) -> None:
    """Before: a target half hidden was found to be a wrong scale of the tracker."""
    claimed = run(tmp_path, seed, hidden)
    assert "finding" not in claimed


@given(st.floats(0.1, 10.0), st.floats(0.1, 10.0), st.floats(0.0, 20.0))
def test_the_card_of_a_step_says_the_same(before: float, after: float, left: float) -> None:
    fall = ErrorFall(before, after, held_out=True)
    said = fall.stands_for_another(left)
    if after < before:
        assert (said is None) == (claim(False, left, before**2 - after**2) == "finding")
    assert ErrorFall(before, after, held_out=False).stands_for_another(left) is None


@pytest.mark.slow
@pytest.mark.parametrize("hidden", KNOWN, ids=str)
@pytest.mark.parametrize("seed", range(2))
def test_known_causes_are_findings(tmp_path: Path, seed: int, hidden: tuple[HiddenEffect, ...]) -> None:
    claimed = run(tmp_path, seed, *hidden)
    assert claimed.count("finding") >= len(hidden)
    assert "possible_cause" not in claimed
