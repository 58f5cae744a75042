"""Step size of central differences: their Jacobian against the exact total derivative (thesis section 4.6).

A large step truncates the curve (error like ε²), a small one is lost in round-off (like 1/ε). The thesis looks for
steps at which the norm of the Jacobian stays level; with the exact derivative the error itself is known.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lrm_ident.design.observability import MM_PER_M, Units, identification_jacobian, unit_of
from lrm_ident.fitting.progress import OnProgress, silent
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.errors import LrmError, NoEquilibrium
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model

STEPS: tuple[float, ...] = tuple(10.0 ** (k / 3) for k in range(-48, 1))
TOLERANCE = 1e-14  # m: the elastic iteration must not limit the differences
MAX_RELATIVE_ERROR = 1e-6  # of a usable derivative


@dataclass(frozen=True, eq=False)
class StepSizeStudy:
    """Central differences at one posture, for some parameters.

    Attributes:
        angle: rad, of every joint. option: which parameters.
        steps: (E,), in the units of the study, the same for every parameter.
        norm: (E,), Frobenius norm of the 3 × P Jacobian by differences. exact: norm of the exact Jacobian.
        error: (E,), relative error of the Jacobian (norm of its difference from the exact one).
        no_equilibrium: steps so large that the arm has no equilibrium; they are left out of the others.
    """

    angle: float
    option: str
    steps: Array
    norm: Array
    error: Array
    exact: float
    no_equilibrium: tuple[float, ...]

    @property
    def best(self) -> tuple[float, float]:
        """The step with the least error, and that error."""
        k = int(np.argmin(self.error))
        return float(self.steps[k]), float(self.error[k])

    @property
    def usable_range(self) -> tuple[float, float] | None:
        """Steps around the best one between which the error stays below `MAX_RELATIVE_ERROR`; None if there is none."""
        k, bad = int(np.argmin(self.error)), np.flatnonzero(~(self.error < MAX_RELATIVE_ERROR))
        if k in bad:
            return None
        first, last = max(bad[bad < k], default=-1) + 1, min(bad[bad > k], default=len(self.error)) - 1
        return float(self.steps[first]), float(self.steps[last])


def study_step_sizes(
    model: Model,
    options: Mapping[str, Sequence[str]],
    angles: Sequence[float],
    units: Units = "thesis",
    steps: Sequence[float] = STEPS,
    progress: OnProgress = silent,
) -> list[StepSizeStudy]:
    """Studies every option's parameters with all joints at each of the angles (rad).

    Raises:
        LrmError: an angle beyond the limits of a joint.
    """
    keys = tuple(dict.fromkeys(key for chosen in options.values() for key in chosen))
    found = []
    for number, angle in enumerate(angles):
        pose = _all_joints_at(model.arm, angle)
        equilibrium = solve_equilibrium(model, pose, tolerance=TOLERANCE)
        exact = identification_jacobian(equilibrium, keys, units)[0]
        by_step = np.stack([_differences(model, pose, keys, units, step) for step in steps])
        for option, chosen in options.items():
            found.append(_study(angle, option, np.array(steps), exact, by_step, [keys.index(key) for key in chosen]))
        progress(number + 1, len(angles))
    return found


def _study(angle: float, option: str, steps: Array, exact: Array, by_step: Array, columns: list[int]) -> StepSizeStudy:
    chosen, size = by_step[:, :, columns], float(np.linalg.norm(exact[:, columns]))
    solved = np.isfinite(chosen).all(axis=(1, 2))
    error = np.linalg.norm(chosen[solved] - exact[:, columns], axis=(1, 2)) / size
    norm = np.linalg.norm(chosen[solved], axis=(1, 2))
    return StepSizeStudy(angle, option, steps[solved], norm, error, size, tuple(steps[~solved].tolist()))


def _all_joints_at(arm: Arm, angle: float) -> Poses:
    for number, joint in enumerate(arm.joints, start=1):
        if not joint.lower - 1e-9 <= angle <= joint.upper + 1e-9:
            low, high, requested = np.degrees([joint.lower, joint.upper, angle])
            raise LrmError(f"{requested:g} deg is beyond the limits of joint {number}: {low:g} to {high:g} deg")
    return poses_of([angle] * arm.dof)


def _differences(model: Model, pose: Poses, keys: Sequence[str], units: Units, step: float) -> Array:
    """(3, P), mm per unit; NaN for a parameter with which there is no equilibrium."""
    out = np.full((3, len(keys)), np.nan)
    for column, key in enumerate(keys):
        j = model.position(key)
        h = step * unit_of(model.parameters[j], units)
        change = h * (np.arange(len(model.keys)) == j)
        try:
            up, down = (
                solve_equilibrium(model.with_values(model.values + side), pose, tolerance=TOLERANCE).tcp[0]
                for side in (change, -change)
            )
        except NoEquilibrium:
            continue
        out[:, column] = (up - down) * MM_PER_M / (2.0 * step)
    return out
