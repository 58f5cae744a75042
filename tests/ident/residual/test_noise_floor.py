"""What a held-out error is without the noise: bounds that hold as often as they say."""

from __future__ import annotations

import numpy as np
import pytest

from lrm_ident.residual.noise_floor import NoiseFloor

SD, POSES, WORLDS = 3e-4, 80, 4000


@pytest.mark.parametrize("own", [0.0, 1e-4, 4e-4, 2e-3])
def test_each_bound_of_the_error_without_noise_holds_in_95_percent(own: float) -> None:
    """Normal errors: an arm's own of so many m per axis beside the noise."""
    rng = np.random.default_rng(7)
    squares = (SD**2 + own**2) * rng.chisquare(3 * POSES, WORLDS) / POSES
    floor = NoiseFloor(SD, "metadata")
    bounds = np.array([floor.error_without(float(np.sqrt(one)), POSES) for one in squares])
    truth = np.sqrt(3.0) * own
    low, high = np.mean(bounds[:, 0] <= truth), np.mean(bounds[:, 1] >= truth)
    assert low == pytest.approx(0.95, abs=0.012)
    assert high == pytest.approx(0.95 if own else 1.0, abs=0.012)


def test_a_noise_by_repeated_poses_widens_the_bounds() -> None:
    stated, repeated = NoiseFloor(SD, "metadata"), NoiseFloor(SD, "replicates", degrees_of_freedom=15.0)
    exact, wide = (floor.error_without(1e-3, POSES) for floor in (stated, repeated))
    assert wide[0] < exact[0] < 1e-3 < exact[1] + SD * np.sqrt(3.0)
    assert wide[1] > exact[1]


def test_without_a_known_noise_nothing_is_said() -> None:
    assert NoiseFloor(None, "unknown").error_without(1e-3, POSES) is None
