"""The stated uncertainty of a prediction grows where no angle was measured: between levels, and beyond the range."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lrm_ident.data.measurements import Measurements
from lrm_ident.study.study import Study
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.ik.calibrated import CalibratedSolver
from lrm_math.ik.goal import point
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from lrm_math.model.model_file import ModelFile, covariance_of, load_model
from lrm_math.toml_file import read_toml

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
    return Study.of(Measurements(poses, number, tcp, None, None, number, Path("d.csv"), "0" * 64, arm=ARM)).fit()


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
        assert found is not None
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
