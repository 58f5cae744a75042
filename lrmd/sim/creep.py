"""Creep of the simulated arm: behind each servo a spring with a damper beside it, which yields slowly and comes back.

Kelvin-Voigt element (Findley, Lai & Onaran 1976): d dδ/dt + δ/k = τ with d = T/k, exact over a step of constant load.
It shares no code with the model's effects.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from lrm_math.errors import LrmError, UnknownName


@dataclass(frozen=True)
class JointCreep:
    """Compliance of a joint in the long run (rad/N·m), beside that of the truth, and its time constant (s)."""

    compliance: float
    constant: float

    def __post_init__(self) -> None:
        if not (0.0 <= self.compliance <= 1.0 and 0.1 <= self.constant <= 1e6):
            raise LrmError("creep of a joint: should have compliance 0 to 1 rad/(N m) and time constant 0.1 to 1e6 s")

    @staticmethod
    def parse(text: str) -> JointCreep:
        """`COMPLIANCE:SECONDS`. Raises `LrmError`."""
        try:
            numbers = [float(word) for word in text.split(":")]
        except ValueError:
            numbers = []
        if len(numbers) != 2:
            raise LrmError(f"creep '{text}': should be COMPLIANCE:SECONDS, in rad/(N m) and s")
        return JointCreep(*numbers)


class CreepingJoints:
    """Deflection of every joint (rad) as `deflection`, (n,); joints without creep stay rigid."""

    def __init__(self, names: Sequence[str], creeps: Mapping[str, JointCreep]) -> None:
        """`names`: of all joints. Raises `UnknownName`."""
        for name in creeps:
            if name not in names:
                raise UnknownName("joint of the simulated arm", name, names)
        self._creeps = [creeps.get(name) for name in names]
        self.deflection = [0.0] * len(names)

    def yield_to(self, torques: Sequence[float], seconds: float) -> None:
        """Torques (N·m) of all joints are borne for some time."""
        for i, (creep, torque) in enumerate(zip(self._creeps, torques, strict=True)):
            if creep is not None:
                short = creep.compliance * torque - self.deflection[i]
                self.deflection[i] -= math.expm1(-seconds / creep.constant) * short
