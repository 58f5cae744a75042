"""Predictable residual: Gaussian process, error in held-out blocks, regimes, and where a verdict holds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.source import Source
from lrm_ident.fitting.cross_validation import cross_validated_residual, joint_space_folds
from lrm_ident.report.text.poses import where_measured
from lrm_ident.report.text.residuals import regime_sentence
from lrm_ident.residual.covariates import ExplanatoryVariable
from lrm_ident.residual.data_audit import where_it_holds
from lrm_ident.residual.error_breakdown import compare
from lrm_ident.residual.gaussian_process import FactoredKernel, Kernel, condition, fit_kernel, log_marginal_likelihood
from lrm_ident.residual.predictability import (
    HeldOutBlock,
    PredictableError,
    held_out_residual,
    pose_covariates,
    predictable_error,
)
from lrm_ident.residual.regime import find_regimes, kuiper_interval, studentised_squares
from lrm_ident.residual.thresholds import FEW_LEVELS
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from tests.support.sweep import examples

NOISE = 0.3e-3


def poses_of(seed: int, count: int = 240) -> Measurements:
    """Random joint angles and two loads; the residual is given apart, so that the TCP is zero."""
    rng = np.random.default_rng(seed)
    number = np.arange(count)
    time = np.linspace(0.0, 15.0 * count, count)
    poses = Poses(rng.uniform(-1.7, 1.7, (count, 4)), rng.choice([0.0, 0.07], count), t=time)
    return Measurements.of_tcp(poses, np.zeros((count, 3)), pose=number)


def blocks_of(data: Measurements, residual: Array) -> list[HeldOutBlock]:
    """The joint-space blocks, with a residual that no fit has changed."""
    fold = joint_space_folds(data.poses.q, data.repeat_of)
    parts = [(np.flatnonzero(fold != k), np.flatnonzero(fold == k)) for k in range(10)]
    return [HeldOutBlock(train, test, residual[train], residual[test]) for train, test in parts]


def predicted(seed: int, signal: Array | float) -> PredictableError:
    data = poses_of(seed)
    noise = np.random.default_rng(seed + 1000).normal(size=(len(data), 3)) * NOISE
    residual = noise + signal
    return predictable_error(data.with_tcp(reach(data) + residual), blocks_of(data, residual))


def reach(data: Measurements) -> Array:
    """Positions (m) of an arm in a plane that turns, which the model predicts exactly."""
    q = data.poses.q
    out, up = 0.2 * np.cos(q[:, 1]) + 0.15 * np.cos(q[:, 1] + q[:, 2]), 0.2 * np.sin(q[:, 1])
    return np.stack([out * np.cos(q[:, 0]), out * np.sin(q[:, 0]), up], axis=1)


@examples(2, 5)
@given(st.integers(0, 2**16))
def test_no_block_learns_from_another(seed: int) -> None:
    """The kernel of a block must not come from one that saw its poses: their order changes nothing."""
    data = poses_of(seed, 60)
    residual = np.random.default_rng(seed + 1).normal(size=(60, 3)) * NOISE
    data, blocks = data.with_tcp(reach(data) + residual), blocks_of(data, residual)
    np.testing.assert_array_equal(predictable_error(data, blocks).after, predictable_error(data, blocks[::-1]).after)


@examples(10, 20)
@given(st.integers(0, 2**32 - 1), st.integers(1, 5))
def test_gradient_of_the_marginal_likelihood(seed: int, inputs: int) -> None:
    rng = np.random.default_rng(seed)
    x, y = rng.normal(size=(12, inputs)), rng.normal(size=12)
    log = rng.uniform(-0.7, 0.7, inputs + 2)
    gradient = log_marginal_likelihood(Kernel.of_log(log), x, y).gradient
    for i, step in enumerate(1e-6 * np.eye(inputs + 2)):
        sides = [log_marginal_likelihood(Kernel.of_log(log + sign * step), x, y).value for sign in (1, -1)]
        assert (sides[0] - sides[1]) / 2e-6 == pytest.approx(gradient[i], rel=1e-4, abs=1e-5)


@examples(10, 20)
@given(st.integers(0, 2**32 - 1), st.integers(1, 5))
def test_average_information_of_the_marginal_likelihood(seed: int, inputs: int) -> None:
    """Oracle: ½ yᵀ K⁻¹ ∂K K⁻¹ ∂K K⁻¹ y by plain inversion, ∂K by central differences."""
    rng = np.random.default_rng(seed)
    x, y = rng.normal(size=(12, inputs)), rng.normal(size=12)
    log = rng.uniform(-0.7, 0.7, inputs + 2)

    def output_covariance(values: Array) -> Array:
        kernel = Kernel.of_log(values)
        return np.asarray(kernel.covariance(x, x) + kernel.noise**2 * np.eye(12))

    inverse = np.linalg.inv(output_covariance(log))
    sides = [(output_covariance(log + step), output_covariance(log - step)) for step in 1e-6 * np.eye(inputs + 2)]
    moved = np.stack([(above - below) / 2e-6 @ inverse @ y for above, below in sides])
    found = log_marginal_likelihood(Kernel.of_log(log), x, y).information
    np.testing.assert_allclose(found, 0.5 * moved @ inverse @ moved.T, rtol=1e-4, atol=1e-6)


@examples(10, 20)
@given(st.integers(0, 2**32 - 1))
def test_a_search_never_makes_a_kernel_less_likely(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(40, 3))
    y = np.sin(rng.normal(size=3) @ x.T) + rng.uniform(0.05, 1.0) * rng.normal(size=40)
    start = Kernel(np.exp(rng.uniform(-1.0, 1.0, 3)), 1.0, 0.5)
    found = fit_kernel(FactoredKernel.of(start, x), y)
    assert log_marginal_likelihood(found, x, y).value >= log_marginal_likelihood(start, x, y).value


@examples(10, 20)
@given(st.integers(0, 2**32 - 1))
def test_conditioning_is_that_of_a_joint_normal_distribution(seed: int) -> None:
    """Oracle: mean and covariance of a partitioned normal vector, by plain inversion."""
    rng = np.random.default_rng(seed)
    x, new, y = rng.normal(size=(9, 2)), rng.normal(size=(4, 2)), rng.normal(size=9)
    kernel = Kernel(rng.uniform(0.5, 2.0, 2), 1.3, 0.4)

    def covariance(a: Array, b: Array) -> Array:
        apart = (a[:, None] - b[None]) / kernel.lengths
        return np.asarray(kernel.signal**2 * np.exp(-0.5 * (apart**2).sum(axis=2)))

    inverse = np.linalg.inv(covariance(x, x) + kernel.noise**2 * np.eye(9))
    process = condition(kernel, x, y)
    np.testing.assert_allclose(process.mean(new), covariance(new, x) @ inverse @ y, rtol=1e-8, atol=1e-10)
    variance = np.diag(covariance(new, new) - covariance(new, x) @ inverse @ covariance(x, new))
    np.testing.assert_allclose(process.sd(new), np.sqrt(variance), rtol=1e-6, atol=1e-7)


def test_a_search_finds_the_input_that_matters_and_the_noise() -> None:
    rng = np.random.default_rng(4)
    x = rng.uniform(-1.7, 1.7, (200, 3))
    y = np.sin(2.0 * x[:, 1]) + 0.2 * rng.normal(size=200)
    kernel = fit_kernel(FactoredKernel.of(Kernel.start(3), x), y)
    assert kernel.noise == pytest.approx(0.2, rel=0.2)
    assert kernel.lengths[1] < 0.3 * min(kernel.lengths[0], kernel.lengths[2])


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_nothing_can_be_predicted_of_noise(seed: int) -> None:
    found = predicted(seed, 0.0)
    assert not found.more_to_find
    assert found.error.rms == pytest.approx(NOISE * np.sqrt(3.0), rel=0.1)


@pytest.mark.long
def test_an_unknown_law_is_predicted_down_to_the_noise_and_its_inputs_are_named() -> None:
    q = poses_of(3).poses.q
    law = 0.01 * np.sin(q[:, 0] + q[:, 3])[:, None] * np.array([0.5, -0.3, 1.0])
    found = predicted(3, law)
    assert found.more_to_find
    assert {*found.follows[:2]} == {ExplanatoryVariable("angle", 0), ExplanatoryVariable("angle", 3)}
    assert NOISE * np.sqrt(3.0) * 0.9 < found.noise_bound < 2.0 * NOISE * np.sqrt(3.0) < error_stats(found.before).rms


@pytest.mark.long
def test_a_law_of_the_position_is_predicted_better_than_by_angles_and_is_named() -> None:
    """A law that angles tell only through the kinematics: a lens, a floor, a field in the tracker's room."""
    position = reach(poses_of(3))
    found = predicted(3, 0.002 * np.sin(20.0 * position[:, :1]) * np.array([0.3, 1.0, 0.0]))
    assert found.more_to_find
    assert found.follows[0] == ExplanatoryVariable("x")
    assert found.error.rms < 1.2 * NOISE * np.sqrt(3.0)


@pytest.mark.long
@examples(2, 5)
@given(st.integers(0, 10_000), st.integers(0, 3))
def test_a_law_of_the_direction_of_approach_is_predicted_and_is_named(seed: int, joint: int) -> None:
    data = poses_of(seed)
    side = np.random.default_rng(seed + 2).choice([-1.0, 1.0], data.poses.q.shape)
    data = replace(data, poses=replace(data.poses, direction=side)).with_tcp(reach(data))
    turned = np.cos(data.poses.q[:, :1] + [0.0, 1.0, 2.0])  # where the joint's play moves the TCP
    noise = np.random.default_rng(seed + 1000).normal(size=(len(data), 3)) * NOISE
    residual = noise + 0.001 * side[:, joint, None] * turned
    found = predictable_error(data.with_tcp(data.tcp + residual), blocks_of(data, residual))
    assert found.more_to_find
    assert ExplanatoryVariable("direction", joint) in found.follows[:2]
    assert found.error.rms < 1.3 * NOISE * np.sqrt(3.0)


def test_inputs_that_do_not_vary_or_repeat_another_are_left_out() -> None:
    data = poses_of(0)
    symbols = [one.symbol for one in pose_covariates(data, data.tcp)]
    assert symbols == ["q1", "q2", "q3", "q4", "order", "load"]
    np.testing.assert_allclose([values.std() for values in pose_covariates(data, data.tcp).values()], 1.0)


def test_an_error_in_a_part_of_joint_space_is_found_there() -> None:
    data = poses_of(5, 300)
    residual = np.random.default_rng(1).normal(size=(300, 3)) * NOISE
    stuck = data.poses.q[:, 1] < np.radians(-50.0)
    residual[stuck] *= 3.0
    (found, *others) = find_regimes(data, (residual**2).sum(axis=1))
    assert not others
    assert found.quantity.variable == ExplanatoryVariable("angle", 1)
    assert found.low is None
    assert found.high == pytest.approx(-50.0, abs=15.0)
    assert found.inside > 2.0 * found.outside
    assert f"; {100 * found.share:.0f} % of the squared error lies there. " in regime_sentence(found)


@pytest.mark.slow
def test_no_regime_in_noise() -> None:
    """24 data sets; by the false discovery rate of one in a hundred not one is expected."""
    for seed in range(24):
        data = poses_of(seed, 120)
        noise = np.random.default_rng(seed + 7).normal(size=(120, 3))
        assert find_regimes(data, (noise**2).sum(axis=1)) == ()


@pytest.mark.long
@given(st.integers(0, 2**32 - 1))
@examples(5, 10)
def test_studentised_squares_of_noise_do_not_depend_on_leverage(seed: int) -> None:
    rng = np.random.default_rng(seed)
    columns = rng.normal(size=(90, 6)) * np.linspace(0.1, 3.0, 90)[:, None]
    noise = rng.normal(size=(90, 4000))
    fitted, *_ = np.linalg.lstsq(columns, noise, rcond=None)
    left = (noise - columns @ fitted).T.reshape(4000, 30, 3)
    mean = np.mean([studentised_squares(one, columns) for one in left[:400]], axis=0)
    np.testing.assert_allclose(mean, 3.0, rtol=0.35)


def test_compare_says_what_a_nameless_model_could_predict(lab: Arm) -> None:
    data, rng = poses_of(9, 60), np.random.default_rng(0)
    q = rng.uniform(-1.5, 1.5, (60, 6))
    model = model_of(lab, effects_at(lab, "offsets@base"))
    poses = Poses(q, np.zeros(60))
    tcp = solve_equilibrium(model, poses).tcp + 0.005 * np.sin(q[:, [1]]) + NOISE * rng.normal(size=(60, 3))
    data = Measurements.of_tcp(poses, tcp, pose=data.pose, source=Source(data.source.path))
    found = compare(model, data)
    np.testing.assert_allclose(found.predictable.before, cross_validated_residual(model, data))
    np.testing.assert_allclose(held_out_residual(found.held_out.blocks), found.predictable.before)
    assert found.predictable.more_to_find
    assert found.predictable.follows[0] == ExplanatoryVariable("angle", 1)


@pytest.mark.parametrize("levels", [None, 7])
@pytest.mark.parametrize(("few", "count"), [(4, 60), (12, 200), (40, 300)])
def test_p_values_of_random_poses_are_honest(few: int, count: int, levels: int | None) -> None:
    rng, p_values = np.random.default_rng(few), []
    for _ in range(400):
        values = rng.normal(size=count) if levels is None else rng.integers(levels, size=count).astype(float)
        p_values.append(kuiper_interval(values, rng.permutation(count) < few)[0])
    for level in (0.2, 0.05, 0.01):
        assert np.mean(np.array(p_values) < level) < level + 3 * np.sqrt(level / 400)


@given(count=st.integers(30, 200), few=st.integers(8, 14), start=st.floats(0, 1), seed=st.integers(0, 99))
@examples(25, 50)
def test_an_interval_of_chosen_poses_is_found_whatever_the_scale(count: int, few: int, start: float, seed: int) -> None:
    values = np.random.default_rng(seed).permutation(count) * 1.0
    first = int(start * (count - few))
    chosen = (values >= first) & (values < first + few)
    p_value, inside = kuiper_interval(values, chosen)
    assert p_value < 1e-3
    assert np.array_equal(inside, chosen)
    scaled_p_value, same = kuiper_interval(np.exp(values / count), chosen)
    assert scaled_p_value == p_value
    assert np.array_equal(same, inside)


LOWER, UPPER = np.radians([-90.0, -90.0, -90.0]), np.radians([90.0, 90.0, 90.0])


def test_few_levels_and_half_a_range_are_named() -> None:
    """Three angles of joint 1, the upper half of joint 2, all of joint 3."""
    rng = np.random.default_rng(0)
    q = np.radians(
        np.column_stack([rng.choice([-40.0, 0.0, 40.0], 90), rng.uniform(0, 90, 90), rng.uniform(-90, 90, 90)])
    )
    few, half = where_it_holds(q, LOWER, UPPER)
    assert (few.joint, few.levels) == (1, (-40.0, 0.0, 40.0))
    assert (half.joint, half.levels) == (2, ())
    assert (half.least, half.most) == pytest.approx((0.0, 90.0), abs=5.0)
    words = f"only where it was measured: joint 1 at -40, 0, 40 deg only; joint 2 from {half.least:.0f} to "
    assert where_measured((few, half)) == f"{words}{half.most:.0f} deg"


@given(st.integers(0, 2**31), st.integers(FEW_LEVELS + 1, 40))
def test_nothing_is_said_of_a_range_that_was_covered(seed: int, levels: int) -> None:
    """Many levels over the whole range of every joint."""
    angles = np.linspace(-90.0, 90.0, levels)
    order = np.random.default_rng(seed)
    q = np.radians(np.column_stack([order.permutation(angles) for _ in range(3)]))
    assert where_it_holds(q, LOWER, UPPER) == ()
