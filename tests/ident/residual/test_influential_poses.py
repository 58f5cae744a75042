"""Poses that alone determine the model where they are."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.report.text.poses import influential_poses_sentence
from lrm_ident.residual.influential_poses import influential_poses
from lrm_math.arrays import Array

POSES = 120
FAR = np.array([7.9e-3, 0.0, 0.0])


def noise(seed: int) -> Array:
    return np.random.default_rng(seed).normal(0.0, 3e-4, (POSES, 3))


def test_a_pose_that_only_the_fit_describes_is_influential() -> None:
    """Before: *the model lacks some effect* stood where one pose of 120 decided, and another command saw nothing."""
    residual, held_out = noise(1), noise(1)
    held_out[25] += FAR
    found = influential_poses(residual, held_out)
    assert found is not None
    assert found.rows == (25,)
    assert found.others == pytest.approx(np.sqrt(3.0) * 3e-4, rel=0.1)
    words = influential_poses_sentence(found, np.arange(1, POSES + 1))
    assert "pose 26 (8." in words
    assert "0.47 mm RMS" in words


def test_a_wrong_measurement_is_none() -> None:
    """It is far off in the fit, too: an outlier, which is said elsewhere."""
    residual = noise(2)
    residual[25] += FAR
    assert influential_poses(residual, residual) is None


@given(seed=st.integers(0, 1000), scale=st.floats(1e-6, 1e3))
def test_noise_has_no_influential_pose_in_any_unit(seed: int, scale: float) -> None:
    assert influential_poses(scale * noise(seed), 1.1 * scale * noise(seed)) is None


@given(seed=st.integers(0, 1000))
def test_they_follow_the_order_of_the_rows(seed: int) -> None:
    residual, held_out = noise(seed), noise(seed)
    held_out[[3, 70]] += [FAR, 2.0 * FAR]
    order = np.random.default_rng(seed).permutation(POSES)
    found = influential_poses(residual[order], held_out[order])
    assert found is not None
    assert [int(order[row]) for row in found.rows] == [70, 3]
