"""What the screening estimates of positions that are weighed unlike, beside the error of the tip that is reported."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lrm_ident.data.measurements import Measurements
from lrm_ident.data.source import Source
from lrm_ident.diagnosis.diagnose import diagnose
from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport, build_report
from lrm_ident.diagnosis.reason import ReasonKind
from lrm_ident.study.study import Study
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import effects_at
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of

ARM, COUNT = "two-joint", 120
GAIN = "servo_gain.joint1.g_plus_rad_per_rad"


@pytest.fixture(scope="module")
def report() -> DiagnosisReport:
    """Of a servo that turns 3 % too far to one side, every other pose measured ten times as exactly."""
    arm, rng = load_arm(ARM), np.random.default_rng(1)
    effects = [effects_at(arm, name)[0] for name in ("offsets@joint1", "servo_gain@joint1", "compliance@joint2")]
    pose = np.arange(1, COUNT + 1)
    poses = replace(poses_of(rng.uniform(-1.2, 1.2, (COUNT, arm.dof))), number=pose)
    sd = np.where(pose % 2, 2e-4, 2e-3)
    tcp = solve_equilibrium(model_of(arm, effects, {GAIN: 0.03}), poses).tcp
    tcp = tcp + rng.normal(0.0, 1.0, tcp.shape) * sd[:, None]
    source = Source(Path("data.csv"), "0" * 64, arm=arm, arm_name=ARM)
    data = Measurements.of_tcp(poses, tcp, sd=sd, pose=pose, source=source)
    study = Study.of(data, ("offsets@joint1", "compliance@joint2")).fit()
    return build_report(diagnose(study.model, study.data))


def test_the_tip_keeps_the_share_that_the_screening_leaves(report: DiagnosisReport) -> None:
    """Before: what the screening leaves of weighted numbers stood beside the error of the tip, as if it were of it."""
    without = report.diagnosis.screening.linear.baseline.rms
    assert without > 1.05 * report.held_out.rms, "else nothing is shown"
    for one in report.ranking:
        if not one.exact:
            assert one.held_out_rms / report.held_out.rms == pytest.approx(one.scored.alone.rms / without)


def test_what_explains_too_little_is_judged_against_its_own_baseline(report: DiagnosisReport) -> None:
    without = report.diagnosis.screening.linear.baseline.rms
    saved = {one.name: 1.0 - (one.scored.alone.rms / without) ** 2 for one in report.ranking}
    little = [one.name for one in report.ranking if one.reason.kind is ReasonKind.LITTLE]
    assert little
    assert max(saved[name] for name in little) < 0.05
