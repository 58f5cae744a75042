"""A base that is not level and a tracker that stretches space: each is named only where it is that."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from lrm_ident.diagnosis.candidate_trial import refit_trial
from lrm_ident.diagnosis.confirm import confirm
from lrm_ident.diagnosis.diagnose import Diagnosis, diagnose
from lrm_ident.diagnosis.diagnosis_report import report_of
from lrm_ident.diagnosis.forward_selection import Choice, _most_helpful, forward_select
from lrm_ident.diagnosis.reason import Reason, ReasonKind
from lrm_ident.diagnosis.screening.candidates import PLAIN
from lrm_ident.diagnosis.screening.linearised_fit import LinearEstimate
from lrm_ident.diagnosis.screening.score_test import ScoredCandidate
from lrm_ident.fitting.cross_validation import blocks_of_fit
from lrm_ident.fitting.progress import silent
from lrm_ident.study.study import Study
from lrm_math.arm.arm import Arm
from lrm_math.effects import Effect, effects_at
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from tests.support.sweep import soak
from validation.as_deployed.leaning import Lean, leaning_recording
from validation.as_deployed.worlds import OngoingCase
from validation.hidden_effects.case import DEG
from validation.synthetic import ArmDescription, BaseRocking, HiddenEffect, SkewTracker
from validation.synthetic.hidden_links import RockingFeet

pytestmark = [pytest.mark.usefixtures("one_step_folds"), pytest.mark.long]


NOISE_MM = 0.52


@pytest.mark.parametrize("lean", [Lean("x", 5, 100), *soak(Lean("y", -4, 60))], ids=lambda lean: lean.words)
def test_the_lean_is_named_and_deployed(lean: Lean, tmp_path: Path) -> None:
    run = leaning_recording(7, lean)
    data, fresh = run.load(tmp_path)
    plain = Study.of(data).fit()
    found, named = plain.auto()
    assert [step.added for step in found.steps[1:]] == ["gravity@base"]
    assert found.steps[1].names == ("gravity@base",)
    turned = np.degrees(named.model.value(f"gravity.base.{lean.axis}_rad"))
    assert turned == pytest.approx(lean.tilt_deg, abs=0.8)

    def missed(study: Study) -> float:
        error = solve_equilibrium(study.model, fresh).tcp - run.tips_m
        return 1e3 * float(np.sqrt((error**2).sum(axis=1).mean()))

    assert missed(named) < NOISE_MM < missed(plain)


def test_a_level_base_is_not_blamed(tmp_path: Path) -> None:
    data, _ = leaning_recording(8, Lean("x", 0, 80)).load(tmp_path)
    found, _ = Study.of(data).fit().auto()
    assert [step.added for step in found.steps[1:]] == []
    assert found.verdict == "nothing_missing"


def test_the_report_says_that_the_base_is_not_level(tmp_path: Path) -> None:
    data, _ = leaning_recording(7, Lean("x", 5, 60)).load(tmp_path)
    study = Study.of(data).fit()
    first = report_of(confirm(diagnose(study.model, study.data))).first
    assert first.claim.effect.name == first.name
    assert first.why.startswith("the base is not level: gravity leans and bends the arm, by up to ")
    assert "rotation of gravity about x 5." in first.why


def test_nothing_gives_way_to_gravity(tmp_path: Path) -> None:
    """A model without compliances cannot show a lean, and that is said."""
    data, _ = leaning_recording(7, Lean("x", 5, 60)).load(tmp_path)
    assert data.source.arm is not None
    rigid = model_of(data.source.arm, effects_at(data.source.arm, "offsets@joint2"))
    found = diagnose(rigid.with_free(rigid.keys[:1]), data)
    assert {effect.name: reason for effect, reason in found.not_testable}["gravity@base"] == Reason(ReasonKind.RIGID)


@pytest.mark.parametrize(("share", "blamed"), [(0.97, "gravity@base"), (0.5, "measurement_frame@frame")])
def test_a_tracker_is_blamed_only_where_it_is_surely_better(lab: Arm, share: float, blamed: str) -> None:
    """The tracker leaves a share of the held-out squares that the leaning base leaves."""
    noise = np.random.default_rng(0).chisquare(3, 100)
    before, base = LinearEstimate(np.zeros(1), np.zeros(1), 4.0, 4.0 * noise), 1.0 * noise
    tracker = share * np.random.default_rng(1).permutation(noise) if share > 0.9 else share * noise
    choices = [
        Choice(LinearEstimate(np.zeros(1), np.zeros(1), 1.0, squares), scored_as(effects_at(lab, name)[0]))
        for name, squares in (("measurement_frame", tracker), ("gravity", base))
    ]
    priority = dict.fromkeys(("measurement_frame@frame", "gravity@base"), PLAIN)
    assert _most_helpful(choices, before, priority, {}).scored.name == blamed


def scored_as(effect: Effect) -> ScoredCandidate:
    """A candidate of which nothing is asked but its effect, name and size."""
    candidate = SimpleNamespace(effect=effect, name=effect.name)
    return cast("ScoredCandidate", SimpleNamespace(candidate=candidate, name=effect.name, size=len(effect.parameters)))


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
    pair = found.screening.pairs.pair_instead_of(one_of(found, TRACKER))
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
    assert not forward_select(found.screening.pairs, silent, None, [one_of(found, TRACKER)]).effects


@pytest.mark.parametrize(("name", "refused"), [("rocks obliquely", True), ("stretched", False)])
def test_a_curve_of_the_tracker_is_refused_where_it_leaves_more_than_the_noise(name: str, refused: bool) -> None:
    """A base that rocks about an oblique axis: the curve imitates it in part, and would not be in the deployed arm."""
    found = diagnosed(name)
    curve = one_of(found, "frame_curve@frame")
    trial = refit_trial(found, curve, blocks_of_fit(found.fit, found.data))
    assert (trial.objection == Reason(ReasonKind.CURVED_IN_PART)) is refused


def test_a_tracker_that_leaves_more_than_the_noise_must_not_make_the_deployed_arm_worse() -> None:
    """A marker that is hidden at times: no effect fits, the frame fits in part, and the arm would change with it."""
    recording = OngoingCase.of("catalogue/second/hidden-marker/unforeseen/300/0").record()
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
