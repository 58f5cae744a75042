"""Covariance of a fit whose residuals are alike within a move."""

from __future__ import annotations

import numpy as np
import pytest

from lrm_ident.measuring.motion.joint_fit import _clustered


@pytest.mark.parametrize("scale", [1.0, 1e-5])
def test_a_parameter_that_one_move_fits_exactly_has_the_error_of_white_noise(scale: float) -> None:
    rng, count = np.random.default_rng(0), np.full(8, 20)
    J, residual = rng.normal(size=(160, 2)), rng.normal(size=160)
    J[20:, 1] = 0.0
    J[:20, 0], residual[:20] = 0.0, 0.0
    J[:, 1] *= scale
    found = _clustered(J, residual, count)
    white = residual @ residual / 158 * np.linalg.inv(J.T @ J)
    assert np.isfinite(found).all()
    assert (np.diag(found) >= 0.999 * np.diag(white)).all()
