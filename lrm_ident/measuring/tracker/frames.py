"""Frames of any tracker: frames with the poses of numbered targets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from lrm_math.arrays import Array


@dataclass(frozen=True, eq=False)
class TargetPose:
    """Pose of a target in the room: position (3,) in m, rotation (3, 3), columns its axes; NaN: not known."""

    position: Array
    rotation: Array


@dataclass(frozen=True, eq=False)
class TrackerFrame:
    """One frame: its number and time (s) by the tracker's clock, and the targets that were seen, by their number."""

    number: int
    t: float
    targets: Mapping[int, TargetPose]


@dataclass(frozen=True)
class TargetNumbers:
    """The numbers of the target at the tip and of that at the base; no base: positions are in the arm's frame."""

    tool: int = 1
    base: int | None = 0


class Tracker(Protocol):
    """A source of frames; a context manager of what it has open."""

    def frames(self, seconds: float) -> Sequence[TrackerFrame]:
        """The frames of the next `seconds`, none from before. Raises `LrmError` if the source is gone for good."""


def tip_position(frame: TrackerFrame, numbers: TargetNumbers) -> Array | None:
    """(3,), tip in the frame of the base target (m): R_base^T (p_tool − p_base), Conenna 2024, section 6.1.

    None if a target was not seen.
    """
    tool = frame.targets.get(numbers.tool)
    if tool is None or numbers.base is None:
        return None if tool is None else tool.position
    base = frame.targets.get(numbers.base)
    return None if base is None else np.asarray(base.rotation.T @ (tool.position - base.position))


def tool_rotation_seen(frame: TrackerFrame, numbers: TargetNumbers) -> Array | None:
    """(3, 3), orientation of the tool's target in the frame of the base target: R_base^T R_tool.

    None if a target was not seen, or its orientation was not.
    """
    seen = [frame.targets.get(number) for number in (numbers.tool, numbers.base) if number is not None]
    if any(target is None or np.isnan(target.rotation).any() for target in seen):
        return None
    tool, *base = [target.rotation for target in seen if target is not None]
    return np.asarray(base[0].T @ tool) if base else tool
