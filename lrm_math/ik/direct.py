"""The direct method: solve for the true joint angles, then for the commands that produce them."""

from __future__ import annotations

from dataclasses import dataclass

from lrm_math.ik.branch import IkSolutions
from lrm_math.ik.calibrated_arm import CalibratedArm, commands
from lrm_math.ik.goal import IkQuery


@dataclass(frozen=True)
class Direct:
    """Newton's method on the deflected arm from many seeds; commands follow from its loads."""

    name: str = "direct"

    def find(self, arm: CalibratedArm, query: IkQuery) -> IkSolutions | None:
        """All branches, or commands nearest to `near`; None if no seed leads to the goal."""
        return commands(arm, query)
