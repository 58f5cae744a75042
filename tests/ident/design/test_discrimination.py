"""Power of tests between rivals, against a mixture of noncentral chi-squared distributions; sets that hardly tell."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from lrm_ident.design.detmax import _climb, maximise_criterion
from lrm_ident.design.discrimination import TARGET_POWER, TEST_LEVEL, discrimination_of
from lrm_ident.design.optimality import criterion_of
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import effects_at
from tests.support.commands import stdout_of

QUANTILES = (np.arange(4000) + 0.5) / 4000


def power_by_mixture(noncentrality: float, size: int, freedom: int) -> float:
    """F = (χ'²/size)/(χ²/freedom): the power given the denominator, averaged over that."""
    critical, rest = stats.f.ppf(1.0 - TEST_LEVEL, size, freedom), stats.chi2.ppf(QUANTILES, freedom)
    return float(stats.ncx2.sf(critical * size * rest / freedom, size, noncentrality).mean())


@pytest.mark.long
@given(st.integers(1, 60), st.floats(-2.0, 5.0))
def test_the_power_is_that_of_the_noncentral_f_distribution(freedom: int, log_strength: float) -> None:
    rows = freedom + 2
    fitted, own = np.eye(rows)[:, :1], np.eye(rows)[:, 1:2] * 10.0**log_strength
    [effect] = effects_at(load_arm("two-joint"), "hysteresis@joint1")
    [rival] = discrimination_of([effect], fitted, [own], noise=1.0).rivals
    assert rival.power == pytest.approx(power_by_mixture(100.0**log_strength, 1, freedom), abs=2e-3)
    assert rival.detectable_size is not None
    enough = rival.detectable_size**2 * 100.0**log_strength
    assert power_by_mixture(enough, 1, freedom) == pytest.approx(TARGET_POWER, abs=2e-3)


@pytest.mark.long
@given(st.integers(0, 10_000), st.floats(-6.0, -3.0))
def test_an_exchange_among_nearly_dependent_columns_ends(seed: int, log_apart: float) -> None:
    rng = np.random.default_rng(seed)
    J = rng.normal(size=(25, 3, 3))
    J[:, :, 2] = J[:, :, 0] - J[:, :, 1] + 10.0**log_apart * J[:, :, 2]
    criterion = criterion_of(J, "O1", np.zeros((3, 3)))
    found = maximise_criterion(criterion, 4, starts=3, seed=seed)
    assert found.score == criterion.evaluate(found.rows).score
    starts = [rng.choice(len(J), 4, replace=False) for _ in range(3)]
    assert all(_climb(criterion, rows).score >= criterion.evaluate(rows).score for rows in starts)


@pytest.mark.long
@pytest.mark.parametrize("parameters", ["compliance.*", "offsets.joint?.theta_rad"])
def test_few_poses_for_a_rival_on_a_small_arm(parameters: str) -> None:
    few = ["--levels", 5, "-n", 6, "--repeats", 0, "--separate", "hysteresis@joint1", "--parameters", parameters]
    said = stdout_of("design", "two-joint", *few, "--all")
    (row,) = (line for line in said.splitlines() if line.startswith("hysteresis@joint1"))
    assert "±" in row or "never" in row
