"""Coverage of a residual field: where its predictive variance says so, and the share of the reach."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_math.effects import effects_at
from lrm_math.effects.field.residual_field import BEYOND
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.covariance import Covariance
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from lrm_math.model.uncertainty import UNSURE, field_coverage, field_speaks, position_covariance
from tests.math.effects.test_residual_field import FIELD, LAB, Learned
from tests.support.sweep import examples


def known(field: Learned, size: float = 1e-4, beyond: float = 2e-3) -> tuple[Model, Covariance]:
    """A model with a field, and a random covariance of its coefficients; independent of what it may be beyond."""
    named = {parameter.name: key for parameter, key in zip(FIELD.parameters, FIELD.keys, strict=True)}
    model = field.model
    keys = (*(key for key in model.free if key in FIELD.keys), *(named[name] for name in BEYOND))
    A = field.rng.normal(0.0, size / np.sqrt(len(keys)), (len(keys), len(keys)))
    matrix = A @ A.T
    matrix[-3:], matrix[:, -3:] = 0.0, 0.0
    matrix[-3:, -3:] = beyond**2 * np.eye(3)
    return model, Covariance(keys, matrix)


@pytest.mark.long
@given(seed=st.integers(0, 2**32 - 1))
@examples(7, 15)
def test_it_speaks_where_the_predicted_deviation_says_so(seed: int) -> None:
    """The deviation is that of a prediction of the whole model, through the equilibrium."""
    field = Learned(seed)
    model, covariance = known(field, size=float(field.rng.uniform(1e-4, 3e-3)))
    q = field.rng.uniform(1.1 * field.lower, 1.1 * field.upper, (20, LAB.dof))
    speaks = field_speaks(model, covariance, q)
    spread = position_covariance(solve_equilibrium(model, poses_of(q)), covariance)
    assert spread is not None
    variance, beyond = np.einsum("nii->n", spread), 3 * 2e-3**2
    sure = np.abs(variance - UNSURE * beyond) > 1e-9 * beyond
    np.testing.assert_array_equal(speaks[sure], (variance < UNSURE * beyond)[sure])


@pytest.mark.long
@given(seed=st.integers(0, 2**32 - 1))
@examples(7, 15)
def test_its_share_of_the_reach_is_that_of_the_range(seed: int) -> None:
    """A field that is sure in its range speaks there and on a short way beyond, so at the range's share at least."""
    model, covariance = known(Learned(seed))
    coverage = field_coverage(model, covariance)
    share = np.prod([(b - a) / (j.upper - j.lower) for (a, b), j in zip(model.within.angle, LAB.joints, strict=True)])
    assert coverage.outside == pytest.approx(1.0 - share, abs=4.0 * np.sqrt(share / 2000) + 2e-3)
    assert 1.0 - coverage.outside - 1e-12 <= coverage.speaks <= 1.0
    assert coverage.effect == "residual_field@tool"


def test_what_is_not_known_is_not_said() -> None:
    field = Learned(3)
    model, covariance = known(field)
    unknown = field_coverage(model, None)
    assert unknown.speaks is None
    assert unknown.outside > 0.5
    assert field_speaks(model, None, field.inside().q) is None
    springs = model_of(LAB, effects_at(LAB, "compliance"))
    assert field_coverage(springs, covariance) is None
