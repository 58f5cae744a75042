"""Rests of a LeRobot dataset (`meta/info.json`, `data/chunk-*/*.parquet`, v2.1 and v3): command and joint feedback.

What a dataset records of an arm are the commanded angles (`action`) and those that its encoders read
(`observation.state`), many times a second. Where both stand still the arm rests, and the two differ by what the servos
yield. The tip is not in it: photos or a tracker give that, one for each rest.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.measurement_file.column_names import BEFORE_JOINTS, SIDES
from lrm_ident.data.measurement_file.conventions import ANGLE_UNITS
from lrm_ident.data.measurement_file.pose_quantity import StatedQuantity
from lrm_ident.data.measurement_file.write import csv_text, quantity_columns
from lrm_ident.data.registration.hypotheses import COUNTS, MOST_DEG
from lrm_ident.data.registration.zero_conventions import convention_of
from lrm_ident.data.wording import joint_labels
from lrm_ident.measuring.recordings.misread_joints import Misreading, read_alike, within_limits
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import shipped_arms
from lrm_math.arrays import Array
from lrm_math.errors import FileError, LrmError
from lrm_math.model.reading import AngleUnit
from lrm_math.text_file import read_json

STILL_DEG = 0.5  # that command and feedback may stray within a rest
LEAST_SD_DEG = 360.0 / 4096.0 / np.sqrt(12.0)  # of an encoder of 12 bits
COMMAND, FEEDBACK = "action", "observation.state"
FEATURES = (COMMAND, FEEDBACK)
COLUMNS = (*FEATURES, "timestamp", "episode_index")
GRIPPER = "gripper"
"""LeRobot's own name of the jaw, which it records in percent of its range, whatever the unit of the joints."""
LEAST_RAD = 1.0
"""Of a whole recording: the least that its largest angle is, in rad."""
VERSIONS = ("v2.", "v3.")
Integers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class LeRobotFrames:
    """N frames of a dataset, in the order recorded.

    Attributes:
        command, feedback: (N, n), of the arm's joints (rad), NaN where none was read.
        t: (N,), s, in its episode. episode: (N,), from 0. notices: what a person should know of how they were read.
    """

    command: Array
    feedback: Array
    t: Array
    episode: Integers
    notices: tuple[str, ...] = ()

    @property
    def missing(self) -> NDArray[np.bool_]:
        """(N, n), where a joint has no number."""
        return np.isnan(self.command) | np.isnan(self.feedback)

    def reading_speed(self, rows: Integers) -> Array:
        """(len(rows),), change of the fastest joint's reading from frame to frame (rad), over three frames."""
        change = np.abs(np.gradient(self.feedback[rows], axis=0)).max(axis=1)
        return np.convolve(change, np.ones(3) / 3.0, mode="same")

    def rests(self, dwell: float) -> Iterator[Integers]:
        """Frames of the settled half of each stretch of one episode in which nothing moves for `dwell` s."""
        start, t = 0, self.t
        for row in range(1, len(t) + 1):
            if row == len(t) or self.episode[row] != self.episode[start] or self._strays(start, row):
                rows = np.arange(start, row)
                settled = rows[t[rows] >= t[start] + 0.5 * dwell] if len(rows) else rows
                if len(settled) > 1 and t[rows[-1]] - t[start] >= dwell:
                    yield settled
                start = row

    def _strays(self, start: int, row: int) -> bool:
        moved = [np.abs(values[row] - values[start]).max() for values in (self.command, self.feedback)]
        return not bool(np.max(moved) <= np.radians(STILL_DEG))  # one without a number strays


@dataclass(frozen=True, eq=False)
class LeRobotRests:
    """R rests of a dataset, in the order recorded.

    Attributes:
        command, feedback: (R, n), means over the rest (rad).
        feedback_sd: RMS deviation of a reading within a rest, but no less than the encoder's rounding (rad).
        t: (R,), s, of the middle of each rest in its episode. episode, frame: (R,), where it is in the dataset.
        misread: joints whose command and encoder do not agree; full turns alone are taken back.
    """

    command: Array
    feedback: Array
    feedback_sd: float
    t: Array
    episode: Integers
    frame: Integers
    misread: tuple[Misreading, ...] = ()


def read_frames(
    folder: Path, arm: Arm, angle_unit: AngleUnit | None = None, prefix: str | None = None
) -> LeRobotFrames:
    """All frames of a dataset.

    Args:
        angle_unit: of its angles, where they are no degrees.
        prefix: what stands before the joints' names, `left_` of two arms; None: found, where only one fits.

    Raises `FileError`: not such a dataset, of other joints, or angles in another unit.
    """
    info = dataset_info(folder)
    order = [_columns_of(folder, info, name, arm, prefix) for name in (COMMAND, FEEDBACK)]
    table = read_columns(folder / "data", COLUMNS)
    numbers = {
        name: _numbers(folder, name, table[name], columns) for name, columns in zip(FEATURES, order, strict=True)
    }
    percent = np.array([label == GRIPPER for label in joint_labels(arm)])
    for name, values in numbers.items():
        if angle_unit is None:
            _refuse_other_units(folder, name, values[:, ~percent])
    command, feedback = (_angles(values, arm, percent, angle_unit or "deg") for values in numbers.values())
    t, episode = np.array(table["timestamp"], dtype=np.float64), np.array(table["episode_index"], dtype=np.int64)
    notices = (f"{GRIPPER}: read as percent of its range, as LeRobot records it",) if percent.any() else ()
    frames = LeRobotFrames(command, feedback, t, episode, (*notices, *_of_another_arm(info, arm)))
    _refuse_unread(folder, arm, frames)
    return _as_the_arm_counts(arm, frames, percent)


def _of_another_arm(info: Mapping[str, Any], arm: Arm) -> Iterator[str]:
    """A notice where a dataset says that it was recorded with another arm that is shipped."""
    kind = str(info.get("robot_type"))
    said = kind.removeprefix("bi_").partition("_")[0]
    if {said, arm.name} <= {*shipped_arms()} and said != arm.name:
        yield f"recorded with {kind}, read as {arm.name}: is it --arm {said}?"


def _as_the_arm_counts(arm: Arm, frames: LeRobotFrames, percent: NDArray[np.bool_]) -> LeRobotFrames:
    """The frames with angles from the zeros of the arm's file, where they were recorded from others.

    Both features are read by one rule, if each of them alone is. `percent`: (n,), joints without a zero of their own.
    """
    rules = [convention_of(arm, np.where(percent, 0.0, angles)) for angles in (frames.command, frames.feedback)]
    rule = rules[0]
    if rule is None or any(calibration is None or calibration.words != rule.words for calibration in rules):
        return frames
    rule_here = replace(rule, sign=np.where(percent, 1.0, rule.sign), added=np.where(percent, 0.0, rule.added))
    words = f"angles lie beyond the limits of {arm.name}, and within them if they count from {rule.words}: read so"
    return replace(
        frames,
        command=rule_here.applied(frames.command),
        feedback=rule_here.applied(frames.feedback),
        notices=(*frames.notices, f"{words} ({rule_here.formula(arm)})"),
    )


def _numbers(folder: Path, feature: str, rows: Sequence[Any], columns: list[int]) -> Array:
    """(N, n), columns of a feature, NaN where a number is missing or infinite. Raises `FileError`: a ragged one."""
    width = max((len(row) for row in rows if row is not None), default=0)
    if any(row is not None and len(row) != width for row in rows) or (rows and max(columns) >= width):
        raise FileError(folder, feature, f"frames of {width} numbers and of others", "as many as it has names")
    whole = [[np.nan] * width if row is None else row for row in rows]
    values = np.array(whole, dtype=np.float64).reshape(len(whole), -1)[:, columns]
    return np.where(np.isfinite(values), values, np.nan)


def _angles(values: Array, arm: Arm, percent: NDArray[np.bool_], unit: AngleUnit) -> Array:
    """(N, n), rad; of the joints `percent` (n,) LeRobot records a share of their range."""
    low, high = np.array([(joint.lower, joint.upper) for joint in arm.joints]).T
    return np.where(percent, low + 0.01 * values * (high - low), ANGLE_UNITS[unit] * values)


def _refuse_other_units(folder: Path, feature: str, values: Array) -> None:
    """Raises `FileError`: all angles look like radians, or like counts of encoders."""
    most, least = float(np.nanmax(np.abs(values), initial=0.0)), float(np.nanmin(values, initial=0.0))
    if LEAST_RAD <= most <= 2.0 * np.pi:
        what = f"the angles look like radians: none is beyond {most:.3g}"
        raise FileError(folder, feature, what, "if so: --angle-unit rad; else record moves of more than 7 deg")
    if most > MOST_DEG:
        counts = "they look like counts of encoders: deg = (count - 2048) * 360 / 4096"
        right = counts if least >= 0.0 and most <= COUNTS else "an angle of a joint, in degrees"
        raise FileError(folder, feature, f"an angle of {most:.4g} deg", f"{right}; record with use_degrees=true")


def _refuse_unread(folder: Path, arm: Arm, frames: LeRobotFrames) -> None:
    """Raises `FileError`: a joint without a number in any frame."""
    for feature, values in ((COMMAND, frames.command), (FEEDBACK, frames.feedback)):
        gone = np.isnan(values).all(axis=0) if len(values) else np.zeros(arm.dof, dtype=np.bool_)
        if gone.any():
            what = f"{joint_labels(arm)[int(np.argmax(gone))]} has no number in any frame"
            raise FileError(folder, feature, what, "does its motor answer?")


def read_lerobot(folder: Path, arm: Arm, frames: LeRobotFrames, dwell: float) -> LeRobotRests:
    """The rests of at least `dwell` seconds.

    Raises `LrmError`: there are none. `FileError`: one is beyond the limits of the arm.
    """
    command, feedback, t, episode = frames.command, frames.feedback, frames.t, frames.episode
    rests = list(frames.rests(dwell))
    if not rests:
        right = "state a shorter one (--dwell), or record the arm standing still at each pose"
        raise LrmError(f"{folder}: the arm makes no stop of {dwell:g} s; {right}")
    scatter = float(np.sqrt(np.mean([feedback[rows].var(axis=0).mean() for rows in rests])))
    middle = np.array([rows[len(rows) // 2] for rows in rests])
    commanded, read = (np.array([values[rows].mean(axis=0) for rows in rests]) for values in (command, feedback))
    sd = float(max(scatter, np.radians(LEAST_SD_DEG)))
    _, alike, mistakes = read_alike(commanded, read)
    turned = [misread.joint for misread in mistakes if misread.mistake == "full turn"]
    read[:, turned] = alike[:, turned]
    commanded, read, beyond = within_limits(arm, commanded, read)
    for beyond_limit in beyond:
        if beyond_limit.mistake == "limits":
            joint, worst = arm.joints[beyond_limit.joint], np.degrees(beyond_limit.size)
            label, stops = joint_labels(arm)[beyond_limit.joint], beyond_limit.rests
            what = f"{label} stands up to {worst:.0f} deg beyond its limits, at {stops} stops"
            right = (
                f"{np.degrees(joint.lower):g} to {np.degrees(joint.upper):g} deg; is this its arm file and its zero?"
            )
            raise FileError(folder, FEEDBACK, what, right)
    return LeRobotRests(commanded, read, sd, t[middle], episode[middle], middle, (*mistakes, *beyond))


def dataset_info(folder: Path) -> Mapping[str, Any]:
    """Content of `meta/info.json`. Raises `FileError`: not such a dataset."""
    path = folder / "meta" / "info.json"
    if folder.exists() and not path.is_file():
        what = "is no LeRobot dataset: it has no meta/info.json" if folder.is_dir() else "is a file, no LeRobot dataset"
        raise FileError(folder, "", what, "name the folder with meta and data in it (format v2.1 or v3)")
    info = read_json(path, "name the folder of a dataset, in ~/.cache/huggingface/lerobot/ where LeRobot recorded it")
    version = str(info.get("codebase_version", "")) if isinstance(info, dict) else ""
    if not version.startswith(VERSIONS):
        right = "convert it with the scripts of LeRobot"
        raise FileError(path, "codebase_version", version or "missing", f"v2.1 or v3.0; {right}")
    if not isinstance(info.get("features"), dict):
        raise FileError(path, "features", "missing")
    return dict(info)


def _columns_of(folder: Path, info: Mapping[str, Any], feature: str, arm: Arm, prefix: str | None) -> list[int]:
    """Columns of a feature that are the arm's joints, by the names of both. Raises `FileError`."""
    path = folder / "meta" / "info.json"
    names = info.get("features", {}).get(feature, {}).get("names")
    if isinstance(names, dict):
        names = next(iter(names.values()), None)
    if not isinstance(names, list):
        raise FileError(path, feature, "no names of its columns", "shoulder_pan.pos, …")
    plain, wanted = [str(name).removesuffix(".pos") for name in names], joint_labels(arm)
    tried = ("", *BEFORE_JOINTS, *SIDES) if prefix is None else (prefix,)
    there = [before for before in tried if {before + name for name in wanted} <= {*plain}]
    if not there:
        missing = next(name for name in wanted if (prefix or "") + name not in plain)
        what = f"no joint '{(prefix or '')}{missing}' among {', '.join(plain)}"
        raise FileError(path, feature, what, f"the joints of {arm.name} have other names? see name in its [[joint]]")
    if len(there) > 1:
        which = " or ".join(f"--prefix {before}" for before in there if before)
        raise FileError(path, feature, f"joints of several arms: {', '.join(plain)}", f"say which: {which}")
    return [plain.index(there[0] + name) for name in wanted]


def read_columns(folder: Path, columns: Sequence[str]) -> dict[str, Sequence[Any]]:
    """Columns of all parquet files of a folder, in their order. Raises `FileError`; `LrmError`: no pyarrow."""
    try:
        import pyarrow
        import pyarrow.parquet as parquet
    except ImportError:
        raise LrmError("a LeRobot dataset is read with pyarrow; pip install 'lrm-arm[lerobot]'") from None
    files = sorted(folder.glob("chunk-*/*.parquet"))
    if not files:
        raise FileError(folder, "", "no chunk-*/*.parquet in it")
    out: dict[str, list[Any]] = {name: [] for name in columns}
    for path in files:
        try:
            part = parquet.read_table(path, columns=list(columns))
        except (OSError, pyarrow.ArrowException, KeyError) as error:
            raise FileError(path, "", f"cannot be read ({str(error).splitlines()[0]})") from None
        for name in columns:
            if name not in part.column_names:
                raise FileError(path, "", f"no column {name}")
            out[name] += part.column(name).to_pylist()
    return dict(out)


def rests_csv(rests: LeRobotRests) -> str:
    """CSV text of poses: command, feedback, time and episode of every rest, and its frame in the dataset."""
    stated: list[StatedQuantity] = [
        ("pose", np.arange(1, len(rests.t) + 1), 0),
        ("t", rests.t, 3),
        ("session", rests.episode + 1, 0),
        ("angles", rests.command, 6),
        ("feedback", rests.feedback, 6),
    ]
    return csv_text([*quantity_columns(stated), ("frame", rests.frame.astype(np.float64), 0)])
