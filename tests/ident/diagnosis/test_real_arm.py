"""The course of `auto` on the real arm is that of docs/results.md: what changes the rules of selection shows here."""

from __future__ import annotations

from dataclasses import replace

import pytest

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.diagnosis.auto import run_auto
from lrm_ident.fitting.levenberg_marquardt import fit
from lrm_ident.fitting.parameter_sets import select_parameters
from lrm_math.arm.arm import Arm
from lrm_math.effects import effects_at
from lrm_math.model.model import model_of

STEPS = ["drift_curve@base", "cable_curve@joint1+joint2", "servo_gain@joint4", "base_curve@base"]
"""The last three are taken in ten of ten folds too; no step is a tracker's, which the deployed arm would pay for."""


@pytest.mark.soak
@pytest.mark.slow
def test_the_steps_on_the_real_arm(real: Measurements, lab: Arm) -> None:
    model = model_of(lab, effects_at(lab, "offsets") + effects_at(lab, "compliance"))
    start = fit(replace(model, free=select_parameters(model, "option1")), real)
    course = run_auto(start.model, real)
    assert [step.added for step in course.steps[1:5]] == STEPS
    assert error_stats(course.confirmed.held_out).rms < 2.1e-3
    assert course.confirmed.deployed.now.rms < 2.5e-3
