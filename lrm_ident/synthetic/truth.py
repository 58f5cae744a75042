"""What is wrong with the synthetic arm: errors of geometry, compliances, hidden effects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from .hidden import Effect
from .rig import Rig
from .screws import Array

LINK_KEYS = ("theta_rad", "d_m", "a_m", "alpha_rad", "extra_z_m")
PLACEMENT_KEYS = ("x_m", "y_m", "z_m", "alpha_rad", "beta_rad", "gamma_rad")
Six = tuple[float, float, float, float, float, float]
NOTHING: Six = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

ANGLE_SD_RAD = 0.02
LENGTH_SD_M = 0.0015
PLACE_SD_M = 0.003
BASE_COMPLIANCE_RAD_PER_NM = (0.015, 0.025)
JOINT_COMPLIANCE_RAD_PER_NM = (0.05, 0.13)


@dataclass(frozen=True)
class Deviations:
    """Corrections of the described lengths (m) and angles (rad).

    links: one row per link, in the order of LINK_KEYS; base and tool: in the order of PLACEMENT_KEYS.
    """

    links: tuple[tuple[float, float, float, float, float], ...]
    base: Six = NOTHING
    tool: Six = NOTHING

    @classmethod
    def named(cls, joints: int, values: Mapping[str, float]) -> Deviations:
        """From names such as "joint2.theta_rad", "base.x_m" or "tool.gamma_rad"; what is not named is zero."""
        left = dict(values)

        def take(place: str, keys: tuple[str, ...]) -> list[float]:
            return [float(left.pop(f"{place}.{key}", 0.0)) for key in keys]

        rows = [take(f"joint{number}", LINK_KEYS) for number in range(1, joints + 1)]
        base, tool = take("base", PLACEMENT_KEYS), take("tool", PLACEMENT_KEYS)
        if left:
            raise ValueError(f"unknown deviations: {sorted(left)}")
        return cls(tuple((r[0], r[1], r[2], r[3], r[4]) for r in rows), _six(base), _six(tool))


@dataclass(frozen=True)
class Truth:
    """The true arm.

    displacements: N + 2 rigid displacements of the base, each link and the tool with all that hangs on them: rotation
    vector in rad about the origin of the frame they hang on (the base: its own), then shift in m; in world axes at
    zero configuration. They come on top of the deviations.
    """

    deviations: Deviations
    displacements: tuple[Six, ...]
    base_compliance_rad_per_nm: float
    joint_compliance_rad_per_nm: tuple[float, ...]
    effects: tuple[Effect, ...] = ()

    @classmethod
    def nominal(cls, rig: Rig) -> Truth:
        """The rigid arm exactly as described."""
        count = len(rig.links)
        return cls(Deviations.named(count, {}), (NOTHING,) * (count + 2), 0.0, (0.0,) * count)

    @classmethod
    def random(cls, rig: Rig, seed: int, effects: tuple[Effect, ...] = ()) -> Truth:
        """Plausible errors: every body misplaced in all six directions, and random compliances."""
        rng = np.random.default_rng(seed)
        count = len(rig.links)
        spread = np.full((count + 2, 6), LENGTH_SD_M)
        spread[:, :3] = ANGLE_SD_RAD
        spread[0, 3:] = PLACE_SD_M
        errors = rng.normal(size=spread.shape) * spread
        soft = rng.uniform(*JOINT_COMPLIANCE_RAD_PER_NM, size=count)
        base = rng.uniform(*BASE_COMPLIANCE_RAD_PER_NM)
        return cls(
            Deviations.named(count, {}),
            tuple(_six(_short(row)) for row in errors),
            float(np.round(base, 6)),
            tuple(_short(soft)),
            effects,
        )


def _short(values: Array) -> list[float]:
    """Micrometres and microradians are enough, and they make the same file on every machine."""
    return [float(value) for value in np.round(values, 6)]


def _six(v: list[float]) -> Six:
    a, b, c, d, e, f = v
    return a, b, c, d, e, f
