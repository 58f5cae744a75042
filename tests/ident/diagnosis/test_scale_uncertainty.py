"""A tracker's scale along all axes together is the arm's lengths: the verdict says so, until a length is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lrm_ident.data.measurements import Measurements
from lrm_ident.diagnosis.add_effect import add_effects
from lrm_ident.fitting.identifiability import fit_identifiable
from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_ident.residual.scale_uncertainty import scale_caveat, scale_uncertainty
from lrm_math.arm.arm import Arm
from lrm_math.effects import effects_at
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of

FRAME, SCALE = "measurement_frame@frame", 0.004
SD = 1e-4
STRING_AT = np.array([0.35, 0.0, 0.05])
"""m."""


def measured(arm: Arm, distances: int) -> Measurements:
    """A nominal arm, seen by a tracker that stretches z; the first so many poses also by a string."""
    rng, count = np.random.default_rng(1), 80
    poses = poses_of(rng.uniform(-1.4, 1.4, (count, arm.dof)))
    true = solve_equilibrium(model_of(arm, ()), poses).tcp
    tcp = true + SCALE * (true - true.mean(axis=0)) * [0.0, 0.0, 1.0] + SD * rng.normal(size=true.shape)
    number = np.arange(1, count + 1)
    data = Measurements(poses, number, tcp, None, SD, number, Path("frame.csv"), "", arm=arm)
    if not distances:
        return data
    far = np.linalg.norm(true - STRING_AT, axis=1) + SD * rng.normal(size=count)
    far[distances:] = np.nan
    sd, covariance = np.full(count, SD), np.full((count, 6, 6), np.nan)
    covariance[:, :3, :3] = SD**2 * np.eye(3)
    return replace(
        data, sd=sd, noise_sd=None, covariance=covariance, distance=far, distance_sd=sd, distance_from=STRING_AT
    )


def fitted(arm: Arm, data: Measurements) -> Fit:
    plain = model_of(arm, [effect for name in ("offsets", "compliance") for effect in effects_at(arm, name)])
    before = fit_identifiable(plain, data, plain.keys).fit.model
    return add_effects(before, data, effects_at(arm, FRAME))


def test_poses_alone_leave_the_scale_open_and_its_error_is_within_two_standard_errors(lab: Arm) -> None:
    fit = fitted(lab, measured(lab, 0))
    found = scale_uncertainty(fit)
    assert found is not None
    common = np.mean([fit.model.value(f"measurement_frame.frame.scale_{axis}_mm_per_m") for axis in "xyz"])
    assert abs(common - SCALE / 3.0) < 2.0 * found.sd
    assert found.sd > 5e-4
    assert "distance_mm" in found.sentence
    assert scale_caveat("measurement_frame@frame", fit) == found.sentence
    assert not scale_caveat("frame_curve@frame", fit)  # said at the step that brought it, not again


def test_a_known_length_decides_it(lab: Arm) -> None:
    fit, alone = fitted(lab, measured(lab, 40)), scale_uncertainty(fitted(lab, measured(lab, 0)))
    found = scale_uncertainty(fit)
    assert alone is not None
    assert found is None or found.sd < 0.5 * alone.sd
    values = [fit.model.value(f"measurement_frame.frame.scale_{axis}_mm_per_m") for axis in "xyz"]
    assert values == pytest.approx([0.0, 0.0, SCALE], abs=1e-3)


def test_a_model_without_a_distorted_tracker_has_no_such_scale(lab: Arm) -> None:
    data = measured(lab, 0)
    plain = model_of(lab, effects_at(lab, "offsets"))
    assert scale_uncertainty(fit_identifiable(plain, data, plain.keys).fit) is None


def test_depth_alone_tells_the_lengths_and_the_verdict_says_what_that_supposes(lab: Arm) -> None:
    data = measured(lab, 0)
    plain = model_of(lab, [effect for name in ("offsets", "compliance") for effect in effects_at(lab, name)])
    before = fit_identifiable(plain, data, plain.keys).fit.model
    fit = add_effects(before, data, effects_at(lab, "depth_scale@frame"), (0.0, 0.0, np.pi / 2))
    along = np.sin(fit.model.value("depth_scale.frame.elevation_rad"))
    assert abs(along) > 0.95
    assert fit.model.value("depth_scale.frame.scale_mm_per_m") == pytest.approx(SCALE, abs=1e-3)
    assert "right across that direction" in scale_caveat("depth_scale@frame", fit)
