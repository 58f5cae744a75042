"""An effect that is put into measurements of a real arm: what it moves the tip of the arm's fitted model.

Joint, signs and size are drawn; sizes that no arm has, and effects that the arm's own run of `auto` adds, are not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

import lrm_ident as lrm
from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurements import Measurements
from lrm_math.arrays import Array
from lrm_math.effects import Effect, effects_at
from lrm_math.errors import LrmError, NoEquilibrium
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of

DRAWN = {
    "backlash": "b_rad", "nonlinear_stiffness": "", "servo_gain": "", "eccentricity": "", "change_point": "before_rad",
    "hysteresis": "", "gear_ripple": "", "coupling": "", "drift": "A_rad", "mass": "mass_g", "lateral_compliance": "",
}  # fmt: skip
"""Effects, and the parameter that is drawn where it is one alone; else all that a fit estimates."""
LEAST, MOST = 2.0, 6.0
"""RMS motion over the RMS error of the plain fit."""
ROUNDS, NEAR = 20, 0.02


@dataclass(frozen=True, eq=False)
class RealArm:
    """Measurements, the plain fit, and what `auto` makes of them. `name`: of the arm, or the path of its file."""

    name: str
    data: Measurements
    fitted: lrm.Study
    after: lrm.Study
    own: tuple[str, ...]

    @property
    def fit_rms(self) -> float:
        """RMS error of the plain fit (m)."""
        return error_stats(self.data.tcp - solve_equilibrium(self.fitted.model, self.data.poses).tcp).rms

    @classmethod
    def of(cls, name: str, data: Measurements) -> RealArm:
        """An arm without a further effect."""
        fitted = lrm.Study.of(data).fit()
        run, after = fitted.auto()
        return cls(name, data, fitted, after, tuple(step.added for step in run.steps if step.added))


def motion(model: Model, poses: Poses, effect: Effect, values: Sequence[float]) -> Array:
    """(N, 3), m: the tip with the effect at the values of its parameters (SI), less that without. Raises
    `NoEquilibrium`."""
    known = dict(zip((*model.keys, *effect.keys), (*model.values.tolist(), *values), strict=True))
    moved = model_of(model.arm, (*model.effects, effect), known)
    return solve_equilibrium(moved, poses).tcp - solve_equilibrium(model, poses).tcp


def drawn(arm: RealArm, seed: int) -> tuple[Effect, list[float], Array]:
    """An effect, its parameters' values (SI), and the motion (N, 3), m, that it adds. Raises `LrmError`."""
    rng, kinds = np.random.default_rng(seed), [*DRAWN]
    model, poses = arm.fitted.model, arm.data.poses
    for kind in (kinds[seed % len(kinds)], *rng.permutation(kinds).tolist()):
        places = [each for each in effects_at(model.arm, kind) if each.place.startswith(("joint", "link"))]
        for number in rng.permutation(len(places)):
            effect, target = places[number], arm.fit_rms * rng.uniform(LEAST, MOST)
            sized = _sized(model, poses, effect, _direction(effect, poses, rng), target)
            if sized is not None and effect.name not in arm.own:
                return effect, *sized
    raise LrmError(f"{arm.name}: no effect of a plausible size moves the tip that far")


def _direction(effect: Effect, poses: Poses, rng: np.random.Generator) -> Array:
    """(P,), values in typical sizes: of either sign, and of a shape one of those that a search tries."""
    only, shapes, values = DRAWN[effect.id], effect.shapes_to_try(poses), []
    for parameter in effect.parameters:
        size = float(rng.uniform(0.5, 1.0) * (1.0 if parameter.lower == 0.0 else rng.choice([-1.0, 1.0])))
        shape = rng.choice(shapes.get(parameter.name, (parameter.default,)))
        one = parameter.name if only in ("", parameter.name) and parameter.fixed is None else ""
        values.append(size * parameter.typical if one else float(shape))
    return np.array(values)


def _sized(
    model: Model, poses: Poses, effect: Effect, values: Array, target: float
) -> tuple[list[float], Array] | None:
    """Values whose motion has that RMS (m), and the motion; None where no plausible ones have."""
    free = np.array([parameter.fixed is None for parameter in effect.parameters])
    largest = np.array([parameter.plausible.largest for parameter in effect.parameters])
    for _ in range(ROUNDS):
        try:
            moved = motion(model, poses, effect, values.tolist())
        except NoEquilibrium:
            return None
        rms = error_stats(moved).rms
        if abs(rms / target - 1.0) < NEAR:
            return None if (np.abs(values) > largest)[free].any() else (values.tolist(), moved)
        values = np.where(free, values * target / max(rms, 1e-9), values)
        if not np.all(np.abs(values[free]) < 1e3 * largest[free]):
            return None
    return None
