"""Slip: a screwed joint whose zero moves a little at every reversal under load, as far as its screw lets it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lrm_math.arrays import Array
from lrm_math.effects.base import FEW_REVERSALS, Amounts, Description, Excitation, Extrapolation, JointEffect, Parameter
from lrm_math.effects.memory.effect_with_memory import EffectWithMemory
from lrm_math.kinematics.chain import Number, chain_of
from lrm_math.kinematics.history import Visits, differentiable
from lrm_math.kinematics.poses import Poses

SHARES = (1.0, 3.0, 10.0, 30.0, 100.0)
"""Loads that slip 63 % of the way at one reversal, over the usual load: about the reversals to its bound."""


class Slip(EffectWithMemory, JointEffect):
    """Zero of a joint that slips towards its load at every reversal, to a bound: tight when the data begin."""

    id = "slip"
    memories = 2
    extrapolation = Extrapolation.PROPORTIONAL
    about = Description(
        cause="A horn or a clamp that is not tight slips a little whenever its joint reverses under load.",
        formula="δq = b z; at each reversal z moves towards the side of τ by 1 − exp(−|τ|/τ0) of the way",
        source="self-loosening under reversals (Junker 1969), as far as the clearance goes",
        claim="{place} slips by up to {b_rad:|} at reversals under load",
        needs="the measured order, and a joint that reverses often under load",
    )
    parameters = (
        Parameter("b_rad", "bound of the slip to either side", 0.02),
        Parameter(
            "tau0_Nm", "load that slips 63 % of the way at one reversal", 3.0, 1e-3, fixed=3.0, scan=(0.1, 100.0)
        ),
    )

    def shapes_to_try(self, poses: Poses) -> dict[str, tuple[float, ...]]:
        """Multiples of the usual load."""
        usual = 0.0 if poses.history is None else float(np.median(np.abs(self._loads(poses.history.visits))))
        return {"tau0_Nm": tuple(usual * share for share in SHARES)} if usual else {}

    def amounts(self, poses: Poses, tau: Amounts, p: Sequence[float]) -> Amounts:
        """b z; as when it was tight, of a joint of which nobody knows what it did."""
        if poses.history is None:
            return (0.0,)
        visits = poses.history.visits
        (slipped,) = differentiable(lambda scale: (self._slipped(visits, scale),), p[1])
        z: Number = poses.history.own(slipped)
        return (p[0] * z,)

    def memory(self, visits: Visits, p: Sequence[float]) -> tuple[Array, ...]:
        """z, and the side of the joint's last move (−1, 0 unknown, +1)."""
        return self._slipped(visits, p[1]), visits.sides(self.joint, self.began(visits)[1])

    def when_powered(
        self, stood: Sequence[float], mean: Sequence[float], sd: Sequence[float]
    ) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """What slipped stays, with power and without."""
        del stood
        return tuple(mean), tuple(sd)

    def _slipped(self, visits: Visits, scale: complex) -> Array:
        """(M,), z at all visits."""
        load, (z, side) = self._loads(visits), self.began(visits)
        sides = visits.sides(self.joint, side)
        turned = sides * np.append(side, sides[:-1]) < 0.0
        kept, out = np.where(turned, np.exp(-np.abs(load) / scale), 1.0), []
        for left, towards in zip(kept.tolist(), np.sign(load).tolist(), strict=True):
            z = towards + left * (z - towards)
            out.append(z)
        return np.array(out)

    def _loads(self, visits: Visits) -> Array:
        """(M,), torque at all visits (N·m)."""
        return visits.loads(chain_of(self.arm), self.targets)[:, 0]

    def missing_excitation(self, excitation: Excitation) -> str | None:
        """The order must be known, and the joint must reverse."""
        if excitation.poses.history is None:
            return "the order of measurement is not known"
        if excitation.reversals(self.joint) < FEW_REVERSALS:
            return "the joint hardly ever reverses"
        return None
