"""Creep: what gives way slowly under a load that is held, and comes back slowly (standard linear solid)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property, lru_cache, partial
from typing import ClassVar

import numpy as np

from lrm_math.arm.arm import BASE, Arm
from lrm_math.arrays import Array
from lrm_math.effects.base import Amounts, Description, Extrapolation, Parameter
from lrm_math.effects.memory.effect_with_memory import EffectWithMemory
from lrm_math.kinematics.chain import Number, chain_of
from lrm_math.kinematics.dual import Dual
from lrm_math.kinematics.history import Visits, differentiable, first_order_lag, lag_state
from lrm_math.kinematics.poses import Poses

LONG_S = 1e5
"""Longer than any wait, and than any memory."""
CONSTANTS_S = (15.0, 30.0, 60.0, 120.0, 240.0, 480.0, 960.0, 1920.0)
"""A memory with one of them explains nearly all that one between two of them does."""
PACES_S = {"fast": (8.0, 20.0, 50.0, 120.0), "slow": (200.0, 450.0, 1000.0, 2200.0)}
"""Constants of two memories at once."""
USUAL_WAITS_S, USUAL_RESTS_S = (0.0, 30.0), (0.0, 300.0)
"""Ranges that give the uncertainty of waits of which nothing else is known."""
SHARES = (0.0, 0.5, 1.0)
EVEN = 0.05
"""Share by which steps of time may differ and still be equal ones."""


class _SlowSpring(EffectWithMemory):
    """Deflection of a joint or of the base that lags behind the load that was held at the poses before."""

    extrapolation = Extrapolation.PROPORTIONAL
    paces: ClassVar[tuple[str, ...]] = ("",)
    """Names of the paces at which it lags behind."""

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

    @property
    def memories(self) -> int:
        """One of each motion at each pace."""
        return len(self.paces) * len(self.targets)

    @property
    def axes(self) -> tuple[str, ...]:
        """Suffix of the parameters of each motion."""
        return ("_x", "_y") if self.place == BASE else ("",)

    def shapes_to_try(self, poses: Poses) -> dict[str, tuple[float, ...]]:
        """Time constants; whether the arm hung unloaded before; and, where the times between poses differ, where it
        waited: before a move or after it. With equal times the two differ by a spring only."""
        scans = {p.name: p.scan for p in self.parameters if p.scan and p.name != "stood_s"}
        even_steps = poses.history is None or _even(poses.history.visits.step)
        return {name: scan for name, scan in scans.items() if name != "late_s_per_s" or not even_steps}

    def yielded(
        self,
        poses: Poses,
        tau: Amounts,
        k: Sequence[float],
        constant: Number,
        stood: Number,
        rest: Number,
        late: Number,
        pace: int = 0,
    ) -> list[Number]:
        """k c of each motion; where nobody knows what was before, the load has been held for long: k τ. `pace`: number
        of this one among those of the effect."""
        if poses.history is None:
            return [a * load for a, load in zip(k, tau, strict=True)]
        shapes, out = (constant, stood, rest, late), list[Number]()
        for motion, (a, load) in enumerate(zip(k, tau, strict=True)):
            if isinstance(a, Dual) or a:
                lag = partial(_lag, self, poses.history.visits, pace, motion)
                past, held_now = map(poses.history.own, differentiable(lag, *shapes))
                out.append(a * (past + held_now * load))
            else:
                out.append(0.0)
        return out

    def lagging(
        self, visits: Visits, constant: float, stood: float, rest: float, late: float, pace: int = 0
    ) -> tuple[Array, ...]:
        """(M,) for each motion: the load c that its deflection has reached at the end of each visit (N·m)."""
        held = visits.loads(chain_of(self.arm), self.load_slots)
        starts = self._began(visits, pace)
        return tuple(lag_state(visits, x, c, constant, stood, rest, late) for x, c in zip(held.T, starts, strict=True))

    def _began(self, visits: Visits, pace: int) -> tuple[float, ...]:
        """The same of one pace before the first visit."""
        size = len(self.targets)
        return self.began(visits)[pace * size : (pace + 1) * size]


@lru_cache(maxsize=16)  # an equilibrium asks again at every iteration, a fit that holds the shapes at every step
def _lag(effect: _SlowSpring, visits: Visits, pace: int, motion: int, *shapes: complex) -> tuple[Array, Array]:
    """`first_order_lag` of one motion at one pace of an effect, at all visits."""
    held = visits.loads(chain_of(effect.arm), effect.load_slots)[:, motion]
    return first_order_lag(visits, held, effect._began(visits, pace)[motion], *shapes)


STOOD = Parameter(
    "stood_s", "longest time at a pose before it was measured", 30.0, 0.0, fixed=LONG_S, scan=USUAL_WAITS_S
)
REST = Parameter("rest_s", "time under load before the first pose", 120.0, 0.0, fixed=LONG_S, scan=USUAL_RESTS_S)
LATE = Parameter(
    "late_s_per_s", "share of the time between poses before the move", 0.3, 0.0, 1.0, fixed=0.0, scan=SHARES
)


class Creep(_SlowSpring):
    """Creep of a joint or of the base: deflection that lags behind the load that was held at the poses before."""

    id = "creep"
    about = Description(
        cause="Plastic under a load yields slowly, and recovers slowly when the load is gone.",
        formula="δ = k c, T dc/dt = τ − c, beside the spring that yields at once",
        source="standard linear solid: Findley, Lai & Onaran 1976; Christensen 1982",
        claim="{place} creeps under a load that is held, with a time constant of {T_s}",
        needs="the measured order, best with times (t_s), and loads that do not run with it",
    )

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Compliance of each motion in the long run; the time constant; the time at a pose before it was measured."""
        return (
            *(Parameter(f"k{axis}_rad_per_Nm", "compliance that yields slowly", 0.03, lower=0.0) for axis in self.axes),
            Parameter("T_s", "time constant", 120.0, 1.0, fixed=120.0, scan=CONSTANTS_S),
            STOOD,
            REST,
            LATE,
        )

    def shapes_to_try(self, poses: Poses) -> dict[str, tuple[float, ...]]:
        """As every slow spring; before the first pose it hung unloaded, or had been loaded for long."""
        scans = super().shapes_to_try(poses)
        return scans | {"rest_s": (0.0, LONG_S)}

    def amounts(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        """k c."""
        *k, constant, stood, rest, late = p
        return tuple(self.yielded(poses, tau, k, constant, stood, rest, late))

    def memory(self, visits: Visits, p: Sequence[float]) -> tuple[Array, ...]:
        """c of each motion (N·m)."""
        constant, stood, rest, late = p[-4:]
        return self.lagging(visits, constant, stood, rest, late)


class CreepSpectrum(_SlowSpring):
    """Creep at several paces at once, as polymers have: two more beside that of the plain creep."""

    id = "creep_spectrum"
    variant_of = (Creep.id,)
    paces = tuple(PACES_S)
    about = Description(
        cause="A polymer yields at many paces at once, from seconds to hours.",
        formula="δ = Σ k_i c_i, T_i dc_i/dt = τ − c_i, a fast and a slow one",
        source="Prony series of the generalised Kelvin-Voigt solid: Findley, Lai & Onaran 1976",
        claim="{place} creeps at several paces at once, {T_fast_s} and {T_slow_s}",
        needs="what creep needs, over longer",
    )

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Compliance of each motion at each pace, beside that of the plain creep; the time constants;
        the share of the time between poses before the move."""
        return (
            *(
                Parameter(f"k_{pace}{axis}_rad_per_Nm", f"compliance that yields at the {pace} pace", 0.03, lower=0.0)
                for pace in PACES_S
                for axis in self.axes
            ),
            *(
                Parameter(f"T_{pace}_s", f"time constant of the {pace} pace", some[1], 1.0, fixed=some[1], scan=some)
                for pace, some in PACES_S.items()
            ),
            LATE,
        )

    def amounts(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        """Σ k_i c_i."""
        size = len(self.targets)
        *k, fast, slow, late = p
        first, other = (
            self.yielded(poses, tau, some, constant, LONG_S, LONG_S, late, pace)
            for pace, (some, constant) in enumerate(((k[:size], fast), (k[size:], slow)))
        )
        return tuple(a + b for a, b in zip(first, other, strict=True))

    def memory(self, visits: Visits, p: Sequence[float]) -> tuple[Array, ...]:
        """c of each motion at each pace (N·m)."""
        fast, slow, late = p[-3:]
        first, other = (self.lagging(visits, x, LONG_S, LONG_S, late, pace) for pace, x in enumerate((fast, slow)))
        return (*first, *other)


def _even(step: Array) -> bool:
    waits = step[step > 0.0]
    return not len(waits) or float(np.ptp(waits)) <= EVEN * float(waits.mean())
