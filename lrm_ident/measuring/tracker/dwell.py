"""The mean over the end of a rest; and what spoils it: lost targets, frozen frames, outliers, motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from lrm_ident.data.rigid_motion import rotation_vectors
from lrm_ident.data.wording import in_mm
from lrm_ident.measuring.tracker.frames import TargetNumbers, TrackerFrame, tip_position, tool_rotation_seen
from lrm_math.arrays import Array

LEAST = 5
"""Frames of a rest; fewer show neither a spread nor an outlier."""
LOST_SHARE = 0.1
"""Share of the frames in which a target may be unseen: a wink of a camera, no occlusion."""
FROZEN = 5
"""Frames one after the other with exactly the same position: noise never does that, a stuck tracker does."""
OUTLIER = 6.0
"""Times the median distance from the median position: for normal noise about nine standard deviations."""
FINEST = 1e-4
"""m: below it neither outliers nor motion are looked for; trackers print 0.001 mm and see no better than this."""
MOVING = 6.0
"""Standard errors by which the two halves of a rest may differ."""


@dataclass(frozen=True, eq=False)
class RestMean:
    """Mean tip (3,) in m over `frames` frames around tracker time `t` (s); `sd`: spread of one frame per axis (m).

    `rotation` (3, 3): mean orientation of the tool's target; `turn_sd`: its spread in one frame, per axis (rad). None
    where fewer than `LEAST` frames have one.
    """

    tip: Array
    sd: float
    t: float
    frames: int
    rotation: Array | None = None
    turn_sd: float | None = None


@dataclass(frozen=True)
class UnstableDwell:
    """Reason why the frames of a rest give no position."""

    why: str


def rest_mean(frames: Sequence[TrackerFrame], numbers: TargetNumbers) -> RestMean | UnstableDwell:
    """The mean position of the tip over the frames of a rest, or what is wrong with them."""
    frames = list({frame.number: frame for frame in frames}.values())  # a datagram may come twice
    if len(frames) < LEAST:
        return UnstableDwell(f"only {len(frames)} different frames arrived")
    seen = [(frame.t, tip) for frame in frames if (tip := tip_position(frame, numbers)) is not None]
    if len(frames) - len(seen) > LOST_SHARE * len(frames):
        return UnstableDwell(
            f"target {_most_lost(frames, numbers)} unseen in {len(frames) - len(seen)} of {len(frames)}"
        )
    tips = np.array([tip for _, tip in seen])
    if max(len(list(same)) for _, same in groupby(tips.tolist())) >= FROZEN:
        return UnstableDwell("frozen: exactly the same position again and again")
    away = np.linalg.norm(tips - np.median(tips, axis=0), axis=1)
    outliers = int(np.sum(away > max(OUTLIER * float(np.median(away)), FINEST)))
    if outliers:
        return UnstableDwell(f"{outliers} outliers in {len(tips)} frames, {away.max() * 1e3:.1f} mm at most")
    mean = tips.mean(axis=0)
    sd = float(np.sqrt(((tips - mean) ** 2).sum() / (3 * (len(tips) - 1))))
    half = len(tips) // 2
    shift = float(np.linalg.norm(tips[:half].mean(axis=0) - tips[-half:].mean(axis=0)))
    if shift > max(MOVING * sd * np.sqrt(2.0 / half), FINEST):
        return UnstableDwell(f"still moving: {in_mm(shift)} mm between the halves of the rest")
    turned = [turn for frame in frames if (turn := tool_rotation_seen(frame, numbers)) is not None]
    rotation, turn_sd = mean_rotation(np.array(turned)) if len(turned) >= LEAST else (None, None)
    return RestMean(mean, sd, float(np.mean([t for t, _ in seen])), len(seen), rotation, turn_sd)


def mean_rotation(rotations: Array) -> tuple[Array, float]:
    """(3, 3), the rotation nearest to the mean of rotations (M, 3, 3) (Moakher 2002); their spread per axis (rad)."""
    U, _, Vt = np.linalg.svd(rotations.mean(axis=0))
    mean = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    off = rotation_vectors(mean.T @ rotations)
    return mean, float(np.sqrt((off**2).sum() / (3 * (len(rotations) - 1))))


def _most_lost(frames: Sequence[TrackerFrame], numbers: TargetNumbers) -> int:
    wanted = [number for number in (numbers.tool, numbers.base) if number is not None]
    return min(wanted, key=lambda number: sum(number in frame.targets for frame in frames))
