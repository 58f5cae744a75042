"""Arms with parallel axes, and targets near the last axis: which parameters there are, and which are kept."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.source import Source
from lrm_ident.fitting.cross_validation import cross_validated_residual
from lrm_ident.fitting.identifiability import fit_identifiable
from lrm_ident.fitting.loss import SQUARED
from lrm_ident.fitting.model_fit import fit_model, nominal_model
from lrm_math.arm.arm import Arm, Body, Joint, Placement
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from tests.conftest import SHARED
from tests.support.link_matrices import link_matrices, turn
from tests.support.sweep import examples

UR5_DATA = SHARED / "data" / "ur5"
NOISE = 2e-4  # m per axis


def independent_tcp(arm: Arm, q: Array, turned: dict[int, Array]) -> Array:
    """(N, 3), TCP (m) of the rigid arm by products of matrices, with further motions after some links."""
    return np.array([link_matrices(arm, angles, turned)[-1][:3, 3] for angles in q])


def measured(arm: Arm, q: Array, tcp: Array) -> Measurements:
    number = np.arange(len(q))
    return Measurements.of_tcp(poses_of(q), tcp, NOISE, pose=number, source=Source(arm=arm))


def test_beta_is_there_where_axes_are_parallel_and_nowhere_else() -> None:
    def betas(name: str) -> list[str]:
        return [key for key in nominal_model(load_arm(name)).keys if key.startswith("offsets.joint") and "beta" in key]

    assert betas("ur5") == betas("so101") == ["offsets.joint2.beta_rad", "offsets.joint3.beta_rad"]
    assert betas("lrm-lab") == betas("lrm-rover") == betas("two-joint") == []
    assert sum(key.startswith("offsets") for key in nominal_model(load_arm("lrm-lab")).keys) == 38  # Table 4.3


@pytest.mark.long
@pytest.mark.parametrize("axis", [0, 1])
def test_a_twisted_parallel_axis_is_fitted_to_the_floor(axis: int) -> None:
    arm, rng = load_arm("so101"), np.random.default_rng(1)
    q = rng.uniform(-1.5, 1.5, (150, 5))
    tcp = independent_tcp(arm, q, {1: turn(axis, math.radians(2.0))}) + rng.normal(0, NOISE, (150, 3))
    data = measured(arm, q, tcp)
    result = fit_model(nominal_model(arm), data, "identifiable", SQUARED).fit
    assert result.sigma < 1.1 * NOISE
    assert error_stats(cross_validated_residual(result.model, data)).rms < 1.25 * math.sqrt(3) * NOISE


def wrist_arm(target: float) -> Arm:
    """Six joints of an industrial arm's shape; the target stands so far from the last axis (m), nothing has mass."""
    half = math.pi / 2
    rows = [(0, 0.29, 0, -half), (-half, 0, 0.27, 0), (0, 0, 0.07, -half)]
    rows += [(0, 0.302, 0, half), (0, 0, 0, -half), (0, 0.072, 0, 0)]
    links = tuple(Joint(theta, d, a, alpha, None, -2.0, 2.0) for theta, d, a, alpha in rows)
    return Arm("wrist", (0.0, 0.0, -9.81), Placement(), links, Placement(x=target, z=0.05), ())


@pytest.mark.slow
@examples(3, 6)
@given(st.floats(0.0, 0.02), st.integers(0, 99))
def test_a_target_near_the_last_axis_is_fitted_to_the_noise(distance: float, seed: int) -> None:
    drawn, rng = wrist_arm(distance), np.random.default_rng(seed)
    x, y, z = rng.normal(0, 0.003, 3).tolist()
    q = rng.uniform(-1.6, 1.6, (80, 6))
    true = replace(drawn, tool=Placement(x=distance + x, y=y, z=0.05 + z))
    turned = {i: turn(0, rng.normal(0, 0.01)) @ turn(2, rng.normal(0, 0.01)) for i in range(5)}
    data = measured(drawn, q, independent_tcp(true, q, turned) + rng.normal(0, NOISE, (80, 3)))
    result = fit_model(nominal_model(drawn), data, "identifiable", SQUARED).fit
    assert result.sigma < 1.3 * NOISE


@pytest.mark.slow
def test_where_least_squares_stall_typical_sizes_help() -> None:
    drawn, rng = wrist_arm(0.0005), np.random.default_rng(0)
    q = rng.uniform(-1.6, 1.6, (80, 6))
    true = replace(drawn, tool=Placement(x=0.003, y=-0.002, z=0.052))
    data = measured(drawn, q, independent_tcp(true, q, {}) + rng.normal(0, NOISE, (80, 3)))
    heavy = replace(drawn, bodies=tuple(Body(f"link {i}", 4.0 / i, (0.01, 0.05, 0.02), i, i) for i in range(1, 7)))
    model = nominal_model(heavy)
    found = fit_identifiable(model, data, model.keys).fit  # many of them dependent
    assert error_stats(found.residual).rms < 1.2 * math.sqrt(3) * NOISE


@pytest.mark.slow
@pytest.mark.skipif(not UR5_DATA.is_dir(), reason="the shared measurements are not here")
def test_real_ur5_to_a_tenth_of_a_millimetre() -> None:
    arm = load_arm("ur5")
    grid, apart = (load_measurements(UR5_DATA / f"{name}.csv", arm) for name in ("grid", "independent"))
    model = fit_model(nominal_model(arm), grid, "identifiable", SQUARED).fit.model
    assert error_stats(cross_validated_residual(model, grid)).mean < 1.05e-4
    assert error_stats(apart.tcp - solve_equilibrium(model, apart.poses).tcp).mean < 1e-4
