"""The course of `auto` on the real arm is that of docs/results.md: what changes the rules of selection shows here."""

from __future__ import annotations

from dataclasses import replace

import pytest

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.study.study import Study

STEPS = ["cable_curve@joint1+joint2", "servo_gain@joint4", "base_curve@base"]
"""They are taken in ten of ten folds too; no step is one of a session, which the deployed arm would pay for."""


@pytest.mark.soak
@pytest.mark.slow
def test_the_steps_on_the_real_arm(real: Measurements) -> None:
    """From the thesis's option 1, which holds the angles of the base. The order of the poses follows joint 1, so a free
    curve of time imitates these angles: it was the first step, and the deployed arm had 2.23 mm for 1.90 shown."""
    start = Study.of(replace(real, source=replace(real.source, arm_name="lrm-lab"))).fit("option1")
    course, _ = start.auto()
    assert [step.added for step in course.steps[1:4]] == STEPS
    shown, deployed = error_stats(course.confirmed.held_out).rms, course.confirmed.deployed.now.rms
    assert shown < 1.9e-3
    assert deployed < 1.02 * shown
