"""Creep: what gives way slowly under a load that is held, and comes back slowly (standard linear solid)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from lrm_math.arm.arm import BASE, Arm
from lrm_math.arrays import Array
from lrm_math.effects.base import Amounts, Description, Effect, Excitation, Extrapolation, Parameter
from lrm_math.kinematics.chain import Number, chain_of
from lrm_math.kinematics.dual import Dual
from lrm_math.kinematics.history import followed
from lrm_math.kinematics.poses import Poses

LONG_S = 1e5
"""Longer than any wait, and than any memory."""
CONSTANTS_S = (15.0, 30.0, 60.0, 120.0, 240.0, 480.0, 960.0, 1920.0)
"""A memory with one of them explains nearly all that one between two of them does."""
USUAL_WAITS_S, USUAL_RESTS_S = (0.0, 30.0), (0.0, 300.0)
"""Ranges that give the uncertainty of waits of which nothing else is known."""
EVEN = 0.05
"""Share by which steps of time may differ and still be equal ones."""


class Creep(Effect):
    """Creep of a joint or of the base: deflection that lags behind the load that was held at the poses before."""

    id = "creep"
    depends_on = ("time",)
    remembers = True
    extrapolation = Extrapolation.PROPORTIONAL
    about = Description(
        cause="Plastic under a load yields slowly, and recovers slowly when the load is gone.",
        formula="δ = k c, T dc/dt = τ − c, beside the spring that yields at once",
        source="standard linear solid: Findley, Lai & Onaran 1976; Christensen 1982",
        claim="{place} creeps under a load that is held, with a time constant of {T_s}",
        needs="the measured order, best with times (t_s), and loads that do not run with it",
    )

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """Every joint, and the base."""
        return (*arm.joint_names, BASE)

    @property
    def targets(self) -> tuple[str, ...]:
        """The joint's angle, or the base's tilts."""
        return (f"{BASE}.alpha", f"{BASE}.beta") if self.place == BASE else (f"{self.place}.theta",)

    @property
    def load_slots(self) -> tuple[str, ...]:
        """The loads on the slots that it moves."""
        return self.targets

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Compliance of each motion in the long run; the time constant; the time at a pose before it was measured."""
        axes = ("_x", "_y") if self.place == BASE else ("",)
        return (
            *(Parameter(f"k{axis}_rad_per_Nm", "compliance that yields slowly", 0.03, lower=0.0) for axis in axes),
            Parameter("T_s", "time constant", 120.0, 1.0, fixed=120.0, scan=CONSTANTS_S),
            Parameter("stood_s", "time at a pose before it was measured", 30.0, 0.0, fixed=LONG_S, scan=USUAL_WAITS_S),
            Parameter("rest_s", "time under load before the first pose", 120.0, 0.0, fixed=LONG_S, scan=USUAL_RESTS_S),
        )

    def shapes_to_try(self, poses: Poses) -> dict[str, tuple[float, ...]]:
        """Time constants; whether the arm hung unloaded before; and, where the times between poses differ, where it
        waited: before a move or after it. With equal times the two differ by a spring only."""
        found = {"T_s": CONSTANTS_S, "rest_s": (0.0, LONG_S)}
        return (
            found if poses.history is None or _even(poses.history.visits.step) else found | {"stood_s": (0.0, LONG_S)}
        )

    def amounts(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        """k c; where nobody knows what was before, the load has been held for long: k τ."""
        *k, constant, stood, rest = p
        if poses.history is None:
            return tuple(a * load for a, load in zip(k, tau, strict=True))
        held = poses.history.visits.loads(chain_of(self.arm), self.load_slots)
        out: list[Number] = []
        for a, load, borne in zip(k, tau, held.T, strict=True):
            past, own = (
                followed(poses.history, borne, constant, stood, rest) if isinstance(a, Dual) or a else (0.0, 0.0)
            )
            out.append(a * (past + own * load))
        return tuple(out)

    def missing_excitation(self, excitation: Excitation) -> str | None:
        """The order must be known."""
        return "the order of measurement is not known" if excitation.poses.history is None else None


def _even(step: Array) -> bool:
    waits = step[step > 0.0]
    return not len(waits) or float(np.ptp(waits)) <= EVEN * float(waits.mean())
