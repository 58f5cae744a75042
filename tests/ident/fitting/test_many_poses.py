"""Fits of more poses than are fitted at once: the steps over all of them are few."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lrm_ident.data.measurements import Measurements
from lrm_ident.fitting.cross_validation import MOST_TRAINING, Split, blocks_of_fit, held_out_blocks, one_step_fits
from lrm_ident.fitting.identifiability import MAX_SUBSAMPLE
from lrm_ident.fitting.least_squares import objective
from lrm_ident.fitting.least_squares.block_qr import CompressedRows, compress
from lrm_ident.fitting.loss import SQUARED
from lrm_ident.fitting.model_fit import fit_model, nominal_model
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import effects_at
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import Equilibrium, solve_equilibrium
from lrm_math.model.model import model_of

pytestmark = pytest.mark.long

MOST_STEPS = 40
"""Jacobians of all poses that a fit and its cross-validation may take, where one that creeps takes two hundred."""


def flat_valley(count: int) -> Measurements:
    """Measurements of a two-joint arm with play: three of the parameters that a fit keeps are nearly dependent."""
    arm, rng = load_arm("two-joint"), np.random.default_rng(1)
    effects = effects_at(arm, "offsets") + effects_at(arm, "compliance") + effects_at(arm, "backlash@joint2")
    model = model_of(arm, effects)
    sizes = rng.normal(size=len(model.keys)) * [parameter.typical for parameter in model.parameters]
    values = [
        0.05 if key.startswith("compliance") else abs(size) if key.startswith("backlash") else size
        for key, size in zip(model.keys, sizes, strict=True)
    ]
    low, high = 0.7 * np.array([(max(joint.lower, -3.0), min(joint.upper, 3.0)) for joint in arm.joints]).T
    poses = poses_of(rng.uniform(low, high, (count, arm.dof)))
    tcp = solve_equilibrium(model.with_values(np.array(values)), poses).tcp + rng.normal(size=(count, 3)) * 0.3e-3
    number = np.arange(1, count + 1)
    return Measurements(poses, number, tcp, None, None, number, Path("made.csv"), "", arm=arm)


def test_a_fit_of_many_poses_creeps_on_a_part_of_them_only(monkeypatch: pytest.MonkeyPatch) -> None:
    data, counts = flat_valley(2 * MAX_SUBSAMPLE), []

    def counted(equilibrium: Equilibrium, *others: Any) -> CompressedRows:
        counts.append(len(equilibrium.poses))
        return compress(equilibrium, *others)

    monkeypatch.setattr(objective, "compress", counted)
    found = fit_model(nominal_model(load_arm("two-joint")), data, "identifiable", SQUARED).fit
    held_out_blocks(found.model, data, prior=found.stated)
    assert sum(count > MAX_SUBSAMPLE for count in counts) <= MOST_STEPS


def test_a_fold_is_predicted_alike_at_some_of_the_others_and_at_all() -> None:
    data = flat_valley(MOST_TRAINING + 500)
    fitted = fit_model(nominal_model(load_arm("two-joint")), data, "identifiable", SQUARED).fit
    blocks = blocks_of_fit(fitted, data)
    whole = one_step_fits(fitted, data, [Split.of(block.test, len(data), len(data)) for block in blocks])
    for block, equilibrium in zip(blocks, whole, strict=True):
        left = data.position_error(equilibrium)
        assert len(block.train) == MOST_TRAINING
        assert not np.isin(block.train, block.test).any()
        np.testing.assert_allclose(block.test_residual, left[block.test], atol=1e-8)  # m
        np.testing.assert_allclose(block.train_residual, left[block.train], atol=1e-8)
