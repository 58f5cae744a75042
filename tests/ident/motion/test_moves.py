"""Loads of a move are straight between its frames: held for a frame they would lag by half of one."""

from __future__ import annotations

import numpy as np

from lrm_ident.measuring.motion.moves import between


def test_a_load_that_grows_evenly_is_that_of_the_middle_of_each_step() -> None:
    t = np.arange(6) / 30.0
    values = np.stack([2.0 * t, 1.0 - t])
    found = between(values, 4)
    middle = (np.arange(20) + 0.5) / 120.0
    np.testing.assert_allclose(found, np.stack([2.0 * middle, 1.0 - middle], axis=1), atol=1e-12)
