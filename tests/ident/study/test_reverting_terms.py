"""An empirical term that varies with another joint's angle is left out beyond the range of that joint."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from lrm_ident.data.measurements import Measurements
from lrm_ident.diagnosis.add_effect import add_effects
from lrm_ident.fitting.identifiability import fit_identifiable
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.effects.reversion import Reversion
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of

CURVE = "coupling_curve@joint3<-joint1"


def measured(arm: Arm, with_joint4: bool, upper: bool = True, count: int = 120) -> Measurements:
    """Joint 3 turns by the angle of joint 1, times that of joint 4 if so; joint 4 in one half of its range."""
    rng = np.random.default_rng(3 + upper)
    q = rng.uniform(-1.4, 1.4, (count, arm.dof))
    q[:, 3] = rng.uniform(*((0.0, 1.4) if upper else (-1.4, 0.0)), count)
    true = q.copy()
    true[:, 2] += 0.02 * q[:, 0] * (q[:, 3] if with_joint4 else 1.0)
    tcp = solve_equilibrium(model_of(arm, ()), poses_of(true)).tcp + 2e-4 * rng.normal(size=(count, 3))
    number = np.arange(1, count + 1)
    return Measurements(poses_of(q), number, tcp, None, 2e-4, number, Path("product.csv"), "", arm=arm)


def fitted(arm: Arm, data: Measurements) -> tuple[Model, Model]:
    """Without the curve, and with it."""
    plain = model_of(arm, [e for name in ("offsets", "compliance") for e in effects_at(arm, name)])
    before = fit_identifiable(plain, data, plain.keys).fit.model
    return before, add_effects(before, data, effects_at(arm, CURVE)).model


def reversion(model: Model) -> Reversion | None:
    assert model.within is not None
    return model.within.reversion


def rms(model: Model, data: Measurements) -> float:
    error: Array = solve_equilibrium(model, data.poses).tcp - data.tcp
    return float(np.sqrt((error**2).sum(axis=1).mean()))


def test_a_curve_that_grows_with_another_joint_ends_with_its_range(lab: Arm) -> None:
    """Joint 1 times joint 4 looks like a curve of joint 1 above zero, and has the other sign below."""
    data, beyond = measured(lab, with_joint4=True), measured(lab, with_joint4=True, upper=False)
    before, after = fitted(lab, data)
    found = reversion(after)
    assert found is not None
    assert found.terms == (CURVE,)
    assert list(found.limiting) == [3]
    assert found.limiting[3][0] == data.poses.q[:, 3].min()
    assert after.within is not None
    held = replace(after, within=replace(after.within, reversion=None))
    assert rms(held, beyond) > rms(before, beyond), "as it was before"
    assert rms(after, beyond) < 0.7 * rms(held, beyond)
    assert rms(after, beyond) < rms(before, beyond)
    assert rms(after, data) == rms(held, data)


def test_a_curve_of_its_own_angle_alone_holds_beyond(lab: Arm) -> None:
    data, beyond = measured(lab, with_joint4=False), measured(lab, with_joint4=False, upper=False)
    before, after = fitted(lab, data)
    assert reversion(after) is None
    assert rms(after, beyond) < 0.5 * rms(before, beyond)


def test_a_wave_whose_form_is_wrong_ends_with_the_range_of_its_joint(lab: Arm) -> None:
    """A wave with a strong harmonic, seen in half a range: its period is measured wrongly, and a curve corrects it."""
    rng = np.random.default_rng(5)
    q = rng.uniform(-1.4, 1.4, (150, lab.dof))
    q[:, 2] = rng.uniform(-1.4, 0.0, len(q))
    true = q.copy()
    true[:, 2] += 0.008 * (np.sin(4.0 * q[:, 2]) + 0.5 * np.cos(8.0 * q[:, 2]))
    tcp = solve_equilibrium(model_of(lab, ()), poses_of(true)).tcp + 2e-4 * rng.normal(size=(len(q), 3))
    number = np.arange(1, len(q) + 1)
    data = Measurements(poses_of(q), number, tcp, None, 2e-4, number, Path("wave.csv"), "", arm=lab)
    plain = model_of(lab, [e for name in ("offsets", "compliance") for e in effects_at(lab, name)])
    wave = add_effects(
        fit_identifiable(plain, data, plain.keys).fit.model, data, effects_at(lab, "gear_ripple@joint3")
    ).model
    assert reversion(wave) is None, "a law alone holds everywhere"
    found = reversion(add_effects(wave, data, effects_at(lab, "angle_curve@joint3")).model)
    assert found is not None
    assert set(found.terms) == {"gear_ripple@joint3", "angle_curve@joint3"}
    assert list(found.limiting) == [2]
    assert found.limiting[2] == (q[:, 2].min(), q[:, 2].max())
