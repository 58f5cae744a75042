"""A base that is not level is named as that, and never as a tracker that stretches space."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from lrm_ident.diagnosis.confirm import confirm
from lrm_ident.diagnosis.diagnose import diagnose
from lrm_ident.diagnosis.diagnosis_report import report_of
from lrm_ident.diagnosis.forward_selection import Choice, _most_helpful
from lrm_ident.diagnosis.screening.candidates import PLAIN
from lrm_ident.diagnosis.screening.linearised_fit import LinearEstimate
from lrm_ident.diagnosis.screening.score_test import ScoredCandidate
from lrm_ident.study.study import Study
from lrm_math.arm.arm import Arm
from lrm_math.effects import Effect, effects_at
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from tests.support.sweep import soak
from validation.as_deployed.leaning import Lean, leaning_recording

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
    assert first is not None
    assert first.why.startswith("the base is not level: gravity leans and bends the arm, by up to ")
    assert "rotation of gravity about x 5." in first.why


def test_nothing_gives_way_to_gravity(tmp_path: Path) -> None:
    """A model without compliances cannot show a lean, and that is said."""
    data, _ = leaning_recording(7, Lean("x", 5, 60)).load(tmp_path)
    assert data.arm is not None
    rigid = model_of(data.arm, effects_at(data.arm, "offsets@joint2"))
    found = diagnose(rigid.with_free(rigid.keys[:1]), data)
    reasons = {effect.name: str(reason) for effect, reason in found.not_testable}
    assert reasons["gravity@base"] == "nothing of the model gives way to gravity; fit compliances first"


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
