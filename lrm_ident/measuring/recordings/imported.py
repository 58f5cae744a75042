"""Measurements out of a recording and the poses that were driven to: `lrm-ident import`.

Rests of the arm are at regular times, or wherever the tip stood still.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import uniform_filter1d

from lrm_ident.data.measurement_file.conventions import metadata_of, motion_of, read_positions
from lrm_ident.data.measurement_file.load import load_pose_table, pose_doubts
from lrm_ident.data.measurement_file.pose_quantity import StatedQuantity
from lrm_ident.data.measurement_file.write import csv_text, quantity_columns
from lrm_ident.data.rigid_motion import quaternions
from lrm_ident.measuring.recordings.mcap_file import SUFFIX as MCAP
from lrm_ident.measuring.recordings.mcap_file import read_joints
from lrm_ident.measuring.recordings.published_mat import AXES, read_mat_poses, read_mat_positions
from lrm_ident.measuring.recordings.readers import read_take
from lrm_ident.measuring.recordings.take import RecordedTake
from lrm_ident.measuring.recordings.time_matching import Rows, rows_of_same_time
from lrm_ident.measuring.tracker.dwell import RestMean, UnstableDwell, rest_mean
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import MM
from lrm_math.arrays import Array
from lrm_math.errors import FileError, LrmError
from lrm_math.kinematics.poses import Poses
from lrm_math.model.reading import AngleUnit, Reading

LEAST_SD, LEAST_TURN_SD = 1e-4 * MM, np.radians(1e-3)
STILL_M = 1e-3
"""m: how far the tip may be from where it is one dwell later; more than noise and sag, less than any move."""
NOISE_REACH = 5.0
"""Standard deviations of the difference of two frames in which a point stands still: one pair in 60 000 is beyond."""
LEAST_FRAMES, NORMAL_QUARTILE = 20, 0.6745
STILL_RAD = np.radians(0.3)
"""rad: the same of the joints together, by their encoders."""
END_S = 0.1
"""s before a rest ends that are not used: the next move may have begun."""
SHORTER = (1.25, 1.5, 2.0, 3.0, 4.0)
"""Parts of --dwell that are tried where the rests are not as many as the poses, to name the one that fits."""


@dataclass(frozen=True)
class RestTimes:
    """Regular rests: the first one ends at `first` s of the recording, the others every `every` s."""

    first: float
    every: float

    def ends(self, count: int) -> Array:
        """(count,), end of each rest (s)."""
        return np.asarray(self.first + self.every * np.arange(count))


@dataclass(frozen=True)
class RecordingOrder:
    """Order to read a recording.

    `tool`, `base`: names of the bodies at the tip and at the base. `times`: of regular rests; None: they are looked
    for. `skip`: rests before the first pose. `dwell`: s at the end of a rest to average over. `axes`: as in `Reading`.
    `rotation`: of a Vicon export, see `RecordingFile`. `angle_unit`: of the joint angles, as in `Reading`.
    `orientation`: whether the tool's orientation is wanted, too.
    """

    tool: str | None = None
    base: str | None = None
    times: RestTimes | None = None
    skip: int = 0
    dwell: float = 1.0
    axes: str | None = None
    rotation: str | None = None
    angle_unit: AngleUnit | None = None
    orientation: bool = False


@dataclass(frozen=True, eq=False)
class DrivenPoses:
    """N poses in the order driven: number (N,), angles (N, n) in rad, load (N,) in kg, what each repeats (N,).

    `notices`: what a person should know of how they were read. `t`: (N,), s, of whatever clock, or None.
    """

    number: Array
    q: Array
    payload: Array
    repeat_of: Array
    notices: tuple[str, ...] = ()
    t: Array | None = None

    def take(self, rows: Rows) -> DrivenPoses:
        """Some of them; one whose first is not among them stands for itself."""
        number, of = self.number[rows], self.repeat_of[rows]
        first = np.where(np.isin(of, number), of, number)
        return DrivenPoses(number, self.q[rows], self.payload[rows], first, self.notices)

    def at_rests(self, rests: Rows) -> DrivenPoses:
        """The same at some of the rests, counted from 0: poses that are only counted have the numbers of theirs."""
        count = np.arange(1.0, len(self.number) + 1)
        if not np.array_equal(self.number, count):
            return self
        number = np.array([float(rest + 1) for rest in rests.tolist()])
        return replace(self, number=number, repeat_of=number[self.repeat_of.astype(np.int64) - 1])


@dataclass(frozen=True, eq=False)
class ImportedRows:
    """Rows of a recording: tips (N, 3) in m, times (N,) in s or None, spreads (N,) in m or None.

    `left_out`: numbers of poses whose rest was unfit, with the reason. `notices`: what a person should know.
    `attitude`: orientations (N, 3, 3), or None; `turn_sd`: of each about every axis (rad).
    """

    poses: DrivenPoses
    tip: Array
    t: Array | None
    sd: Array | None
    left_out: dict[int, str] = field(default_factory=dict)
    notices: tuple[str, ...] = ()
    attitude: Array | None = None
    turn_sd: float | None = None

    def csv(self) -> str:
        """Text of the measurement file."""
        poses, sd = self.poses, None if self.sd is None else np.maximum(self.sd, LEAST_SD)
        stated: list[StatedQuantity] = [
            ("pose", poses.number, 0),
            ("t", self.t, 3),
            ("payload", poses.payload, 3),
            ("angles", poses.q, 6),
            ("position", self.tip, 4),
            ("sd", sd, 4),
            ("quaternion", None if self.attitude is None else quaternions(self.attitude), 7),
            ("turn_sd", None if self.turn_sd is None else np.full(len(self.tip), self.turn_sd), 5),
            ("repeat_of", poses.repeat_of, 0),
        ]
        return csv_text(quantity_columns(stated))


def import_recording(source: Path, poses: Path, arm: Arm, order: RecordingOrder) -> ImportedRows:
    """Reads a `.mat` file of positions, or a recording that one of `READERS` reads. Raises `LrmError`.

    `poses` may be an MCAP file: the joint states in it at the rests, without loads. Or a table of joint states with
    times, of any clock: rows nearer to each other than a rest lasts; its rests are those of the tip, in order.
    """
    driven = None if poses.suffix == MCAP else _driven(poses, arm, order)
    if source.suffix == ".mat" and driven is not None:
        return _one_each(source, driven, order)
    take = read_take(source, order.rotation)
    rests, driven = _rests(take, order, driven)
    if driven is None:
        q, number = read_joints(poses, arm, take.t), np.arange(1.0, len(rests) + 1)
        means = np.array([q[rows].mean(axis=0) for rows in rests]).reshape(len(rests), arm.dof)
        driven = DrivenPoses(number, means, np.zeros(len(rests)), number)
    return replace(_averaged(take, rests, driven, order), notices=driven.notices)


def _driven(path: Path, arm: Arm, order: RecordingOrder) -> DrivenPoses:
    if path.suffix in (".mat", ".txt"):
        number, q = read_mat_poses(path, arm.dof)
        return DrivenPoses(number, q, np.zeros(len(q)), number)
    how = Reading(angle_unit=order.angle_unit).over(metadata_of(path))
    poses, table = load_pose_table(path, arm, how, more=["repeat_of"])
    doubts = pose_doubts(table, arm, how)
    if poses.t is not None and len(poses.t) > 1 and np.median(np.diff(poses.t)) < order.dwell:
        return _resting(path, poses, poses.t, order.dwell, doubts)
    number = table["pose"][:, 0]
    repeat_of = table["repeat_of"][:, 0] if "repeat_of" in table else number
    return DrivenPoses(number, poses.q, poses.payload, repeat_of, doubts, poses.t)


def _resting(path: Path, log: Poses, t: Array, dwell: float, doubts: tuple[str, ...]) -> DrivenPoses:
    """Poses of a log of joint states at times (N,), s: where the joints rest. Raises `FileError`."""
    rests = still_rests(t - t[0], log.q, dwell, STILL_RAD)
    if not rests:
        raise FileError(
            path, "", f"a log of {len(t)} joint states, in which the joints rest nowhere for {2 * dwell:g} s"
        )
    q, payload = (np.array([each[rows].mean(axis=0) for rows in rests]) for each in (log.q, log.payload))
    number = np.arange(1.0, len(rests) + 1)
    said = f"{path.name}: a log of {len(t)} joint states, in which the joints rest {len(rests)} times"
    return DrivenPoses(number, q, payload, number, (said, *doubts), np.array([t[rows[-1]] for rows in rests]))


def _one_each(source: Path, driven: DrivenPoses, order: RecordingOrder) -> ImportedRows:
    tip = read_mat_positions(source)
    if len(tip) != len(driven.q):
        raise FileError(source, "", f"{len(tip)} positions, there are {len(driven.q)} poses")
    notices = [] if order.axes else ["x and y are turned, as in the author's code; --axes x,y,z leaves them"]
    t = None if order.times is None else order.times.ends(len(tip))
    turned = read_positions(Reading(axes=order.axes or AXES), tip)
    return ImportedRows(driven, turned, t, None, notices=tuple(notices))


def _rests(
    take: RecordedTake, order: RecordingOrder, driven: DrivenPoses | None
) -> tuple[Sequence[Rows], DrivenPoses | None]:
    """Frames of each rest, and the poses there. Raises `LrmError`: which belong together is not known."""
    t, count = take.t - take.t[0], None if driven is None else len(driven.q)
    if order.times is not None:
        fit = int((t[-1] - order.times.first) // order.times.every) + 1
        return regular_rests(t, max(1, fit) if count is None else count, order.times, order.dwell), driven
    tip = take.pair(order.tool, order.base).tip
    stops = still_rests(t, tip, order.dwell)
    stops_kept = stops[order.skip :]
    if count is None and not stops_kept:
        raise FileError(take.path, "", f"the tip rests nowhere for {2.0 * order.dwell:g} s")
    if driven is None or len(stops_kept) == count:
        return stops_kept, driven
    ends = np.array([t[rows[-1]] for rows in stops_kept])
    if driven.t is not None and len(stops_kept) and (same := rows_of_same_time(ends, driven.t, order.dwell)):
        rests, rows = same
        said = f"the tip rests {len(stops_kept)} times, there are {count} poses: {len(rows)} go together by their times"
        kept = driven.at_rests(rests) if len(rests) == count else driven.take(rows)
        return [stops_kept[k] for k in rests], replace(kept, notices=(*driven.notices, said))
    if seen := _with_hidden(t, tip, order.dwell, order.skip, len(driven.q)):
        return seen, driven
    skipped = f", {order.skip} of them skipped" if order.skip else ""
    shorter = (order.dwell / part for part in SHORTER)
    fits = next(
        (
            f"--dwell {d:.3g} finds as many; else "
            for d in shorter
            if _with_hidden(t, tip, d, order.skip, len(driven.q))
        ),
        "",
    )
    raise LrmError(
        f"the tip rests {len(stops)} times{skipped}, there are {count} poses; {fits}give --skip for rests before the "
        "first pose, --every and --first for rests at regular times, or their times to the poses (t_s); a rest lasts "
        f"{2.0 * order.dwell:g} s (twice --dwell) or more" + "".join(f" ({doubt})" for doubt in driven.notices)
    )


def _with_hidden(t: Array, tip: Array, dwell: float, skip: int, count: int) -> list[Rows] | None:
    """Frames of `count` rests, some of them hidden: stretches of a rest's length in which the tip is not seen.

    None if there are more or fewer of both together.
    """
    seen = still_rests(t, tip, dwell)[skip:]
    edges = np.flatnonzero(np.diff(np.concatenate([[False], np.isnan(tip).any(axis=1), [False]]).astype(np.int64)))
    gaps = [np.arange(begin, end) for begin, end in zip(edges[0::2], edges[1::2], strict=True)]
    first = seen[0][0] if skip and seen else 0
    between = [rows for rows in gaps if rows[0] > first and not any(r[0] < rows[0] and rows[-1] < r[-1] for r in seen)]
    for least in (2.0 * dwell - END_S, dwell):  # a rest may be seen for its first part
        hidden = [rows for rows in between if t[rows[-1]] - t[rows[0]] >= least]
        if hidden and len(seen) + len(hidden) == count:
            return sorted([*seen, *hidden], key=lambda rows: int(rows[0]))
    return seen if len(seen) == count else None


def _averaged(take: RecordedTake, rests: Sequence[Rows], driven: DrivenPoses, order: RecordingOrder) -> ImportedRows:
    pair = take.pair(order.tool, order.base)
    means = [rest_mean(pair.frames(rows), pair.numbers) for rows in rests]
    fit = {k: mean for k, mean in enumerate(means) if isinstance(mean, RestMean)}
    left_out = {int(driven.number[k]): mean.why for k, mean in enumerate(means) if isinstance(mean, UnstableDwell)}
    if not fit:
        raise FileError(take.path, "", f"no rest is fit: {next(iter(left_out.values()))}")
    good = list(fit.values())
    tip = read_positions(Reading(axes=order.axes), np.array([mean.tip for mean in good]))
    times, sd = np.array([mean.t for mean in good]) - take.t[0], np.array([mean.sd for mean in good])
    rows = ImportedRows(driven.take(np.array(list(fit))), tip, times, sd, left_out)
    return replace(rows, **_orientations(take, good, order)) if order.orientation else rows


def _orientations(take: RecordedTake, rests: Sequence[RestMean], order: RecordingOrder) -> dict[str, Any]:
    """Orientations of rests, NaN where one has none, and their spread, pooled. Raises `FileError`: there is none."""
    spreads = [rest.turn_sd for rest in rests if rest.turn_sd is not None]
    if not spreads:
        tool = take.pair(order.tool, order.base).tool
        raise FileError(take.path, "--orientation", f"no orientation of the tool: {tool.unknown_rotation}")
    turn, _ = motion_of(Reading(axes=order.axes))
    unknown = np.full((3, 3), np.nan)
    attitude = np.array([unknown if rest.rotation is None else turn @ rest.rotation for rest in rests])
    pooled = float(np.sqrt(np.mean(np.square(spreads))))
    return {"attitude": attitude, "turn_sd": max(pooled, LEAST_TURN_SD)}


def regular_rests(t: Array, count: int, times: RestTimes, dwell: float) -> list[Rows]:
    """The frames of the last `dwell` s before the end of each of `count` rests; t: (N,), s from the first frame.

    Raises `LrmError` if the recording ends before.
    """
    ends = times.ends(count)
    if ends[-1] > t[-1] + dwell:
        raise LrmError(f"the last of {count} rests would end at {ends[-1]:.1f} s, the recording ends at {t[-1]:.1f} s")
    return [np.flatnonzero((t > end - dwell) & (t <= end)) for end in ends]


def frame_noise(track: Array) -> float:
    """Standard deviation (m or rad) of one frame of a track (N, 3) per axis, by the median of its second differences.

    A straight motion at constant speed has none. Difference-based estimation of variance (Gasser et al. 1986), robust.
    """
    if len(track) < LEAST_FRAMES:
        return 0.0
    bends = np.abs(track[:-2] - 2.0 * track[1:-1] + track[2:]) / np.sqrt(6.0)
    return float(np.sqrt(np.mean(np.square(np.median(bends, axis=0) / NORMAL_QUARTILE))))


def still_rests(t: Array, tip: Array, dwell: float, still: float = STILL_M) -> list[Rows]:
    """The frames of the last `dwell` s of every stretch of at least twice that in which the tip (N, 3) stands still.

    Or joints (N, n): within `still`. Where two frames differ by more through noise alone, means of some frames are
    compared, of half a `dwell` at most; where these do, too, within that.
    """
    seen = np.flatnonzero(np.isfinite(tip).all(axis=1))
    if not len(seen):
        return []
    between = float(t[seen[-1]] - t[seen[0]]) / max(len(seen) - 1, 1) or dwell
    spread = NOISE_REACH * math.sqrt(2.0) * frame_noise(tip[seen])
    frames = max(1, min(math.ceil((spread / still) ** 2), int(0.5 * dwell / between)))
    track, still = uniform_filter1d(tip[seen], frames, axis=0), max(still, spread / math.sqrt(frames))
    least = 2.0 * dwell - (frames - 1) * between
    later = np.searchsorted(t[seen], t[seen] + dwell, side="right") - 1
    moved = np.linalg.norm(track[later] - track, axis=1)
    lasting = t[seen[later]] - t[seen] > 0.5 * dwell
    stands = (moved < still) & lasting
    edges = np.flatnonzero(np.diff(np.concatenate([[False], stands, [False]]).astype(np.int64)))
    rests = []
    for begin, end in zip(edges[0::2], edges[1::2], strict=True):
        first, last = t[seen[begin]], t[seen[later[end - 1]]] - END_S
        if last - first >= least:
            rests.append(np.flatnonzero((t > last - dwell) & (t <= last)))
    return rests
