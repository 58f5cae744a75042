"""Which steps of `auto` show a cause: none in worlds whose cause the catalogue lacks, all in worlds of known causes."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.diagnosis.auto import run_auto
from lrm_ident.diagnosis.shown_causes import Claim, TakenStep, step_claims
from lrm_ident.fitting.loss import SQUARED
from lrm_ident.fitting.model_fit import fit_model
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


def run(folder: Path, seed: int, *hidden: HiddenEffect) -> list[Claim]:
    model, data = upright_measurements(folder, seed, 300, 3e-4, hidden)
    course = run_auto(fit_model(model, data, "identifiable", SQUARED).fit.model, data)
    for step, one in zip(course.steps[1:], course.claims, strict=True):
        assert (one.claim == "description") == step.describes
    return [one.claim for one in course.claims]


@pytest.mark.slow
@pytest.mark.parametrize("hidden", UNKNOWN, ids=lambda hidden: type(hidden).__name__)
@pytest.mark.parametrize("seed", range(3))
def test_a_cause_without_a_form_is_no_finding_of_another(tmp_path: Path, seed: int, hidden: HiddenEffect) -> None:
    """Before: a target half hidden was found to be a wrong scale of the tracker."""
    claimed = run(tmp_path, seed, hidden)
    assert "finding" not in claimed


steps = st.builds(TakenStep, st.floats(-0.1, 10.0), st.booleans(), st.booleans())


@given(st.lists(steps, max_size=8), st.floats(0.0, 20.0))
def test_claims_of_any_sequence_of_steps(taken: list[TakenStep], left: float) -> None:
    claims = step_claims(taken, left)
    for number, (step, one) in enumerate(zip(taken, claims, strict=True)):
        later = zip(taken[number + 1 :], claims[number + 1 :], strict=True)
        no_cause = [each for each, claim in later if claim.claim != "finding" and not each.of_present]
        assert one.unexplained == pytest.approx(left + sum(max(each.taken, 0.0) for each in no_cause))
        assert (one.claim == "description") == step.describes
        assert one.claim != "finding" or one.unexplained <= LEFT_PER_TAKEN * step.taken


@given(st.lists(steps, max_size=8), st.floats(0.0, 20.0), st.floats(0.0, 20.0))
def test_more_that_stays_shows_no_more(taken: list[TakenStep], left: float, more: float) -> None:
    less, greater = step_claims(taken, left), step_claims(taken, left + more)
    assert all(one.claim == "finding" or other.claim != "finding" for one, other in zip(less, greater, strict=True))


@pytest.mark.slow
@pytest.mark.parametrize("hidden", KNOWN, ids=str)
@pytest.mark.parametrize("seed", range(2))
def test_known_causes_are_findings(tmp_path: Path, seed: int, hidden: tuple[HiddenEffect, ...]) -> None:
    claimed = run(tmp_path, seed, *hidden)
    assert claimed.count("finding") >= len(hidden)
    assert "possible_cause" not in claimed
