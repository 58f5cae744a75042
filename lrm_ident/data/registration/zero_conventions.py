"""Zeros of a recording that are not those of the arm's file, and how to read its angles so.

LeRobot counted SO arms from the arm stretched out level until 2025 (pull request 777), and counts every joint from the
middle of its range since; a URDF counts from wherever its author drew it. Angles far beyond an arm's limits that all
fall within them by one of these rules are read by it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from lrm_ident.data.wording import joint_labels
from lrm_math.arm.arm import Arm
from lrm_math.arm.standing import FAR, beyond_limits
from lrm_math.arrays import Array

BEYOND = float(np.radians(2.0))
"""rad beyond a limit: play and a calibration by hand stay below."""
FULL_TURN = 2.0 * np.pi
EXTENDED = {"shoulder_lift": (-1.0, np.pi / 2.0), "elbow_flex": (1.0, -np.pi / 2.0)}
"""Sign, and what is added (rad), from the zeros of the arm that is stretched out level to the middles of the ranges."""


@dataclass(frozen=True, eq=False)
class ZeroConvention:
    """A rule by which angles are read: sign times what was recorded, and what is added (n,), rad.

    `words`: what the zeros of the recording are.
    """

    words: str
    sign: Array
    added: Array

    def applied(self, angles: Array) -> Array:
        """(N, n), the angles as the arm's file counts them (rad)."""
        return self.sign * angles + self.added

    def formula(self, arm: Arm) -> str:
        """How the angles of the arm's file follow from those recorded, joint by joint, where they are others."""
        each = zip(joint_labels(arm), self.sign, np.degrees(self.added), strict=True)
        changed = [
            (name, "" if sign > 0 else "-", added) for name, sign, added in each if sign < 0 or abs(added) > 0.01
        ]
        return ", ".join(f"{name} = {sign}recorded {added:+.4g} deg" for name, sign, added in changed)

    def then(self, after: ZeroConvention) -> ZeroConvention:
        """This rule, and another one on its result."""
        return ZeroConvention(self.words, after.sign * self.sign, after.sign * self.added + after.added)


def conventions(arm: Arm) -> Iterator[ZeroConvention]:
    """The rules that an arm's joints may be read by, the likelier first.

    An arm's file whose ranges are not about zero counts from elsewhere than LeRobot does.
    """
    names = [joint.name for joint in arm.joints]
    ends = np.array([(joint.lower, joint.upper) for joint in arm.joints])
    whole = np.ptp(ends, axis=1) >= FULL_TURN - BEYOND
    middle = np.where(whole, 0.0, ends.mean(axis=1))
    elsewhere = np.abs(middle).max() > FAR
    centred = ZeroConvention("the middle of each joint's range (LeRobot)", np.ones(arm.dof), middle)
    if elsewhere:
        yield centred
    if set(EXTENDED) <= {*names}:
        sign, added = np.array([EXTENDED.get(str(name), (1.0, 0.0)) for name in names]).T
        extended = ZeroConvention("the arm stretched out level (LeRobot before June 2025)", sign, added)
        yield extended.then(centred) if elsewhere else extended


def convention_of(arm: Arm, angles: Array) -> ZeroConvention | None:
    """The rule by which angles (N, n), rad, are those of the arm; None where they are as they stand, or by no rule."""
    if not _beyond(arm, angles) > FAR:
        return None
    return next((rule for rule in conventions(arm) if _beyond(arm, rule.applied(angles)) <= BEYOND), None)


def _beyond(arm: Arm, angles: Array) -> float:
    """How far angles are beyond the limits at most (rad), each taken by whole turns to where it is within them."""
    read = angles[np.isfinite(angles).all(axis=1)]
    if not len(read):
        return 0.0
    turns = [beyond_limits(arm, at) for at in (read, read + FULL_TURN, read - FULL_TURN)]
    return float(np.minimum.reduce(turns).max())
