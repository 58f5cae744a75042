"""Coarse fit: how near an arm comes to measured positions if it errs and gives within bounds (ridge regression).

Gauss–Newton steps on all errors of the dimensions and on the joints' compliances, weighted by a Cauchy loss,
regularised by the sizes that they have on an assembled arm, and clipped to bounds that no assembled arm exceeds.

`fitting.levenberg_marquardt` cannot serve here: it fits measurements, and this decides how a file is to be read before
there are any (`data` lies below `fitting`). Up to a hundred readings are scored, most of them wrong, where a fit with
free priors, uncertainties and excluded outliers would follow the wrong ones, too. Ten steps, fixed sizes, hard bounds
and a trimmed score are what tells them apart.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lrm_ident.data.registration.similarity import cauchy_weight
from lrm_math.arm.arm import TOOL, Arm
from lrm_math.arm.plausible_arm import reach
from lrm_math.arrays import Array
from lrm_math.effects import ParameterRef, effects_at
from lrm_math.errors import NoEquilibrium
from lrm_math.kinematics.poses import Poses
from lrm_math.model.derivatives import parameter_jacobian, respond
from lrm_math.model.equilibrium import Equilibrium, solve_equilibrium
from lrm_math.model.model import model_of

STEPS, SETTLED = 10, 0.01  # relative change of the score
OVERDETERMINED = 2.0  # coordinates per parameter
ANGLE_SD, ANGLE_BOUND = np.radians(5.0), np.radians(15.0)
LENGTH_SD, LENGTH_BOUND = 0.010, 0.030  # m, or of the reach where that is more:
RELATIVE_SD, RELATIVE_BOUND = 0.010, 0.030
TARGET_SD, TARGET_BOUND = 0.050, 0.250  # m: of a target on the tool that the arm file does not know of
SAG_SD, SAG_BOUND = np.radians(3.0), np.radians(10.0)  # of a joint under the greatest torque of the poses
NO_TORQUE = 1e-9  # N·m
SHARPEST = 1e-6  # m
NEAR = 0.1  # share of the reach: an arm that misses by more does not do so because it sags
TRUSTED = 0.8  # share of the poses, the nearest ones, that the score counts


@dataclass(frozen=True, eq=False)
class CoarseFit:
    """`equilibrium`: with the fitted dimensions. `score`: `trimmed_rms` of the distances (m).

    `overdetermined`: whether there are so many coordinates that the fit cannot follow whatever was measured.
    """

    equilibrium: Equilibrium
    score: float
    overdetermined: bool


@dataclass(frozen=True, eq=False)
class _Sizes:
    """Parameters of the fit, their usual sizes and their bounds (SI), (P,) each; `rigid_upper`: without sag."""

    keys: tuple[str, ...]
    sd: Array
    lower: Array
    upper: Array
    rigid_upper: Array


def coarse_fit(arm: Arm, poses: Poses, tcp: Array, fixed_base: bool = False, any_target: bool = False) -> CoarseFit:
    """The arm's errors fitted to measured positions (N, 3), m.

    Args:
        fixed_base: whether the base is as drawn, because the frame of the measurements is free instead.
        any_target: whether the target may sit anywhere on the tool. A tight bound puts the rest of it into the base.
    """
    model = model_of(arm, effects_at(arm, "offsets") + effects_at(arm, "compliance"))
    drawn = solve_equilibrium(model, poses)
    sizes = _sizes(drawn, fixed_base, any_target)
    count = len(sizes.keys)
    z, overdetermined = np.zeros(count), tcp.size >= OVERDETERMINED * count
    best: CoarseFit | None = None
    settled, preconditioner = drawn, None
    robust = overdetermined  # weights slow a fit that can follow anything, so such a one starts without
    for step in range(STEPS + 1):
        try:
            moved = model.with_values_of(sizes.keys, z)
            settled = solve_equilibrium(moved, poses, settled, preconditioner=preconditioner)
        except NoEquilibrium:
            break
        residual = tcp - settled.tcp
        distance = np.linalg.norm(residual, axis=1)
        current = CoarseFit(settled, trimmed_rms(distance), overdetermined)
        converged = best is not None and abs(current.score - best.score) < SETTLED * best.score
        best = current if best is None or current.score < best.score else best
        if converged and robust:
            break
        robust = robust or converged or step == STEPS // 2
        weight = cauchy_weight(distance) if robust else np.ones_like(distance)
        root = np.sqrt(weight)[:, None] / max(current.score, SHARPEST)
        preconditioner = respond(settled).preconditioner
        J = (parameter_jacobian(settled, sizes.keys) * root[:, :, None]).reshape(-1, count)
        H = J.T @ J + np.diag(sizes.sd**-2)
        gradient = J.T @ (residual * root).reshape(-1) - z / sizes.sd**2
        upper = sizes.upper if current.score < NEAR * reach(arm) else sizes.rigid_upper
        z = np.clip(z + np.linalg.solve(H, gradient), sizes.lower, upper)
    assert best is not None  # without any error the arm stands still
    return best


def trimmed_rms(distance: Array) -> float:
    """RMS of the nearest 80 % of distances (N,), m: a tenth of wrong measurements does not matter."""
    nearest = np.sort(distance)[: max(1, round(TRUSTED * len(distance)))]
    return float(np.sqrt((nearest**2).mean()))


def _sizes(drawn: Equilibrium, fixed_base: bool, any_target: bool) -> _Sizes:
    """Columns that are fitted, at the equilibrium of the arm as drawn; a joint without torque cannot sag."""
    model, length = drawn.model, reach(drawn.model.arm)
    places = model.arm.link_places
    loads = drawn.loads_on([model.chain.index[f"{place}.theta"] for place in places])
    torque = dict(zip(places, np.abs(loads).max(axis=0).tolist(), strict=True))
    torque["base"] = float(np.abs(drawn.base_moment).max())
    rows = []
    for key in model.keys:
        effect, place, name = ParameterRef.parse(key)
        if effect == "compliance" and torque[place] > NO_TORQUE:
            rows.append((key, SAG_SD / torque[place], 0.0, SAG_BOUND / torque[place]))
        elif effect == "offsets" and not (fixed_base and place == "base"):
            size = max(LENGTH_SD, RELATIVE_SD * length), max(LENGTH_BOUND, RELATIVE_BOUND * length)
            if name.endswith("_rad"):
                size = float(ANGLE_SD), float(ANGLE_BOUND)
            elif any_target and place == TOOL:
                size = TARGET_SD, TARGET_BOUND
            rows.append((key, size[0], -size[1], size[1]))
    keys, sd, lower, upper = zip(*rows, strict=True)
    rigid = [
        0.0 if ParameterRef.parse(key).id == "compliance" else bound for key, bound in zip(keys, upper, strict=True)
    ]
    return _Sizes(keys, np.array(sd), np.array(lower), np.array(upper), np.array(rigid))
