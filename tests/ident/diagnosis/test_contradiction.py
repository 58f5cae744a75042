"""An effect that follows an angle is a cause only where the measured angles could have contradicted its formula."""

from __future__ import annotations

from itertools import product

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.diagnosis.contradiction import can_be_contradicted, levels_of_its_own
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects import effects_at

LAB = load_arm("lrm-lab")
GAIN, GEAR, COUPLED = (
    effects_at(LAB, name)[0] for name in ("servo_gain@joint2", "eccentricity@joint2", "coupling@joint4<-joint2")
)


def grid(levels: int) -> Array:
    """Every combination of so many angles of joints 2 and 4 (rad); the others at random."""
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (levels**2, LAB.dof))
    q[:, [1, 3]] = [*product(np.linspace(-1.0, 1.0, levels), repeat=2)]
    return q


@given(st.integers(2, 9))
def test_a_formula_needs_two_levels_more_than_it_has_parameters(levels: int) -> None:
    """One goes to the offset; with no other left any function of the angle fits exactly, and no name is shown."""
    for effect in (GAIN, GEAR, COUPLED):
        assert can_be_contradicted(effect, grid(levels)) == (levels >= len(effect.parameters) + 2)


@given(st.integers(0, 2**31), st.floats(-2.0, 2.0), st.integers(2, 6))
def test_joints_that_move_together_show_no_cause(seed: int, slope: float, other: int) -> None:
    """Functions of the one are functions of the other; where both move freely, each can be told."""
    q = np.random.default_rng(seed).uniform(-1.0, 1.0, (100, LAB.dof))
    joint = other % LAB.dof
    if joint == 1:
        return
    assert levels_of_its_own(q, 1) > 10
    q[:, 1] = slope * q[:, joint] + 0.2
    assert levels_of_its_own(q, 1) <= 2
    assert not can_be_contradicted(GEAR, q)


def test_what_follows_no_single_angle_is_not_judged_by_angles() -> None:
    """Play and springs show themselves in the load and in the side of arrival."""
    for name in ("backlash@joint2", "compliance@joint2", "common_gain", "base_compliance@base"):
        assert can_be_contradicted(effects_at(LAB, name)[0], grid(2))
