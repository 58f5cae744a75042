"""Inverse of the nominal arm: closed form where three axes intersect, damped least squares elsewhere."""

from __future__ import annotations

from functools import lru_cache

from lrm_math.arm.arm import Arm
from lrm_math.ik.closed_form import ClosedForm
from lrm_math.ik.numerical import Numerical
from lrm_math.ik.solver import NominalSolver


@lru_cache(maxsize=64)
def solver_of(arm: Arm) -> NominalSolver:
    """The solver of an arm: the closed form if its first or last three axes intersect, else the numerical one."""
    return ClosedForm.of(arm) or Numerical.of(arm)
