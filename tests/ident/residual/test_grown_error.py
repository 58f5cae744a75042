"""Since when an error is larger than before, by cumulative sums of squares."""

from __future__ import annotations

import numpy as np
import pytest

from lrm_ident.data.error_stats import error_stats
from lrm_ident.fitting.held_out import HeldOutBlock
from lrm_ident.residual.deployment.deployed_error import DeployedError
from lrm_ident.residual.deployment.forecast_error import ForecastError
from lrm_ident.residual.deployment.grown_error import row_since_error_grew
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.kinematics.poses import Poses
from lrm_math.model.model import model_of

MM = 1e-3


def poses_of(q: Array, numbered: bool = True) -> Poses:
    return Poses(q, np.zeros(len(q)), number=np.arange(1, len(q) + 1) if numbered else None)


def errors(rng: np.random.Generator, *parts: tuple[int, float]) -> Array:
    """(N, 3), m, Gaussian errors of so many poses with so large a standard deviation, part after part."""
    return np.vstack([size * rng.normal(size=(count, 3)) for count, size in parts])


def since(rng: np.random.Generator, residual: Array, numbered: bool = True) -> int:
    q = rng.uniform(-1.0, 1.0, (len(residual), 4))
    return row_since_error_grew(poses_of(q, numbered), (residual**2).sum(axis=1))


@pytest.mark.parametrize("moment", [60, 150, 230])
def test_an_error_that_grows_is_found_near_its_moment(moment: int) -> None:
    rng = np.random.default_rng(moment)
    assert since(rng, errors(rng, (moment, 0.5 * MM), (300 - moment, 1.0 * MM))) == pytest.approx(moment, abs=12)


def test_an_error_that_shrinks_or_is_in_no_known_order_has_no_moment() -> None:
    rng = np.random.default_rng(0)
    assert since(rng, errors(rng, (150, 1.0 * MM), (150, 0.5 * MM))) == 0
    assert since(rng, errors(rng, (150, 0.5 * MM), (150, 1.0 * MM)), numbered=False) == 0


def test_an_error_that_grows_with_a_joint_in_order_is_the_joints() -> None:
    q = np.column_stack([np.linspace(-1.0, 1.0, 200), np.random.default_rng(1).uniform(-1.0, 1.0, 200)])
    residual = errors(np.random.default_rng(2), (100, 0.5 * MM), (100, 1.0 * MM))
    assert row_since_error_grew(poses_of(q), (residual**2).sum(axis=1)) == 0


def test_repeated_poses_of_equal_error_are_no_growth() -> None:
    """Each pose was measured five times: its error, no noise alone, comes five times in a row."""
    found = 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        found += since(rng, np.repeat(errors(rng, (60, 1.0 * MM)), 5, axis=0)) > 0
    assert found <= 6


def test_what_came_loose_is_stated_as_deployed(lab: Arm) -> None:
    """The error since then is what the arm has from now on; that before it is stated beside it."""
    rng = np.random.default_rng(3)
    poses = poses_of(rng.uniform(-1.0, 1.0, (200, lab.dof)))
    residual, rows = errors(rng, (100, 0.5 * MM), (100, 1.5 * MM)), np.arange(200)
    first = row_since_error_grew(poses, (residual**2).sum(axis=1))
    block = HeldOutBlock(rows[:0], rows, residual[:0], residual)
    deployed = DeployedError.of(model_of(lab, ()), poses, [block], ForecastError())
    assert first == pytest.approx(100, abs=10)
    assert (deployed.now, deployed.otherwise) == (error_stats(residual[first:]), error_stats(residual[:first]))
