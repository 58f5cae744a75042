"""A quick variant of `python -m validation.extrapolation`: curves of angles of one arm."""

from __future__ import annotations

import pytest

from lrm_math.effects.curves import AngleCurve, CouplingCurve
from validation.extrapolation import examine, table


@pytest.mark.slow
def test_curves_fitted_on_half_of_the_range_do_no_harm_on_the_other() -> None:
    found = examine(0, 130, (AngleCurve, CouplingCurve))
    assert found.parameters[1] > found.parameters[0] + 10
    assert found.worse < 1.05
    assert found.farthest < 1.5
    assert table([found]).count("\n") == 2
