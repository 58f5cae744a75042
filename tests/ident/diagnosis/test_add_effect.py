"""Adding an effect: the shape that it is fitted at."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.diagnosis.add_effect import add_effects
from lrm_ident.fitting.levenberg_marquardt import fit
from lrm_ident.fitting.parameter_sets import no_bounds
from lrm_ident.fitting.priors import with_range_priors
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects import Description, JointEffect, LinearEffect, Parameter, effects_at
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from tests.support.sweep import seeds

NOISE, POSES = 1e-4, 120
SLOW = "backlash.joint2.w_rad_per_rad"
PLAY, SOFTNESS, WIDTH = "backlash@joint2", "backlash.joint2.tau0_Nm", "backlash.joint2.b_rad"
FREE = ("offsets.joint2.theta_rad", "compliance.joint2.k_rad_per_Nm", "compliance.joint3.k_rad_per_Nm")
STANDARD_ERROR = 0.5 / (3 * POSES)  # of a parameter: so much may another value lower the RMS, relatively


def play_and_measurements(seed: int, softness: float, width: float) -> tuple[Model, Measurements]:
    """A model without the play of joint 2 (rad) that a torque (N·m) takes up, and measurements of the arm with it."""
    rng, arm = np.random.default_rng(seed), load_arm("lrm-lab")
    base = effects_at(arm, "offsets") + effects_at(arm, "compliance")
    known = dict(zip(FREE, (0.02, 0.08, 0.09), strict=True))
    truth = model_of(arm, (*base, *effects_at(arm, PLAY)), {**known, SOFTNESS: softness, WIDTH: width})
    poses = Poses(rng.uniform(-0.9, 0.9, (POSES, arm.dof)), np.zeros(POSES))
    tcp = solve_equilibrium(truth, poses).tcp + rng.normal(0.0, NOISE, (POSES, 3))
    return replace(model_of(arm, base), free=FREE), Measurements.of_tcp(poses, tcp)


@pytest.mark.long
@pytest.mark.parametrize(("seed", "softness"), [(0, 0.02), (1, 0.05), (2, 0.1)])
def test_the_shape_of_an_added_effect_fits_best(seed: int, softness: float) -> None:
    model, data = play_and_measurements(seed, softness, 0.03)
    [effect] = effects_at(model.arm, PLAY)
    found = add_effects(model, data, [effect])
    shape, rms = found.model.value(SOFTNESS), error_stats(found.residual).rms
    assert SOFTNESS not in found.model.free
    assert abs(np.log(shape / softness)) < 0.3
    for other in (0.8 * shape, 0.97 * shape, 1.03 * shape, 1.25 * shape):
        refitted = fit(found.model.with_values_of([SOFTNESS], other), data, prior=found.stated, near=found.equilibrium)
        assert error_stats(refitted.residual).rms >= rms * (1.0 - STANDARD_ERROR)


def test_a_shape_that_nothing_shows_leaves_standard_errors_finite() -> None:
    model, data = play_and_measurements(5, 0.02, 0.0)
    [effect] = effects_at(model.arm, PLAY)
    found = add_effects(model, data, [effect])
    width = found.model.free.index(WIDTH)
    assert found.model.value(WIDTH) < 5.0 * found.standard_error[width] < 0.01
    assert np.isfinite(found.standard_error).all()


@pytest.mark.long
def test_standard_errors_count_that_the_shape_is_unknown_too() -> None:
    model, data = play_and_measurements(1, 0.04, 0.03)
    [effect] = effects_at(model.arm, PLAY)
    held = add_effects(model, data, [effect])
    free = fit(held.model.with_free((*held.model.free, SOFTNESS)), data, prior=held.stated, near=held.equilibrium)
    assert held.standard_error == pytest.approx(free.standard_error[:-1], rel=0.03)
    both = held.model.with_free((*held.model.free, SOFTNESS, SLOW))
    prior = with_range_priors(held.stated, both, (SOFTNESS, SLOW))
    C, width = fit(both, data, no_bounds(both.free), prior=prior).covariance, held.model.free.index(WIDTH)
    conditional = C[width, width] - C[width, -2:] @ np.linalg.solve(C[-2:, -2:], C[-2:, width])
    assert held.standard_error[width] > 1.05 * np.sqrt(conditional)


class Belt(JointEffect, LinearEffect):
    """A belt that turns a joint by the torque of the joint before."""

    id = "belt"
    about = Description(cause="A belt stretches.", formula="δq_n = c τ_(n-1)", source="made for this test")
    parameters = (Parameter("c_rad_per_Nm", "turn per torque", 1e-4),)
    depends_on = ()

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        return super().places(arm)[1:]

    @property
    def load_slots(self) -> tuple[str, ...]:
        return (f"joint{self.joint}.theta",)

    def basis(self, poses: Poses, tau: tuple[Array, ...]) -> tuple[tuple[Array, ...], ...]:
        return ((tau[0],),)


@pytest.mark.long
@pytest.mark.parametrize("seed", seeds(1, 6))
def test_an_effect_of_many_times_its_typical_size_is_told(seed: int) -> None:
    """A third of the typical size is no bound of what the data tell where the effect is far larger."""
    rng, arm = np.random.default_rng(seed), load_arm("lrm-lab")
    belt, amount = Belt(arm, f"joint{rng.integers(2, 5)}"), rng.uniform(0.02, 0.05) * rng.choice([-1, 1])
    base = effects_at(arm, "offsets") + effects_at(arm, "compliance")
    poses = Poses(rng.uniform(-0.9, 0.9, (POSES, arm.dof)), np.zeros(POSES))
    noise = rng.normal(0.0, 3e-4, (POSES, 3))
    known = dict(zip(FREE, (0.02, 0.08, 0.09), strict=True))
    model = replace(model_of(arm, base), free=FREE)
    [key] = belt.keys
    for hidden in (amount, 0.0):
        tcp = solve_equilibrium(model_of(arm, (*base, belt), {**known, key: hidden}), poses).tcp + noise
        data = Measurements.of_tcp(poses, tcp)
        found = add_effects(model, data, [belt])
        error = found.standard_error[found.model.free.index(key)]
        if hidden == 0.0:  # it stays at its typical size, and is no cause
            assert abs(found.model.value(key)) < 2.0 * error < 10.0 * belt.parameters[0].typical
            continue
        assert error > belt.parameters[0].typical / 3
        assert abs(found.model.value(key) - hidden) < 4 * error < abs(hidden)
