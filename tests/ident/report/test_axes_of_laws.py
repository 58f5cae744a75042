"""An effect is drawn against what its law follows."""

from __future__ import annotations

import numpy as np
import pytest

from lrm_ident.report.text.variables import variable_name
from lrm_ident.residual.covariates import Covariate, Kind
from lrm_ident.residual.picture.group_means import of_law
from lrm_math.arm.arm import Arm
from lrm_math.effects import effects_at

KINDS: tuple[Kind, ...] = ("angle", "motion", "torque")


@pytest.mark.parametrize(
    ("name", "axes"),
    [
        ("hysteresis@joint3", ["last motion of joint 3"]),
        ("backlash@joint2", ["torque of joint 2"]),
        ("friction_curve@joint2", ["last motion of joint 2", "torque of joint 2"]),
        ("servo_gain@joint1", ["angle of joint 1"]),
        ("cable_curve@joint1+joint2", ["angle of joint 1", "angle of joint 2"]),
        ("drift@base", ["order of measurement"]),
    ],
)
def test_the_abscissa_is_that_of_the_law(lab: Arm, name: str, axes: list[str]) -> None:
    known = [Covariate(kind, np.zeros(3), joint) for kind in KINDS for joint in range(6)]
    known.append(Covariate("order", np.zeros(3)))
    (effect,) = effects_at(lab, name)
    assert [variable_name(one.variable) for one in of_law(effect, known)] == axes
    (mass,) = effects_at(lab, "mass@link5")
    assert "order" not in {one.kind for one in of_law(mass, known)}
