"""The contract of an effect: a physical cause that, from parameters, adds small amounts to slots of the chain.

An effect acts at one place of one arm. It names its targets (mostly slots of the chain), the slots whose load enters
its formula, and its parameters; one function is its physics. Prediction, derivatives through the equilibrium and the
fit follow from these.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from string import Formatter
from typing import ClassVar

import numpy as np

from lrm_math.arm.arm import Arm
from lrm_math.arm.place_names import joint_number, place_words
from lrm_math.arrays import Array
from lrm_math.effects.measured_range import MeasuredRange
from lrm_math.effects.reference import EffectRef, ParameterRef
from lrm_math.errors import LrmError
from lrm_math.kinematics.chain import Number
from lrm_math.kinematics.poses import Poses
from lrm_math.kinematics.scalar_or_array import linear_combination
from lrm_math.plausibility import FAR, PlausibleEstimate

UNIT_IN_SI = {
    "rad": 1.0,
    "mm": 1e-3,
    "g": 1e-3,
    "s": 1.0,
    "s_per_s": 1.0,
    "pose": 1.0,
    "per_turn": 1.0,
    "Hz": 1.0,
    "N": 1.0,
    "Nm": 1.0,
    "rad_per_Nm": 1.0,
    "rad_per_Nm2": 1.0,
    "rad_per_Nm3": 1.0,
    "rad_per_rad": 1.0,
    "rad_per_s": 1.0,
    "rad_per_s2": 1.0,
    "ratio": 1.0,
    "rad_per_rad_per_Nm2": 1.0,
    "rad_per_K": 1.0,
    "mm_per_K": 1e-3,
    "Nm_per_rad": 1.0,
    "mm_per_m": 1e-3,
    "mm_per_m2": 1e-3,
    "mm_per_m_per_K": 1e-3,
    "mm_per_m3": 1e-3,
}
Amounts = tuple[Number, ...]
FEW_REVERSALS = 4


@dataclass(frozen=True)
class Parameter:
    """One parameter that can be identified: its name with unit, what it means, its size and bounds in SI.

    `typical`: the size expected before measuring, used to scale the fit. `fixed`: the value of a shape parameter,
    which is not fitted unless it is named; None for all others, whose value is 0 when not given. `scan`: values of a
    shape parameter to try where none is known. `usual`, `largest`: sizes that are usual on real arms, and the largest
    that is physically plausible (SI); None: twice and `FAR` times the typical one.
    """

    name: str
    meaning: str
    typical: float
    lower: float = -np.inf
    upper: float = np.inf
    fixed: float | None = None
    scan: tuple[float, ...] = ()
    usual: float | None = None
    largest: float | None = None

    @property
    def plausible(self) -> PlausibleEstimate:
        """The sizes that an estimate of it may have."""
        usual = 2.0 * self.typical if self.usual is None else self.usual
        return PlausibleEstimate(usual, max(usual, FAR * self.typical if self.largest is None else self.largest))

    @property
    def unit(self) -> str:
        """The unit in the name, for instance `rad_per_Nm`. Raises `LrmError` for a name without one."""
        units = [unit for unit in UNIT_IN_SI if self.name.endswith("_" + unit)]
        if not units:
            raise LrmError(f"parameter '{self.name}': its name must end in its unit, one of {', '.join(UNIT_IN_SI)}")
        return max(units, key=len)

    @property
    def symbol(self) -> str:
        """The name without its unit."""
        return self.name.removesuffix(f"_{self.unit}")

    @property
    def si(self) -> float:
        """Factor from the file's unit to SI."""
        return UNIT_IN_SI[self.unit]

    @property
    def default(self) -> float:
        """The value when none is given (SI)."""
        return 0.0 if self.fixed is None else self.fixed


@dataclass(frozen=True, eq=False)
class Excitation:
    """Excitation of effects: the poses, and gravity's torque (N, n) on the joints at them (N·m).

    `measured`: names of what is measured (`lrm_math.model.sensed`).
    """

    poses: Poses
    torque: Array
    measured: frozenset[str] = frozenset()

    @cached_property
    def _levels(self) -> tuple[int, ...]:
        return tuple(len(np.unique(angle)) for angle in np.round(np.degrees(self.poses.q.T) / 0.5))

    def levels(self, joint: int) -> int:
        """Number of different angles (to 0.5°) of a joint."""
        return self._levels[joint]

    def reversals(self, joint: int) -> int:
        """Number of reversals of a joint between poses; 0 if the order is not known."""
        if self.poses.direction is None:
            return 0
        moves = self.poses.direction[:, joint]
        return int(np.count_nonzero(np.diff(moves[moves != 0])))

    def both_signs(self, values: Array) -> bool:
        """Whether at least a twentieth of the values lies on either side of zero."""
        least = max(1.0, len(values) / 20)
        return bool(np.count_nonzero(values > 0) >= least and np.count_nonzero(values < 0) >= least)


class _Estimate(str):
    """An estimate in words whose sign a claim may say in words: `{g:too far|too little}`."""

    def __format__(self, signs: str) -> str:
        if not signs:
            return str(self)
        positive, _, negative = signs.partition("|")
        return f"{self.removeprefix('-')} {negative if self.startswith('-') else positive}".rstrip()


@dataclass(frozen=True)
class Description:
    """Texts of reports about an effect.

    Attributes:
        cause: the physics, a sentence. formula: as in a textbook. source: where it is from.
        claim: a sentence that reports it, with the parameters' names in braces: `{place} has {b_rad} of play`. Words
            for a positive and a negative estimate may follow a name: `{place} turns {g:too far|too little}`.
        needs: the measurements that can show it.
    """

    cause: str
    formula: str
    source: str
    claim: str = ""
    needs: str = ""

    @property
    def claimed(self) -> frozenset[str]:
        """Names in braces in the claim: parameters, whose estimates it states, and the place."""
        return frozenset(name for _, name, *_ in Formatter().parse(self.claim) if name)

    def sized(self, name: str, estimate: str) -> str:
        """An estimate with its sign in the words of the claim; where that has none for it, the size alone."""
        signs = (spec for _, field, spec, _ in Formatter().parse(self.claim) if field == name and spec)
        return format(_Estimate(estimate), next(signs, "|"))

    def claimed_with(self, place: str, estimates: Mapping[str, str]) -> str:
        """The claim about a place, with the estimates in words by the names of their parameters."""
        return self.claim.format(place=place, **{name: _Estimate(words) for name, words in estimates.items()})


class ModelPart(Enum):
    """Part of a calibrated arm that an effect belongs to, which decides where its estimate holds."""

    ARM = "arm"
    """True wherever the arm is mounted: its links, gears and servos."""
    INSTALLATION = "installation"
    """True while the arm stays bolted where it is: its base, the direction of gravity, the mounted tool."""
    MEASUREMENT = "measurement"
    """True of one measurement: its tracker, its anchor."""


PART_OF_PLACE = {
    "base": ModelPart.INSTALLATION,
    "tool": ModelPart.INSTALLATION,
    "frame": ModelPart.MEASUREMENT,
    "distance": ModelPart.MEASUREMENT,
}
"""Part of the effects at a place; at all other places that of the arm."""


class Extrapolation(Enum):
    """Validity of an effect's formula beyond the range that it was fitted on.

    Amounts are those of any parameters. `HELD`: they stay what they are at the range's edge (`measured_range`).
    """

    HELD = "constant: a description of what was measured"
    PROPORTIONAL = "as stated, growing no faster than in proportion: a linear law, a saturation, a constant"
    PERIODIC = "as stated, the same after every turn"
    FADING = "to zero: it says nothing where nothing was measured"


@dataclass(frozen=True)
class Effect(ABC):
    """A physical cause at one `place` of one `arm`."""

    arm: Arm
    place: str

    id: ClassVar[str]
    """Name in snake case, as in model files."""
    about: ClassVar[Description]
    depends_on: ClassVar[tuple[str, ...]] = ("angle", "direction")
    """Quantities that its amounts vary with, beside loads: commanded `angle`, `direction` of the last move, `time` (and
    temperature), `session`, the measuring `instrument`, the `placement` of what is touched, `counts` of the servo
    board. Without any, and without loads, it is a constant."""
    variant_of: ClassVar[tuple[str, ...]] = ()
    """Ids of the effects of which this is another form, fitted beside them (`variants` gives their names); empty for an
    effect of its own."""

    remembers: ClassVar[bool] = False
    """Whether it follows the loads that were borne before a pose (`Poses.history`)."""
    names_a_cause: ClassVar[bool] = True
    """Whether it is physics. What is not is fitted last, on what the others leave, and no diagnosis looks at it."""
    extrapolation: ClassVar[Extrapolation] = Extrapolation.HELD
    """Continuation of its formula beyond the measured range. A law of physics says so; what says nothing is held."""

    @classmethod
    @abstractmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """Every place of this arm where the effect can act."""

    @property
    @abstractmethod
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters that may be fitted, in the order of `p`; a class attribute where all places have the same."""

    @property
    @abstractmethod
    def targets(self) -> tuple[str, ...]:
        """Targets of its amounts, mostly slots, `place.name`; all of one kind (`lrm_math.effects.targets`)."""

    @property
    def load_slots(self) -> tuple[str, ...]:
        """The slots whose load enters its amounts, in the order of `tau`."""
        return ()

    @abstractmethod
    def amounts(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        """The amount added to each target: rad or m of a slot, each a float or (N,).

        Args:
            poses: N commanded poses.
            tau: gravity's load on each of `load_slots`, N·m (N along a translation), each (N,).
            p: the parameters' values in SI.
        """

    def over(self, within: MeasuredRange | None) -> Effect:
        """The effect over the range of its fit, for one that fades: its functions may be stated by that range."""
        return self

    def shapes_to_try(self, poses: Poses) -> dict[str, tuple[float, ...]]:
        """Values, ascending, of each shape parameter that is searched at these poses, by its name."""
        return {parameter.name: parameter.scan for parameter in self.parameters if parameter.scan}

    @property
    def curves(self) -> tuple[tuple[str, ...], ...]:
        """Names of parameters that are neighbouring coefficients of one curve, for each curve: fits keep it smooth."""
        return ()

    def missing_excitation(self, excitation: Excitation) -> str | None:
        """Why the effect is not identifiable from these poses, or None if it may be."""
        return None

    @property
    def name(self) -> str:
        """`id@place`."""
        return str(EffectRef(self.id, self.place))

    @property
    def is_free_form(self) -> bool:
        """Whether it is a free form of other effects (`variant_of`), whose coefficients are no physical sizes."""
        return bool(self.variant_of)

    @property
    def part(self) -> ModelPart:
        """The part of a calibrated arm that it belongs to: by its place, where a class does not say otherwise."""
        return PART_OF_PLACE.get(self.place, ModelPart.ARM)

    @property
    def place_in_words(self) -> str:
        """Place of its action, for sentences: what a measurement shows may stand elsewhere, too."""
        return place_words(self.place)

    @cached_property
    def keys(self) -> tuple[str, ...]:
        """Names of its parameters in model files: `id.place.parameter`."""
        return tuple(str(ParameterRef(self.id, self.place, parameter.name)) for parameter in self.parameters)


class LinearEffect(Effect):
    """An effect that is linear in its parameters: it gives the basis instead of the amounts."""

    keeps_basis: ClassVar[bool] = True
    """Whether the basis at poses is kept for all iterates of a fit."""

    @abstractmethod
    def basis(self, poses: Poses, tau: Amounts) -> tuple[Amounts, ...]:
        """Amount per unit of each parameter, a float or (N,), at each target; arguments as of `amounts`."""

    def amounts(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        """Σ p_i f_i for each target."""
        return linear_combination(p, self.basis(poses, tau), len(self.targets))


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
    def targets(self) -> tuple[str, ...]:
        """The joint's angle."""
        return (f"{self.place}.theta",)


class AngleDependentEffect(JointEffect):
    """An effect on one joint that depends on the joint's commanded angle; three angles at least identify it."""

    depends_on = ("angle",)

    def missing_excitation(self, excitation: Excitation) -> str | None:
        """The joint must be measured at three or more angles."""
        levels = excitation.levels(self.joint)
        return None if levels >= 3 else f"it was measured at {levels} angles only"


class LoadedJointEffect(JointEffect):
    """An effect on one joint's angle that depends on the torque on it."""

    @property
    def load_slots(self) -> tuple[str, ...]:
        """The joint's torque."""
        return self.targets


def separately(functions: Sequence[Amounts]) -> tuple[Amounts, ...]:
    """The basis of targets with coefficients of their own: the functions of each target, in the order of targets."""
    targets = range(len(functions))
    return tuple(tuple(f if i == k else 0.0 for i in targets) for k in targets for f in functions[k])
