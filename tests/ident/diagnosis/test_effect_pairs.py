"""A tracker is named only where no pair of effects of arm and installation predicts as well."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from lrm_ident.diagnosis.candidate_trial import refit_trial
from lrm_ident.diagnosis.diagnose import Diagnosis, diagnose
from lrm_ident.diagnosis.effect_pairs import EffectPairs
from lrm_ident.diagnosis.forward_selection import forward_select
from lrm_ident.diagnosis.reason import Reason, ReasonKind
from lrm_ident.diagnosis.screening.score_test import ScoredCandidate
from lrm_ident.fitting.cross_validation import blocks_of_fit
from lrm_ident.fitting.progress import silent
from lrm_ident.study.study import Study
from validation.as_deployed.effects import RockingFeet
from validation.as_deployed.leaning import Lean, leaning_recording
from validation.as_deployed.worlds import SimulatedCase
from validation.hidden_effects.case import DEG
from validation.synthetic import ArmDescription, BaseRocking, HiddenEffect, SkewTracker

pytestmark = [pytest.mark.usefixtures("one_step_folds"), pytest.mark.long]

TRACKER, GRAVITY, YIELDS, CURVE = "measurement_frame@frame", "gravity@base", "base_compliance@base", "base_curve@base"
NONE = (0.0, 0.0, 0.0)
WORLDS: dict[str, tuple[Lean, HiddenEffect]] = {
    "leans and yields": (Lean("y", -5, 80), BaseRocking(0.012, (1.0, 0.0, 0.0))),
    "leans and rocks": (Lean("x", 3, 200), RockingFeet((1.0, 0.0, 0.0), 0.4 * DEG, 0.05)),
    "rocks obliquely": (Lean("x", 0, 150), RockingFeet((0.6, 0.8, 0.0), 0.6 * DEG, 0.1)),
    "stretched": (Lean("x", 0, 80), SkewTracker(NONE, (0.008, -0.006, 0.0), NONE)),
    "sheared": (Lean("x", 0, 150), SkewTracker(NONE, NONE, (0.0, 0.007, 0.0))),
}


@cache
def diagnosed(name: str) -> Diagnosis:
    """Diagnosis of the plain fit in a world."""
    lean, effect = WORLDS[name]

    def build(_arm: ArmDescription, _seed: int) -> tuple[HiddenEffect, ...]:
        return (effect,)

    with TemporaryDirectory() as folder:
        data, _ = leaning_recording(1, lean, build).load(Path(folder))
    return diagnose(Study.of(data).fit().model, data)


def one_of(found: Diagnosis, name: str) -> ScoredCandidate:
    """A candidate by its name."""
    return next(one for one in found.scored if one.name == name)


def pair_instead(found: Diagnosis) -> set[str]:
    """Names of the pair that predicts as well as the tracker."""
    screening = found.screening
    alone = {one.name: one.alone for one in screening.scored}
    pair = EffectPairs(screening.scored, screening.sets, screening.linear, alone).pair_instead_of(
        one_of(found, TRACKER)
    )
    return {one.name for one in pair or ()}


@pytest.mark.parametrize(("name", "pair"), [("leans and yields", YIELDS), ("leans and rocks", CURVE)])
def test_a_base_explains_by_two_effects_what_a_tracker_would(name: str, pair: str) -> None:
    assert pair_instead(diagnosed(name)) == {GRAVITY, pair}


@pytest.mark.parametrize("name", ["stretched", "sheared"])
def test_a_tracker_that_stretches_space_is_named(name: str) -> None:
    found = diagnosed(name)
    assert not pair_instead(found)
    assert found.supported[0].name == TRACKER


def test_where_a_pair_predicts_as_well_the_tracker_alone_is_not_selected() -> None:
    found = diagnosed("leans and yields")
    screening, possible = found.screening, [one_of(found, TRACKER)]
    assert not forward_select(screening.scored, screening.sets, screening.linear, silent, None, possible).effects


@pytest.mark.parametrize(("name", "refused"), [("rocks obliquely", True), ("stretched", False)])
def test_a_curve_of_the_tracker_is_refused_where_it_leaves_more_than_the_noise(name: str, refused: bool) -> None:
    """A base that rocks about an oblique axis: the curve imitates it in part, and would not be in the deployed arm."""
    found = diagnosed(name)
    curve = one_of(found, "frame_curve@frame")
    trial = refit_trial(found, curve, blocks_of_fit(found.fit, found.data))
    assert (trial.objection == Reason(ReasonKind.CURVED_IN_PART)) is refused


def test_a_tracker_that_leaves_more_than_the_noise_must_not_make_the_deployed_arm_worse() -> None:
    """A marker that is hidden at times: no effect fits, the frame fits in part, and the arm would change with it."""
    recording = SimulatedCase.of("catalogue/second/hidden-marker/unforeseen/300/0").record()
    with TemporaryDirectory() as folder:
        data, _ = recording.load(Path(folder))
    found = diagnose(Study.of(data).fit().model, data)
    trial = refit_trial(found, one_of(found, TRACKER), blocks_of_fit(found.fit, found.data))
    assert trial.objection == Reason(ReasonKind.WORSE_DEPLOYED)
    without, with_it = trial.worse_deployed or (0.0, 0.0)
    assert with_it > without


def test_a_tracker_that_explains_all_may_change_the_deployed_arm() -> None:
    """What is measured with a stretched tracker cannot tell whether the arm became better."""
    found = diagnosed("stretched")
    assert refit_trial(found, one_of(found, TRACKER), blocks_of_fit(found.fit, found.data)).refit
