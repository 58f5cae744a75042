"""Screening: columns of candidates are those of the total Jacobian, less the parameters that move nothing."""

from __future__ import annotations

import numpy as np
import pytest

from lrm_ident.diagnosis.screening.candidates import differentiate_candidates, unfitted_effects
from lrm_math.arm.arm import Arm
from lrm_math.effects import effects_at
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.derivatives import parameter_jacobian
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of

pytestmark = pytest.mark.long


def test_columns_are_those_of_the_total_jacobian_where_they_move_anything(lab: Arm) -> None:
    """Poses in a narrow range: most splines of the forms are zero at all of them."""
    model = model_of(lab, (*effects_at(lab, "offsets"), *effects_at(lab, "compliance")))
    poses = poses_of(np.random.default_rng(2).uniform(-0.3, 0.3, (15, lab.dof)), 0.05)
    response, found = differentiate_candidates(solve_equilibrium(model, poses), list(unfitted_effects(model)))
    settled, still = response.equilibrium, 0
    for one in found:
        shape = tuple(settled.model.value(key) for key in one.effect.keys)
        acting, moved = one.acting(shape)
        keys = [one.effect.keys[row] for row in one.rows]
        typical = [parameter.typical for parameter in one.parameters]
        expected = (parameter_jacobian(settled, keys) * typical).reshape(3 * len(poses), -1)
        np.testing.assert_allclose(one.columns(shape), expected, rtol=1e-9, atol=1e-15, err_msg=one.name)
        assert acting.rows == tuple(row for row, column in zip(one.rows, expected.T, strict=True) if column.any())
        np.testing.assert_array_equal(moved, one.columns(shape)[:, expected.any(axis=0)])
        still += len(one.rows) - len(acting.rows)
    assert still > len(found)
