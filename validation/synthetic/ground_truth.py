"""The true errors of the synthetic arm: geometry, compliances, hidden effects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from .arm_description import ArmDescription
from .hidden_effect import HiddenEffect
from .screws import Array

LINK_KEYS = ("theta_rad", "d_m", "a_m", "alpha_rad", "extra_z_m")
PLACEMENT_KEYS = ("x_m", "y_m", "z_m", "alpha_rad", "beta_rad", "gamma_rad")
Components = tuple[float, ...]
ZERO: Components = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

ANGLE_SD_RAD, LENGTH_SD_M, BASE_POSITION_SD_M = 0.02, 0.0015, 0.003
BASE_COMPLIANCE_RAD_PER_NM = (0.015, 0.025)
JOINT_COMPLIANCE_RAD_PER_NM = (0.05, 0.13)


@dataclass(frozen=True)
class Deviations:
    """Corrections of the described lengths (m) and angles (rad).

    links: one row per link, in the order of LINK_KEYS; base and tool: in the order of PLACEMENT_KEYS.
    """

    links: tuple[Components, ...]
    base: Components = ZERO
    tool: Components = ZERO

    @classmethod
    def named(cls, joints: int, values: Mapping[str, float]) -> Deviations:
        """Reads names such as "joint2.theta_rad", "base.x_m" or "tool.gamma_rad"; others zero. Raises `ValueError`."""
        left = dict(values)

        def take(place: str, keys: tuple[str, ...]) -> Components:
            return tuple(float(left.pop(f"{place}.{key}", 0.0)) for key in keys)

        links = tuple(take(f"joint{number}", LINK_KEYS) for number in range(1, joints + 1))
        base, tool = take("base", PLACEMENT_KEYS), take("tool", PLACEMENT_KEYS)
        if left:
            raise ValueError(f"unknown deviations: {sorted(left)}")
        return cls(links, base, tool)


@dataclass(frozen=True)
class GroundTruth:
    """Errors of the true arm relative to its description.

    displacements: N + 2 rigid displacements of the base, each link and the tool with everything distal to them:
    rotation vector in rad about the origin of the parent frame (the base: its own), then translation in m; in world
    axes at zero configuration. They add to the deviations.
    """

    deviations: Deviations
    displacements: tuple[Components, ...]
    base_compliance_rad_per_nm: float
    joint_compliance_rad_per_nm: tuple[float, ...]
    effects: tuple[HiddenEffect, ...] = ()

    @classmethod
    def nominal(cls, arm: ArmDescription) -> GroundTruth:
        """The rigid arm exactly as described."""
        count = len(arm.links)
        return cls(Deviations.named(count, {}), (ZERO,) * (count + 2), 0.0, (0.0,) * count)

    @classmethod
    def random(cls, arm: ArmDescription, seed: int, effects: tuple[HiddenEffect, ...] = ()) -> GroundTruth:
        """Random errors: normal displacements of every body in all six directions, uniform compliances."""
        rng = np.random.default_rng(seed)
        count = len(arm.links)
        spread = np.full((count + 2, 6), LENGTH_SD_M)
        spread[:, :3] = ANGLE_SD_RAD
        spread[0, 3:] = BASE_POSITION_SD_M
        errors = rng.normal(size=spread.shape) * spread
        joints = rng.uniform(*JOINT_COMPLIANCE_RAD_PER_NM, size=count)
        base = rng.uniform(*BASE_COMPLIANCE_RAD_PER_NM)
        return cls(
            Deviations.named(count, {}),
            tuple(_short(row) for row in errors),
            float(np.round(base, 6)),
            _short(joints),
            effects,
        )


def _short(values: Array) -> Components:
    """Rounded to micrometres and microradians, so that files are the same on every machine."""
    return tuple(float(value) for value in np.round(values, 6))
