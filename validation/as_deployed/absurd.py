"""Worlds in which an estimate is absurd by construction: few poses, half ranges, ties, a cause that cannot be named."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from validation.as_deployed.catalogue import HalfRange, recording_of
from validation.as_deployed.leaning import Lean, leaning_recording
from validation.as_deployed.recording import WorldRecording
from validation.hidden_effects.unfamiliar_effects import UnfamiliarCase, gear_ripple


@dataclass(frozen=True)
class AbsurdCase:
    """What is hidden, how many poses are measured, and the world of a seed."""

    hidden: str
    poses: int
    record: Callable[[int], WorldRecording]


def _half(case: UnfamiliarCase, poses: int, joint: int, side: int) -> AbsurdCase:
    where = "upper" if side > 0 else "lower"
    hidden = f"{case.name}, {where} half of joint {joint} measured"
    return AbsurdCase(hidden, poses, lambda seed: recording_of(case, seed, poses, HalfRange(joint, side)))


def _leaning(axis: str, tilt_deg: int, poses: int) -> AbsurdCase:
    lean = Lean(axis, tilt_deg, poses)
    return AbsurdCase(lean.words, poses, lambda seed: leaning_recording(seed, lean))


ABSURD = {
    "gear2, 4 waves, lower half": _half(gear_ripple("report", 2, 4, 0.3), 300, 2, -1),
    "gear2, 5 waves, lower half": _half(gear_ripple("report", 2, 5, 0.4), 300, 2, -1),
    "leans 5 about x": _leaning("x", 5, 300),
    "leans 5 about y": _leaning("y", 5, 300),
    "leans -8 about x": _leaning("x", -8, 300),
    "leans 8 about y": _leaning("y", 8, 300),
}
