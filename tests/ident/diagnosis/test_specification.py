"""Test of an effect's place: passed where the effect stands where it acts, failed where the cause acts elsewhere."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lrm_ident.data.measurements import Measurements
from lrm_ident.diagnosis.add_effect import add_effects
from lrm_ident.diagnosis.specification_test import misspecified_effects
from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_ident.fitting.loss import SQUARED
from lrm_ident.fitting.model_fit import fit_model
from lrm_math.effects import effects_at
from tests.support.sweep import seeds
from tests.support.upright_arm import upright_measurements
from validation.synthetic import CoupledJoint, FormulaJoint, FrictionLag, HiddenEffect
from validation.synthetic.hidden_links import WobblingTurntable

LAG, COUPLED = "hysteresis@joint2", "coupling@joint2<-joint1"
POSES, NOISE = 150, 3e-4
DRAGGED, NODS = FormulaJoint(3, 0.0105, "-np.tanh(way[2] / 0.1)"), WobblingTurntable(0.007)
STUCK_BIT = FormulaJoint(4, 0.02, "np.floor(q[4] / 0.02) % 2.0")


def fitted(folder: Path, seed: int, name: str, *hidden: HiddenEffect) -> tuple[Fit, Measurements]:
    """The fit with an effect, whatever is hidden."""
    model, data = upright_measurements(folder, seed, POSES, NOISE, hidden)
    base = fit_model(model, data, "identifiable", SQUARED).fit.model
    return add_effects(base, data, effects_at(base.arm, name)), data


@pytest.mark.parametrize(("name", "hidden"), [(LAG, DRAGGED), (COUPLED, NODS)])
def test_what_acts_at_another_place_is_seen(tmp_path: Path, name: str, hidden: HiddenEffect) -> None:
    """Before: friction of the joint before was the identified cause, or a coupling."""
    assert misspecified_effects(*fitted(tmp_path, 1, name, hidden), [name]) == (name,)


@pytest.mark.parametrize("seed", seeds(2, 8))
@pytest.mark.parametrize(
    ("name", "hidden"),
    [
        (LAG, (FrictionLag(2, 0.02, 0.01),)),
        (COUPLED, (CoupledJoint(2, 1, 0.02, 1.5),)),
        (LAG, (FrictionLag(2, 0.02, 0.01), STUCK_BIT)),
        (LAG, ()),
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
