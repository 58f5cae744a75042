"""What an effect's amounts change by where a model goes back to that without its empirical terms (`Reversion`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from lrm_math.arm.arm import Arm
from lrm_math.effects.base import Amounts, Description, Effect, Extrapolation, Parameter
from lrm_math.effects.derivatives import amounts_within
from lrm_math.effects.measured_range import MeasuredRange
from lrm_math.effects.reversion import Reversion
from lrm_math.kinematics.poses import Poses


@dataclass(frozen=True, eq=False)
class ReversionCorrection(Effect):
    """The change of an effect's amounts by other parameters, as far as the empirical terms no longer hold.

    Attributes:
        effect: the effect. rows: numbers of those of its targets that change.
        here, away: its parameters within the range, and where nothing of the terms holds.
        within: the range of the fit.
    """

    effect: Effect
    rows: tuple[int, ...]
    here: tuple[float, ...]
    away: tuple[float, ...]
    within: MeasuredRange
    reversion: Reversion

    id = "returning"
    extrapolation = Extrapolation.PROPORTIONAL
    depends_on = ("angle", "direction")
    about = Description(
        cause="No cause: beyond the measured range an empirical term no longer holds.",
        formula="(1 − share) (f(p_away) − f(p_here))",
        source="Rasmussen & Williams 2006, section 2.2",
    )
    parameters: ClassVar[tuple[Parameter, ...]] = ()

    @classmethod
    def places(cls, arm: Arm) -> tuple[str, ...]:
        """None: it is made with a model that has a reversion."""
        return ()

    @property
    def targets(self) -> tuple[str, ...]:
        """Those of the effect that change."""
        return tuple(self.effect.targets[row] for row in self.rows)

    @property
    def load_slots(self) -> tuple[str, ...]:
        """Those of the effect."""
        return self.effect.load_slots

    def amounts(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        """Zero within the range."""
        gone = 1.0 - self.reversion.share(poses)
        if isinstance(gone, float | np.ndarray) and not np.any(gone):
            return (0.0,) * len(self.rows)
        here, away = (amounts_within(self.effect, poses, tau, q, self.within) for q in (self.here, self.away))
        return tuple(gone * (away[row] - here[row]) for row in self.rows)
