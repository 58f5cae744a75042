"""A verdict says where it holds: at the measured levels and ranges of the joints, and nowhere else."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.residual.data_audit import FEW_LEVELS, where_it_holds

LOWER, UPPER = np.radians([-90.0, -90.0, -90.0]), np.radians([90.0, 90.0, 90.0])


def test_few_levels_and_half_a_range_are_named() -> None:
    """Three angles of joint 1, the upper half of joint 2, all of joint 3."""
    rng = np.random.default_rng(0)
    q = np.radians(
        np.column_stack([rng.choice([-40.0, 0.0, 40.0], 90), rng.uniform(0, 90, 90), rng.uniform(-90, 90, 90)])
    )
    said = where_it_holds(q, LOWER, UPPER)
    assert "joint 1 at -40, 0, 40 deg only" in said
    assert "joint 2 from " in said
    assert "joint 3" not in said


@given(st.integers(0, 2**31), st.integers(FEW_LEVELS + 1, 40))
def test_nothing_is_said_of_a_range_that_was_covered(seed: int, levels: int) -> None:
    """Many levels over the whole range of every joint."""
    angles = np.linspace(-90.0, 90.0, levels)
    order = np.random.default_rng(seed)
    q = np.radians(np.column_stack([order.permutation(angles) for _ in range(3)]))
    assert where_it_holds(q, LOWER, UPPER) == ""
