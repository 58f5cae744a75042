"""What an error is beyond the noise, and beyond the rounding of commanded angles."""

from __future__ import annotations

import numpy as np
import pytest

from lrm_ident.residual.noise_floor import NoiseFloor
from lrm_ident.residual.rounded_commands import RoundedCommands, rounded_commands
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.derivatives import joint_jacobian
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of

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


NOISE = 2e-4


def angles(step_deg: float) -> tuple[Array, Array]:
    """(N, n), rad: what the servos got, and what was written."""
    sent = np.random.default_rng(4).uniform(-0.8, 0.8, (200, 6))
    return sent, np.radians(step_deg * np.round(np.degrees(sent) / step_deg))


def found(written: Array) -> tuple[RoundedCommands | None, Array]:
    settled = solve_equilibrium(model_of(load_arm("lrm-lab"), ()), poses_of(written))
    return rounded_commands(written, joint_jacobian(settled).transpose(2, 1, 0)), settled.tcp


@pytest.mark.parametrize("step_deg", [0.5, 1.0])
def test_the_error_of_rounding_is_that_of_the_finer_angles(step_deg: float) -> None:
    sent, written = angles(step_deg)
    rounded, tcp = found(written)
    true = solve_equilibrium(model_of(load_arm("lrm-lab"), ()), poses_of(sent)).tcp
    error = float(np.sqrt(((true - tcp) ** 2).sum(axis=1).mean()))
    assert np.degrees(rounded.step) == pytest.approx(step_deg)
    assert rounded.tip == pytest.approx(error, rel=0.1)
    assert rounded.explains(np.hypot(error, NOISE), NOISE)


def test_whole_degrees_that_were_commanded_raise_no_doubt() -> None:
    """The error is then the noise; and one that is far larger has another cause."""
    rounded, _ = found(angles(1.0)[1])
    assert not rounded.explains(1.1 * NOISE, NOISE)
    assert not rounded.explains(5.0 * rounded.tip, NOISE)


def test_finer_angles_explain_nothing() -> None:
    rounded, _ = found(angles(1.0)[0])
    assert rounded is None or not rounded.explains(2.5e-3, 0.0)
