"""Faults of measuring: what all poses do together is named as such, and nothing is named for it at a joint."""

from __future__ import annotations

import pytest

from lrm_ident.diagnosis.auto import AutoRun, run_auto
from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport, report_of
from lrm_ident.fitting.identifiability import fit_identifiable
from lrm_ident.report.diagnosis.conclusion import conclude
from lrm_math.arm.arm import Arm
from lrm_math.effects import effects_at
from lrm_math.model.model import model_of
from tests.support.sweep import soak
from validation.hidden_effects.case import FAULTS, FIRST_SEED
from validation.hidden_effects.data import NOISE_M, spoiled
from validation.hidden_effects.faults.cases import FAULT_CASES

pytestmark = pytest.mark.usefixtures("one_step_folds")

POSES, SEED = 150, 77
BY_NAME = {case.name: case for case in FAULT_CASES}


def course(lab: Arm, name: str) -> tuple[AutoRun, DiagnosisReport]:
    data, _ = spoiled(BY_NAME[name], SEED - FIRST_SEED[FAULTS], POSES)
    model = model_of(lab, effects_at(lab, "offsets") + effects_at(lab, "compliance"))
    run = run_auto(fit_identifiable(model, data, model.keys).fit.model, data)
    return run, report_of(run.confirmed)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "named"),
    [
        ("a lens that stretches", "measurement_frame@frame"),
        *soak(("the board's clock is wrong", "common_gain@servos"), ("all lengths grow", "drift@frame")),
    ],
)
def test_one_common_cause_is_one_name(lab: Arm, fault: str, named: str) -> None:
    """Before: a cable between joints, nothing at 11 times the noise, nothing at twice the noise."""
    run, report = course(lab, fault)
    assert named in run.steps[1].names
    assert len(run.steps) <= 3
    assert run.steps[-1].fit.sigma < 1.1 * NOISE_M
    assert report.verdict == "nothing_missing"


@pytest.mark.slow
def test_structure_says_what_it_looks_most_like(lab: Arm) -> None:
    run, report = course(lab, "the board's clock drifts")
    assert [step.added for step in run.steps] == [""]
    assert report.verdict == "unexplained_structure"
    said = dict(conclude(report).facts)["acts most like"]
    assert said.startswith("a free function of order in the gain of all joints, which leaves")
