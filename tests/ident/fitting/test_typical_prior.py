"""The prior of typical sizes: what every fit does with what is declared beside each parameter."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.fitting.identifiability import fit_identifiable
from lrm_ident.fitting.levenberg_marquardt import fit
from lrm_ident.fitting.loss import SQUARED
from lrm_ident.fitting.model_fit import fit_model, nominal_model
from lrm_ident.fitting.parameter_sets import select_parameters
from lrm_ident.fitting.priors import Prior
from lrm_ident.fitting.typical_prior import TYPICAL, typical_prior
from lrm_math.arm.arm import Arm, TypicalSizes
from lrm_math.arm.arm_file import shipped_arms
from lrm_math.effects import effects_at
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import measured_range, solve_equilibrium
from lrm_math.model.model import Model, model_of
from tests.support.sweep import examples
from validation import synthetic

NOISE = 3e-4  # m


def measured(seed: int, count: int, noise: float = NOISE) -> Measurements:
    """Random poses of a random arm of the independent generator."""
    rig = synthetic.load_arm(shipped_arms()["lrm-lab"])
    q = synthetic.random_poses(rig, count, seed)
    tcp = synthetic.measure(rig, synthetic.GroundTruth.random(rig, seed % 1000), q, 0.0, noise, seed)
    number = np.arange(1, count + 1)
    return Measurements(poses_of(q), number, tcp, None, None, number, Path("synthetic"), "")


def seen_by(truth: Model, count: int, seed: int) -> Measurements:
    """Random poses of a model, with noise."""
    rng = np.random.default_rng(seed)
    poses = poses_of(rng.uniform(-1.2, 1.2, (count, truth.arm.dof)))
    truth = replace(truth, within=measured_range(solve_equilibrium(model_of(truth.arm, ()), poses)))
    tcp = solve_equilibrium(truth, poses).tcp + NOISE * rng.normal(size=(count, 3))
    number = np.arange(1, count + 1)
    return Measurements(poses, number, tcp, None, None, number, Path("made"), "", arm=truth.arm)


@pytest.mark.long
@examples(2, 4)
@given(seed=st.integers(0, 500))
def test_the_estimate_is_the_mode_of_gaussians_and_cauchy_distributions(lab: Arm, seed: int) -> None:
    """Central differences of the posterior itself, in standard errors, with the tails that reweighting stands for."""
    model = model_of(lab, [*nominal_model(lab).effects, *effects_at(lab, "servo_gain@joint2")])
    data = measured(seed, 40)
    found = fit_identifiable(model, data, model.keys).fit
    prior = typical_prior(found.model)
    gaussian = prior.tail == 0.0

    def minus_log_posterior(moved: Model) -> float:
        value = np.array([moved.value(key) for key in prior.keys])
        squares = (value[gaussian] ** 2 / np.diag(prior.covariance)[gaussian]).sum()
        tails = np.log1p((value[~gaussian] / prior.tail[~gaussian]) ** 2).sum()
        left = data.residual(solve_equilibrium(moved, data.poses, tolerance=1e-13))
        return float((left**2).sum() / (2.0 * found.sigma**2) + 0.5 * squares + tails)

    for key, error in zip(found.model.free, found.standard_error, strict=True):
        if key in found.at_bound:
            continue
        step = 1e-2 * error
        ends = (found.model.with_values_of([key], found.model.value(key) + sign * step) for sign in (1, -1))
        up, down = map(minus_log_posterior, ends)
        assert abs(up - down) / (2.0 * step) * error < 0.03, key


def test_wide_sizes_give_least_squares(lab: Arm) -> None:
    wide = replace(lab, typical_sizes=TypicalSizes(5e2, 5e3, 1e4))
    model = model_of(wide, nominal_model(wide).effects)
    keys = tuple(key for key in select_parameters(model, "option1") if ".base." not in key)
    model, data = model.with_free(keys), measured(5, 80)
    plain, vague = fit(model, data), fit(model, data, prior=typical_prior(model))
    moved = np.array([vague.model.value(key) - plain.model.value(key) for key in keys])
    assert np.abs(moved / np.maximum(plain.standard_error, 1e-12)).max() < 0.01


def test_an_effect_far_beyond_its_typical_size_is_not_lost(lab: Arm) -> None:
    """A tracker that stretches x by 6 %, 180 typical sizes. A Gaussian of that width would lose it.

    A stretch of all axes together is an arm that is longer; what the poses tell is how much more x is stretched.
    """
    x, y, z = (f"measurement_frame.frame.scale_{axis}_mm_per_m" for axis in "xyz")
    truth = model_of(lab, effects_at(lab, "measurement_frame"), {x: 0.06})
    model = model_of(lab, [*nominal_model(lab).effects, *truth.effects])
    data = seen_by(truth, 60, 1)
    found = fit_identifiable(model, data, model.keys).fit
    apart = found.model.value(x) - 0.5 * (found.model.value(y) + found.model.value(z))
    assert apart == pytest.approx(0.06, abs=0.004)
    assert found.sigma < 1.2 * NOISE


@pytest.mark.long
def test_few_poses_are_enough(lab: Arm) -> None:
    """24 poses for 45 parameters: near the noise at fresh poses."""
    fresh = measured(3003, 300, 0.0)
    model = nominal_model(lab)
    data = replace(measured(3, 24), arm=lab)
    found = fit_model(model, data, "identifiable", SQUARED).fit
    assert len(found.model.free) == 45 > found.effective_parameters
    left = fresh.residual(solve_equilibrium(found.model, fresh.poses))
    assert error_stats(left).rms < 3.0 * np.sqrt(3.0) * NOISE


def test_scales_of_the_parameters_do_not_matter(lab: Arm) -> None:
    """Typical sizes scale the iteration; the estimate follows from the prior alone."""
    data, found = measured(7, 40), []
    for sizes in (TypicalSizes(), TypicalSizes(3e-4, 0.2, 0.5)):
        model = nominal_model(replace(lab, typical_sizes=sizes))
        model = model.with_free(model.keys)
        sd = np.array([{"rad": 0.05, "mm": 0.005}.get(p.unit, 0.1) for p in model.parameters])
        prior = Prior("one", model.keys, np.zeros(len(sd)), np.diag(sd**2))
        found.append(fit(model, data, prior=prior))
    apart = (found[0].model.values - found[1].model.values) / np.maximum(found[0].standard_error, 1e-12)
    assert np.abs(apart).max() < 0.02


def test_what_no_pose_shows_stays_at_zero_and_the_fit_says_so(lab: Arm) -> None:
    rng = np.random.default_rng(0)
    q = rng.uniform(-1.0, 1.0, (60, lab.dof)) * (np.arange(lab.dof) != 3)
    model = model_of(lab, [*nominal_model(lab).effects, *effects_at(lab, "servo_gain@joint4")])
    tcp = solve_equilibrium(model, poses_of(q)).tcp + NOISE * rng.normal(size=(60, 3))
    number = np.arange(60)
    data = Measurements(poses_of(q), number, tcp, None, None, number, Path("made"), "")
    found = fit_identifiable(model, data, [key for key in model.keys if model.parameter(key).fixed is None]).fit
    told = dict(zip(found.model.free, found.told, strict=True))
    gain = [key for key in told if key.startswith("servo_gain")]
    assert max(abs(found.model.value(key)) for key in gain) < 1e-9
    assert max(told[key] for key in gain) < 1e-6
    assert told["offsets.joint2.theta_rad"] > 0.9


def test_an_arm_file_states_its_own_sizes(lab: Arm) -> None:
    machined = replace(lab, typical_sizes=TypicalSizes(5e-5, 1e-3, 1e-3))
    model = nominal_model(machined)
    prior = typical_prior(model.with_free(model.keys))
    assert prior.sd_of(["offsets.joint3.a_mm", "offsets.tool.x_mm"]) == pytest.approx([5e-5, 5e-5])
    assert prior.sd_of(["compliance.joint2.k_rad_per_Nm"]) == pytest.approx([1e-3])
    assert prior.sd_of(["offsets.base.x_mm", "offsets.base.alpha_rad"]) == pytest.approx([0.05, 0.2])
    data = measured(11, 60)
    assert fit_model(model, data, "identifiable", SQUARED).fit.sigma > 2 * NOISE  # a printed arm is not like that
    assert fit_model(nominal_model(lab), data, "identifiable", SQUARED).fit.stated.name == TYPICAL  # type: ignore[union-attr]


def test_options_of_the_thesis_are_least_squares(lab: Arm) -> None:
    found = fit_model(nominal_model(lab), measured(2, 60), "option1", SQUARED).fit
    assert found.stated is None
