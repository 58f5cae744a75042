"""Test of an effect's place and amount: passed where the effect is what acts, failed where another cause is."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from lrm_ident.data.measurements import Measurements
from lrm_ident.diagnosis.add_effect import add_effects
from lrm_ident.diagnosis.specification_test import misspecified_effects
from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_ident.fitting.loss import SQUARED
from lrm_ident.fitting.model_fit import fit_model
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from tests.support.sweep import seeds
from tests.support.upright_arm import upright_measurements
from validation.synthetic import CommandedPoses, CoupledJoint, FormulaJoint, FrictionLag, HiddenEffect, WarmUp
from validation.synthetic.hidden_effect import JointError
from validation.synthetic.hidden_links import WobblingTurntable

LAG, COUPLED, DRIFT = "hysteresis@joint2", "coupling@joint2<-joint1", "drift@joint2"
POSES, NOISE = 150, 3e-4
DRAGGED, NODS = FormulaJoint(3, 0.0105, "-np.tanh(way[2] / 0.1)"), WobblingTurntable(0.007)
STUCK_BIT = FormulaJoint(4, 0.02, "np.floor(q[4] / 0.02) % 2.0")


@dataclass(frozen=True)
class GrowingPlay(JointError):
    """Play that wears in, on the side of the weight: the other one beyond 70 deg."""

    size_rad: float

    def error(self, q: Array, tau: Array, poses: CommandedPoses) -> Array:
        grown = poses.time_s / poses.time_s[-1]
        return np.asarray(self.size_rad * grown * np.tanh(20.0 * (np.cos(q) - np.cos(np.radians(70.0)))))


def fitted(folder: Path, seed: int, name: str, *hidden: HiddenEffect) -> tuple[Fit, Measurements]:
    """The fit with an effect, whatever is hidden."""
    model, data = upright_measurements(folder, seed, POSES, NOISE, hidden)
    base = fit_model(model, data, "identifiable", SQUARED).fit.model
    return add_effects(base, data, effects_at(base.arm, name)), data


@pytest.mark.parametrize(("name", "hidden"), [(LAG, DRAGGED), (COUPLED, NODS)])
def test_what_acts_at_another_place_is_seen(tmp_path: Path, name: str, hidden: HiddenEffect) -> None:
    """Before: friction of the joint before was the identified cause, or a coupling."""
    assert misspecified_effects(*fitted(tmp_path, 1, name, hidden), [name]) == (name,)


def test_a_passing_zero_that_follows_the_angle_is_another_cause(tmp_path: Path) -> None:
    """Before: play that grows was identified as a drift of its joint."""
    assert misspecified_effects(*fitted(tmp_path, 1, DRIFT, GrowingPlay(2, 0.02)), [DRIFT]) == (DRIFT,)


@pytest.mark.parametrize("seed", seeds(2, 8))
@pytest.mark.parametrize(
    ("name", "hidden"),
    [
        (LAG, (FrictionLag(2, 0.02, 0.01),)),
        (COUPLED, (CoupledJoint(2, 1, 0.02, 1.5),)),
        (LAG, (FrictionLag(2, 0.02, 0.01), STUCK_BIT)),
        (LAG, ()),
        (DRIFT, (WarmUp(2, 0.02, 1500.0),)),
        (DRIFT, (WarmUp(2, 0.02, 1500.0), CoupledJoint(3, 2, 0.01, 1.5))),
    ],
)
def test_an_effect_where_it_acts_passes(tmp_path: Path, seed: int, name: str, hidden: tuple[HiddenEffect, ...]) -> None:
    """Also beside another cause that follows something else."""
    assert not misspecified_effects(*fitted(tmp_path, seed, name, *hidden), [name])


def test_effects_that_move_several_slots_are_not_tested(tmp_path: Path) -> None:
    name = "base_compliance@base"
    fit, data = fitted(tmp_path, 3, name, NODS)
    assert not misspecified_effects(fit, data, [name, "offsets@joint1", "backlash@joint1"])
    assert not misspecified_effects(fit, data, [])


def test_the_order_of_poses_does_not_matter_to_an_angle(tmp_path: Path) -> None:
    fit, data = fitted(tmp_path, 1, COUPLED, NODS)
    rows = np.random.default_rng(0).permutation(len(data))
    assert misspecified_effects(fit.take(rows), data.take(rows), [COUPLED]) == (COUPLED,)
