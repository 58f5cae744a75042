"""Joint angles to command so that a calibrated arm's tip arrives where that of the arm as drawn would."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from lrm_math.arm.arm import BASE, TOOL
from lrm_math.arrays import Array
from lrm_math.effects import compensable
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.derivatives import joint_jacobian
from lrm_math.model.equilibrium import equilibrium
from lrm_math.model.model import Model, model_of
from lrm_math.model.model_file import load_model

STEPS = 8
ARRIVED = 1e-6  # m
DAMPING = 1e-3  # m/rad: at singular poses the joints hardly move


@dataclass(frozen=True, eq=False)
class Compensation:
    """Commands for a calibrated arm; `payload` (kg) is what the tool carries."""

    model: Model
    payload: float = 0.0

    @classmethod
    def of_file(cls, path: str | Path, payload_g: float = 0.0) -> Compensation:
        """Of a model file. Its base and tool are taken as drawn, and effects that only a measurement has are left out.

        Raises `FileError`.
        """
        fitted = load_model(path)
        kept = [effect for effect in fitted.effects if compensable(effect) and effect.place not in (BASE, TOOL)]
        known = {key: fitted.value(key) for effect in kept for key in effect.keys}
        return cls(model_of(fitted.arm, kept, known), payload_g * 1e-3)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints, those of the robot's own description where the arm file has them."""
        return tuple(joint.name or f"joint{i}" for i, joint in enumerate(self.model.arm.joints, start=1))

    @cached_property
    def _drawn(self) -> Model:
        return model_of(self.model.arm, ())

    @cached_property
    def _limits(self) -> Array:
        """(2, n), rad."""
        return np.array([(joint.lower, joint.upper) for joint in self.model.arm.joints]).T

    def command(self, desired: Sequence[float]) -> Array:
        """(n,), angles to command (rad) for desired ones (n,): damped least squares on the tip (Wampler 1986)."""
        low, high = self._limits
        q = np.clip(np.asarray(desired, dtype=np.float64), low, high)
        goal = equilibrium(self._drawn, poses_of(q)).tcp[0]
        for _ in range(STEPS):
            rest = equilibrium(self.model, poses_of(q, self.payload))
            left = goal - rest.tcp[0]
            if float(np.linalg.norm(left)) < ARRIVED:
                break
            J = joint_jacobian(rest)[0]
            free = ~(((q <= low) & (J.T @ left < 0)) | ((q >= high) & (J.T @ left > 0)))
            J = J * free
            q = np.clip(q + J.T @ np.linalg.solve(J @ J.T + DAMPING**2 * np.eye(3), left), low, high)
        return q
