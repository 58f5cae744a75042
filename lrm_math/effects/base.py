"""The interface of an effect: a physical cause that, from parameters, adds small motions to slots of the chain.

An effect acts at one place of one arm. It names the slots of the chain that it moves, the slots whose load it feels,
and its parameters; `motion` is its physics. Prediction, derivatives through the equilibrium and the fit follow from
these. Derivatives are central differences of `motion` unless the effect gives them; their error is about 1e-9 of the
amount, and `motion` is a local formula that costs little.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import ClassVar, TypeVar

import numpy as np

from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.kinematics.chain import Number
from lrm_math.kinematics.poses import Poses
from lrm_math.kinematics.statics import WeightChange

UNIT_IN_SI = {
    "rad": 1.0,
    "mm": 1e-3,
    "g": 1e-3,
    "s": 1.0,
    "Hz": 1.0,
    "N": 1.0,
    "Nm": 1.0,
    "rad_per_Nm": 1.0,
    "rad_per_Nm2": 1.0,
    "rad_per_Nm3": 1.0,
    "rad_per_rad": 1.0,
    "rad_per_K": 1.0,
    "Nm_per_rad": 1.0,
    "mm_per_m": 1e-3,
}
Amounts = tuple[Number, ...]
N = TypeVar("N", float, Number)
FEW_REVERSALS = 4
STEP = 6e-6  # cube root of the machine epsilon: the best step of a central difference


@dataclass(frozen=True)
class Parameter:
    """One parameter that can be identified: its name with unit, what it means, its size and bounds in SI.

    `typical`: the size expected before measuring, used to scale the fit. `fixed`: the value of a shape parameter,
    which is not fitted unless it is named; None for all others, whose value is 0 when not given. `scan`: values of a
    shape parameter to try where none is known.
    """

    name: str
    meaning: str
    typical: float
    lower: float = -np.inf
    upper: float = np.inf
    fixed: float | None = None
    scan: tuple[float, ...] = ()

    @property
    def unit(self) -> str:
        """The unit in the name, for instance `rad_per_Nm`."""
        return max((unit for unit in UNIT_IN_SI if self.name.endswith("_" + unit)), key=len)

    @property
    def si(self) -> float:
        """What one of the file's unit is in SI."""
        return UNIT_IN_SI[self.unit]

    @property
    def default(self) -> float:
        """The value when none is given (SI)."""
        return 0.0 if self.fixed is None else self.fixed


@dataclass(frozen=True, eq=False)
class Excitation:
    """What excites effects: the poses, and gravity's torque (N, n) on the joints at them (N·m).

    `feedback`: whether the joints' encoders were read. `distance`: whether distances from a point were measured.
    """

    poses: Poses
    torque: Array
    feedback: bool = False
    distance: bool = False

    def levels(self, joint: int) -> int:
        """Number of different angles (to 0.5°) of a joint."""
        return len(np.unique(np.round(np.degrees(self.poses.q[:, joint]) / 0.5)))

    def reversals(self, joint: int) -> int:
        """How often a joint reversed its direction between poses; 0 if the order is not known."""
        if self.poses.direction is None:
            return 0
        moves = self.poses.direction[:, joint]
        return int(np.count_nonzero(np.diff(moves[moves != 0])))

    def both_signs(self, values: Array) -> bool:
        """Whether at least a twentieth of the values lies on either side of zero."""
        least = max(1.0, len(values) / 20)
        return bool(np.count_nonzero(values > 0) >= least and np.count_nonzero(values < 0) >= least)


@dataclass(frozen=True)
class Effect(ABC):
    """A physical cause at one `place` of one `arm`."""

    arm: Arm
    place: str

    id: ClassVar[str]
    cause: ClassVar[str]
    formula: ClassVar[str]
    source: ClassVar[str]
    needs: ClassVar[str] = ""
    refines: ClassVar[tuple[str, ...]] = ()
    """Ids of the effects of which this is another form, fitted beside them; empty for an effect of its own."""
    claim: ClassVar[str] = ""
    """A sentence that reports it, with the parameters' names in braces: `{place} has {b_rad} of play`."""
    online: ClassVar[bool] = True
    """Whether the rover can compensate it: it depends on angles, load and direction only."""
    instrument: ClassVar[bool] = False
    """Whether it only says where a measuring instrument stands: the arm moves as without it."""
    constant: ClassVar[bool] = False
    """Whether `motion` is the same whatever the pose, load and direction."""
    linear: ClassVar[bool] = False
    """Whether `motion` is proportional to the loads that it feels, and depends on nothing else."""
    geared: ClassVar[bool] = False
    """Whether `motion` is proportional to commanded angles, and depends on nothing else."""
    before_encoder: ClassVar[bool] = False
    """Whether the joint's encoder reads what it moves, where there is joint feedback."""
    follows_angles: ClassVar[bool] = True
    """Whether `motion` depends on the commanded angles themselves, not only on loads."""

    @classmethod
    @abstractmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """Every place of this arm where the effect can act."""

    @property
    @abstractmethod
    def parameters(self) -> tuple[Parameter, ...]:
        """What may be fitted, in the order of `p`; a class attribute where it is the same at all places."""

    @property
    def moves(self) -> tuple[str, ...]:
        """The slots that it moves, `place.name`."""
        return ()

    @property
    def refined(self) -> tuple[str, ...]:
        """The effects, `effect@place`, of which this is another form."""
        return tuple(f"{kind}@{self.place}" for kind in self.refines)

    @property
    def driver(self) -> str:
        """The one quantity that `motion` is a function of: `qN`, `tauN` or `t`; empty if there are several, or none."""
        return ""

    @property
    def bends_at_ends(self) -> tuple[str, ...]:
        """Links (`linkN`) of which it turns an end, `linkN.near_x` for instance, beside their middle."""
        return ()

    @property
    def feels(self) -> tuple[str, ...]:
        """The slots whose load enters `motion`, in the order of `tau`."""
        return ()

    def motion(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        """The amount added to each slot of `moves`: rad or m, each a float or (N,).

        Args:
            poses: N commanded poses.
            tau: gravity's load on each slot of `feels`, N·m (N along a translation), each (N,).
            p: the parameters' values in SI.
        """
        return ()

    @property
    def pushes(self) -> tuple[str, ...]:
        """The rotating slots on which it puts a load of its own, beside gravity's."""
        return ()

    def push(self, poses: Poses, p: Sequence[float]) -> Amounts:
        """The load added on each slot of `pushes`, N·m, each a float or (N,). Linear in p."""
        return ()

    @property
    def weighs(self) -> tuple[int, ...]:
        """Indices into `arm.bodies_outwards` of the bodies whose weight it changes."""
        return ()

    def weight(self, carried: Number, p: Sequence[float]) -> tuple[WeightChange, ...]:
        """What is added to each body of `weighs`, with a load of so many kg, float or (N,). Linear in p."""
        return ()

    def seen(self, tcp: Array, p: Sequence[float]) -> Array | None:
        """(N, 3): measurement error at the TCP positions (N, 3), m; None if there is none. Linear in both."""
        return None

    def anchor_shift(self, p: Sequence[float]) -> Array | None:
        """(3,): what it adds to the fixed point of measured distances, m; None if nothing. Linear in p."""
        return None

    def missing_excitation(self, excitation: Excitation) -> str | None:
        """Why the effect is not identifiable from these poses, or None if it may be."""
        return None

    def d_parameters(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> tuple[Amounts, ...]:
        """∂amount/∂p: for each parameter, one number or (N,) for each slot of `moves`."""
        steps = [STEP * parameter.typical for parameter in self.parameters]
        return tuple(
            _difference(self.motion(poses, tau, _changed(p, j, h)), self.motion(poses, tau, _changed(p, j, -h)), h)
            for j, h in enumerate(steps)
        )

    def d_tau(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> tuple[Amounts, ...]:
        """∂amount/∂tau: for each slot of `feels`, one number or (N,) for each slot of `moves`."""
        return tuple(
            _difference(
                self.motion(poses, _changed(tau, j, STEP), p), self.motion(poses, _changed(tau, j, -STEP), p), STEP
            )
            for j in range(len(tau))
        )

    def d_q(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> tuple[Amounts, ...]:
        """∂amount/∂q at fixed loads: for each joint, one number or (N,) for each slot of `moves`."""
        if not self.follows_angles:
            return ((0.0,) * len(self.moves),) * self.arm.dof
        sides = [(poses.perturbed(i, STEP), poses.perturbed(i, -STEP)) for i in range(self.arm.dof)]
        return tuple(_difference(self.motion(plus, tau, p), self.motion(minus, tau, p), STEP) for plus, minus in sides)


class JointEffect(Effect):
    """An effect on one joint's angle, at every joint."""

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """Every joint."""
        return arm.joint_names

    @cached_property
    def joint(self) -> int:
        """Number of the joint from 0."""
        return joint_number(self.place)

    @property
    def moves(self) -> tuple[str, ...]:
        """The joint's angle."""
        return (f"{self.place}.theta",)


class AngleDependentEffect(JointEffect):
    """An effect on one joint that depends on the joint's commanded angle; three angles at least identify it."""

    @property
    def driver(self) -> str:
        """The joint's angle."""
        return f"q{self.joint + 1}"

    def missing_excitation(self, excitation: Excitation) -> str | None:
        """The joint must be measured at three or more angles."""
        levels = excitation.levels(self.joint)
        return None if levels >= 3 else f"{self.place} stands at {levels} levels only"


class LoadedJointEffect(JointEffect):
    """An effect on one joint's angle that depends on the torque on it."""

    @property
    def driver(self) -> str:
        """The joint's torque."""
        return f"tau{self.joint + 1}"

    @property
    def feels(self) -> tuple[str, ...]:
        """The joint's torque."""
        return self.moves


def _changed(values: Sequence[N], j: int, step: float) -> tuple[N, ...]:
    return tuple(value + step if i == j else value for i, value in enumerate(values))


def _difference(plus: Amounts, minus: Amounts, h: float) -> Amounts:
    return tuple((b - a) / (2.0 * h) for a, b in zip(minus, plus, strict=True))


@lru_cache(maxsize=256)
def joint_number(place: str) -> int:
    """Number from 0 of `jointN`."""
    return int(place.removeprefix("joint")) - 1
