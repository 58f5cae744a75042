"""Where no angle was measured: empirical terms are left out, and the stated uncertainty grows."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lrm_ident.data.measurements import Measurements
from lrm_ident.data.source import Source
from lrm_ident.diagnosis.add_effect import add_effects
from lrm_ident.fitting.identifiability import fit_identifiable
from lrm_ident.study.study import Study
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.effects.reversion import Reversion
from lrm_math.ik.calibrated import CalibratedSolver
from lrm_math.ik.goal import point
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from lrm_math.model.model_file import ModelFile, covariance_of, load_model
from lrm_math.toml_file import read_toml

CURVE = "coupling_curve@joint3<-joint1"


def measured(arm: Arm, with_joint4: bool, upper: bool = True, count: int = 120) -> Measurements:
    """Joint 3 turns by the angle of joint 1, times that of joint 4 if so; joint 4 in one half of its range."""
    rng = np.random.default_rng(3 + upper)
    q = rng.uniform(-1.4, 1.4, (count, arm.dof))
    q[:, 3] = rng.uniform(*((0.0, 1.4) if upper else (-1.4, 0.0)), count)
    true = q.copy()
    true[:, 2] += 0.02 * q[:, 0] * (q[:, 3] if with_joint4 else 1.0)
    tcp = solve_equilibrium(model_of(arm, ()), poses_of(true)).tcp + 2e-4 * rng.normal(size=(count, 3))
    return Measurements.of_tcp(poses_of(q), tcp, 2e-4, source=Source(arm=arm))


def fitted(arm: Arm, data: Measurements) -> tuple[Model, Model]:
    """Without the curve, and with it."""
    plain = model_of(arm, [e for name in ("offsets", "compliance") for e in effects_at(arm, name)])
    before = fit_identifiable(plain, data, plain.keys).fit.model
    return before, add_effects(before, data, effects_at(arm, CURVE)).model


def reversion(model: Model) -> Reversion | None:
    return model.within.reversion


def rms(model: Model, data: Measurements) -> float:
    error: Array = solve_equilibrium(model, data.poses).tcp - data.tcp
    return float(np.sqrt((error**2).sum(axis=1).mean()))


def test_a_curve_that_grows_with_another_joint_ends_with_its_range(lab: Arm) -> None:
    """Joint 1 times joint 4 looks like a curve of joint 1 above zero, and has the other sign below."""
    data, beyond = measured(lab, with_joint4=True), measured(lab, with_joint4=True, upper=False)
    before, after = fitted(lab, data)
    found = reversion(after)
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
    data = Measurements.of_tcp(poses_of(q), tcp, 2e-4, source=Source(arm=lab))
    plain = model_of(lab, [e for name in ("offsets", "compliance") for e in effects_at(lab, name)])
    wave = add_effects(
        fit_identifiable(plain, data, plain.keys).fit.model, data, effects_at(lab, "gear_ripple@joint3")
    ).model
    assert reversion(wave) is None, "a law alone holds everywhere"
    found = reversion(add_effects(wave, data, effects_at(lab, "angle_curve@joint3")).model)
    assert set(found.terms) == {"gear_ripple@joint3", "angle_curve@joint3"}
    assert list(found.limiting) == [2]
    assert found.limiting[2] == (q[:, 2].min(), q[:, 2].max())


ARM, NOISE = load_arm("two-joint"), 2e-4
LEVELS = np.radians([-60.0, 0.0, 60.0])
BETWEEN, BEYOND = np.radians(30.0), np.radians(95.0)


def ripple(q: Array) -> Array:
    """(N,), error of joint 1 (rad): nothing at the levels, 1.3 times the noise of a TCP 0.25 m away between them."""
    return np.asarray(1.3 * NOISE / 0.25 * np.sin(3.0 * q))


def study(q: Array) -> Study:
    """The study of poses of an arm with that ripple."""
    model = model_of(ARM, [*effects_at(ARM, "offsets"), *effects_at(ARM, "compliance")])
    number = np.arange(1, len(q) + 1)
    poses, true = replace(poses_of(q), number=number), q + np.stack([ripple(q[:, 0]), np.zeros(len(q))], axis=1)
    tcp = solve_equilibrium(model, poses_of(true)).tcp + np.random.default_rng(2).normal(0.0, NOISE, (len(q), 3))
    return Study.of(Measurements.of_tcp(poses, tcp, pose=number, source=Source(Path("d.csv"), "0" * 64, arm=ARM))).fit()


def stated(of: Study, folder: Path) -> CalibratedSolver:
    """The solver of its model file, as the daemon makes it."""
    path = folder / "model.toml"
    of.save(path)
    model = load_model(path)
    return CalibratedSolver.of(model, covariance=covariance_of(path, read_toml(path, ModelFile), model))


def test_three_angles_a_joint(tmp_path: Path) -> None:
    """At the levels the data know the error; between them, and beyond, nothing does, whatever the formula."""
    q = np.array([(a, b) for a in LEVELS for b in LEVELS for _ in range(12)])
    solver = stated(study(q), tmp_path)

    def sd(first: float) -> float:
        """m, stated for a command of joint 1."""
        found = solver.forward([first, LEVELS[2]]).uncertainty
        return found.sd

    at, between, inside, beyond = (sd(angle) for angle in (0.0, BETWEEN, np.radians(50.0), BEYOND))
    assert between > 5.0 * at
    assert beyond > inside
    assert between > 1.3 * NOISE, "the ripple is within what is stated"
    goal = solver.forward([BETWEEN, LEVELS[2]])
    reply = solver.solve(point(goal.tcp), near=[BETWEEN, LEVELS[2]])
    assert reply.sd == pytest.approx(goal.uncertainty.sd, rel=0.05)


def test_angles_everywhere_leave_nothing_open_within_them(tmp_path: Path) -> None:
    """Many angles determine the size of the error too, so that little more is stated beyond them."""
    dense = np.random.default_rng(4).uniform(-1.2, 1.2, (300, 2))
    few, many = (
        stated(study(q), tmp_path).arm.model.within.unmeasured
        for q in (np.array([(a, b) for a in LEVELS for b in LEVELS for _ in range(12)]), dense)
    )
    assert many.spread(np.array([[0.31, 0.0]]))[0, 0] < 0.1 * few.spread(np.array([[BETWEEN, 0.0]]))[0, 0]
    assert many.sd[0] < 0.5 * few.sd[0]


def test_a_refit_with_a_prior_states_what_the_fit_stated() -> None:
    """Before, a model after `auto --prior` said nothing of angles that were not measured."""
    fitted = study(np.array([(a, b) for a in LEVELS for b in LEVELS for _ in range(4)]))
    before, after = (of.model.within.unmeasured for of in (fitted, fitted.fit_all("vague")))
    assert after.measured == before.measured
    assert min(after.sd) > 0.0


def test_the_start_of_auto_states_what_the_fit_stated() -> None:
    """Before, a study after `auto` without a step said nothing of angles that were not measured; its file did."""
    fitted = study(np.random.default_rng(4).uniform(-1.2, 1.2, (60, 2)))
    _, after = fitted.auto(max_effects=0)
    before, stated_after = (of.model.within.unmeasured for of in (fitted, after))
    assert stated_after.measured == before.measured
    assert stated_after.sd == pytest.approx(before.sd, rel=0.1)


def test_a_step_after_which_outliers_are_found_states_the_same() -> None:
    """The eccentricity hides a wrong position; with it that is left out, and the model is fitted anew."""
    rng, count = np.random.default_rng(5), 80
    q, number = rng.uniform(-1.2, 1.2, (count, 2)), np.arange(1, count + 1)
    model = model_of(ARM, [*effects_at(ARM, "offsets"), *effects_at(ARM, "compliance")])
    true = q + np.stack([0.04 * np.sin(2.0 * q[:, 0]), np.zeros(count)], axis=1)
    tcp = solve_equilibrium(model, poses_of(true)).tcp + rng.normal(0.0, NOISE, (count, 3))
    tcp[[7, 30, 55]] += 1e-3
    source = Source(Path("d.csv"), "0" * 64, arm=ARM)
    data = Measurements.of_tcp(replace(poses_of(q), number=number), tcp, NOISE, pose=number, source=source)
    found, after = Study.of(data).fit().auto(max_effects=1)
    before, with_it = found.steps
    assert len(with_it.data) < len(before.data)
    assert after.model.within.unmeasured is not None
