"""Bound on what a prior can do: expected error of the tip if the population's true spreads were the prior.

Linear Bayesian design (Chaloner & Verdinelli 1995): the posterior covariance of poses and prior together, propagated to
the goals. No method can do better on arms of that kind, so it says which goals a fleet of it can reach at all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects import EffectRef, ParameterRef, effect_of, effects_at
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.derivatives import parameter_jacobian
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from validation.fleet.simulated_fleet import (
    BASE_COMPLIANCE,
    COMPLIANCE_CV,
    EFFECTS,
    FLOOR_M,
    JOINT_COMPLIANCE,
    LOAD_KG,
    NOISE_M,
    OWN_ANGLE_SD,
    OWN_LENGTH_SD,
    ArmOfKind,
    EffectOfKind,
)
from validation.synthetic import random_poses
from validation.synthetic.generate import directions

VAGUE = 3.0  # typical sizes
GOALS = 200


class ExpectedErrors(NamedTuple):
    """RMS error of the tip (mm) from few poses with the true population as prior, from few, and from many without."""

    few_with_prior: float
    few: float
    many: float


def expected_errors(
    arm: ArmOfKind, few: int, many: int, own: float, effects: Sequence[EffectOfKind] = EFFECTS
) -> ExpectedErrors:
    """Errors of an arm with every effect of the kind, about the kind's mean; the effects' formulas taken as exact."""
    described = load_arm("lrm-lab")
    names = ("offsets", "compliance", *(effect.name for effect in effects))
    model = model_of(described, [effect for name in names for effect in effects_at(described, name)])
    joints = {EffectRef("compliance", name) for name in described.joint_names}
    joint = float(np.mean(JOINT_COMPLIANCE))
    known = {key: joint for key in model.keys if ParameterRef.parse(key).effect in joints}
    model = model_of(described, model.effects, known | {"compliance.base.k_rad_per_Nm": BASE_COMPLIANCE})
    keys = [key for key, p in zip(model.keys, model.parameters, strict=True) if p.fixed is None]
    typical = np.array([model.parameter(key).typical for key in keys])
    spread = np.array([_spread(model, key, own) for key in keys])
    goals = _columns(model, keys, arm, GOALS, 1)

    def error(poses: int, sd: Array) -> float:
        rows = _columns(model, keys, arm, poses, poses) / NOISE_M
        covariance = np.linalg.inv(rows.T @ rows + np.diag(sd**-2))
        return float(1e3 * np.sqrt(np.einsum("ri,ij,rj->", goals, covariance, goals) / GOALS))

    return ExpectedErrors(error(few, spread), error(few, VAGUE * typical), error(many, VAGUE * typical))


def _spread(model: Model, key: str, own: float) -> float:
    """Standard deviation of a parameter between arms of the kind (SI)."""
    effect, name = ParameterRef.parse(key).id, effect_of(key)
    if effect == "offsets":
        return own * (OWN_ANGLE_SD if key.endswith("_rad") else OWN_LENGTH_SD)
    if effect == "compliance":
        return COMPLIANCE_CV * model.value(key)
    return next(one.sd for one in EFFECTS if one.name == name)


def _columns(model: Model, keys: list[str], arm: ArmOfKind, count: int, seed: int) -> Array:
    """(3 N, P), SI, at random poses as the arms are measured at."""
    q = random_poses(arm.described, count, seed, floor_m=FLOOR_M)
    load = np.random.default_rng(seed).choice((0.0, LOAD_KG), size=count)
    poses = replace(poses_of(q, load), direction=directions(q, np.zeros(q.shape[1])))
    return parameter_jacobian(solve_equilibrium(model, poses), keys).reshape(-1, len(keys))
