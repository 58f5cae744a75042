"""Fit and diagnosis of arms of any shape: without masses, with parallel and meeting axes, with displaced links."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurement_file.commanded_poses import directions
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.robot_files.arm_text import template
from lrm_ident.data.robot_files.urdf import parse_urdf
from lrm_ident.data.robot_files.urdf_arm import import_arm
from lrm_ident.data.source import Source
from lrm_ident.diagnosis.auto import run_auto
from lrm_ident.diagnosis.diagnose import diagnose
from lrm_ident.diagnosis.diagnosis_report import build_report
from lrm_ident.diagnosis.reason import ReasonKind
from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_ident.fitting.loss import SQUARED
from lrm_ident.fitting.model_fit import fit_model, nominal_model
from lrm_ident.report.fit import fit_document
from lrm_ident.residual.error_breakdown import HeldOutResidual
from lrm_ident.study.model_on_data import ErrorSummary
from lrm_math.arm.arm import Arm
from lrm_math.effects import effects_at
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from tests.support.mimic_robots import palletiser
from tests.support.random_arms import random_arm, with_followers
from tests.support.sweep import seeds
from tests.support.upright_arm import upright_measurements

pytestmark = pytest.mark.long


GEOMETRIES = ("any", "parallel", "meeting")
MASSES = ("anywhere", "on axes", "none")


def described(seed: int, joints: int, geometry: str, masses: str) -> Arm:
    """A random arm whose consecutive axes are askew, all parallel, or meet at right angles; perhaps weightless.

    A body's centre of mass in its frame's origin is on the axis of the next joint.
    """
    arm = random_arm(seed, joints)
    if geometry == "parallel":
        arm = replace(arm, joints=tuple(replace(joint, alpha=0.0) for joint in arm.joints))
    if geometry == "meeting":
        links = tuple(replace(joint, a=0.0, alpha=np.pi / 2 * (-1) ** i) for i, joint in enumerate(arm.joints))
        arm = replace(arm, joints=links)
    if masses == "none":
        return replace(arm, bodies=())
    return arm if masses == "anywhere" else replace(arm, bodies=tuple(replace(b, com=(0, 0, 0)) for b in arm.bodies))


def measured_on(arm: Arm, seed: int, count: int, noise: float = 2e-4) -> Measurements:
    """Random poses of an arm whose dimensions and compliances are a little off."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1.5, 1.5, (count, arm.dof))
    poses, number = Poses(q=q, payload=np.zeros(count), direction=directions(q, None)), np.arange(count)
    model = nominal_model(arm)
    values = {key: 0.1 * rng.uniform() * p.typical for key, p in zip(model.keys, model.parameters, strict=True)}
    tcp = solve_equilibrium(model_of(arm, model.effects, values), poses).tcp + rng.normal(0, noise, (count, 3))
    return Measurements.of_tcp(poses, tcp, noise, pose=number, source=Source(arm=arm))


@pytest.mark.usefixtures("one_step_folds")
def test_the_play_of_a_palletisers_motor_is_named() -> None:
    """Rods turn forearm and gripper by the motors of other joints; the fit knows, and diagnosis names the motor."""
    arm = import_arm(parse_urdf(Path("palletiser.urdf"), palletiser())).arm
    truth, rng = nominal_model(arm), np.random.default_rng(1)
    sizes = {"rad": 0.01, "mm": 0.0008, "rad_per_Nm": 0.05}
    values = {key: abs(rng.normal(0.0, sizes[p.unit])) for key, p in zip(truth.keys, truth.parameters, strict=True)}
    values |= {"backlash.joint2.b_rad": np.radians(2.0)}
    low, high = np.array([(joint.lower, joint.upper) for joint in arm.joints]).T
    q, number = rng.uniform(low, high, (150, arm.dof)), np.arange(150)
    poses = Poses(q=q, payload=rng.choice([0.0, 0.1], 150), direction=directions(q, None))
    hidden = model_of(arm, (*truth.effects, *effects_at(arm, "backlash@joint2")), values)
    tcp = solve_equilibrium(hidden, poses).tcp + rng.normal(0, 2e-4, (150, 3))
    data = Measurements.of_tcp(poses, tcp, 2e-4, pose=number, source=Source(arm=arm))
    report = build_report(diagnose(fit_model(truth, data, "identifiable", SQUARED).fit.model, data))
    assert report.verdict == "effect_missing"
    assert report.first.name == "backlash@joint2"


@pytest.mark.usefixtures("one_step_folds")
@pytest.mark.slow
@settings(max_examples=8, deadline=None, phases=[Phase.explicit, Phase.reuse, Phase.generate])
@given(st.integers(0, 1000), st.integers(1, 10), st.sampled_from(GEOMETRIES), st.sampled_from(MASSES), st.booleans())
def test_every_arm_fits_and_diagnoses(seed: int, joints: int, geometry: str, masses: str, some_follow: bool) -> None:
    arm = described(seed, joints, geometry, masses)
    arm = with_followers(arm, seed) if some_follow else arm
    data, model = measured_on(arm, seed, 40 + 6 * joints), nominal_model(arm)
    before = error_stats(data.tcp - solve_equilibrium(model, data.poses).tcp)
    result = fit_model(model, data, "identifiable", SQUARED)
    found = diagnose(result.fit.model, data)
    after = error_stats(result.fit.residual)
    assert after.rms <= before.rms
    assert fit_document(result.fit, ErrorSummary(before, after, HeldOutResidual(None, "")), data).json()
    assert found.verdict
    if masses == "none":
        reasons = {effect.id: reason.kind for effect, reason in found.not_testable}
        loaded = ("backlash", "nonlinear_stiffness", "cable_spring")
        assert {reasons[name] for name in loaded} == {ReasonKind.MASSLESS}


NOISE = 3e-4
WITHOUT = template("upright").replace("extra_z_mm = 0.0\n", "")


def fitted(folder: Path, seed: int, softness: float, text: str) -> Fit:
    model, data = upright_measurements(folder, seed, 240, NOISE, softness=softness, text=text)
    return fit_model(model, data, "identifiable", SQUARED).fit


def test_extra_z_explains_most_of_what_soft_joints_show_of_displaced_masses(tmp_path: Path) -> None:
    arms = seeds(3, 8)

    def excess(text: str) -> float:
        """Mean square over that of the noise, less one, of several arms."""
        return sum((fitted(tmp_path, seed, 3.0, text).sigma / NOISE) ** 2 - 1.0 for seed in arms)

    without = excess(WITHOUT)
    assert without > len(arms) * 0.04  # else there is nothing to explain
    assert excess(template("upright")) < 0.4 * without


@pytest.mark.slow
def test_no_cause_is_named_on_a_healthy_arm_with_soft_joints(tmp_path: Path) -> None:
    named = []
    arms = seeds(4, 30)
    for seed in arms:
        model, data = upright_measurements(tmp_path, seed, 240, NOISE, softness=2.0)
        named += [
            step.added for step in run_auto(fit_model(model, data, "identifiable", SQUARED).fit.model, data).steps[1:]
        ]
    assert len(named) <= len(arms) / 15, named  # of thirty arms five without extra z
