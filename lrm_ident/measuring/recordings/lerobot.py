"""Rests of a LeRobot dataset (`meta/info.json`, `data/chunk-*/*.parquet`, v2.1 and v3): command and joint feedback.

What a dataset records of an arm are the commanded angles (`action`) and those that its encoders read
(`observation.state`), many times a second. Where both stand still the arm rests, and the two differ by what the servos
yield. The tip is not in it: photos or a tracker give that, one for each rest.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.measurement_file.write import StatedQuantity, csv_text, quantity_columns
from lrm_ident.data.wording import joint_labels
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.errors import FileError, LrmError
from lrm_math.text_file import read_json

STILL_DEG = 0.5  # that command and feedback may stray within a rest
LEAST_SD_DEG = 360.0 / 4096.0 / np.sqrt(12.0)  # of an encoder of 12 bits
COMMAND, FEEDBACK = "action", "observation.state"
COLUMNS = (COMMAND, FEEDBACK, "timestamp", "episode_index")
VERSIONS = ("v2.", "v3.")
Integers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class LeRobotFrames:
    """N frames of a dataset, in the order recorded.

    Attributes:
        command, feedback: (N, n), of the arm's joints (rad).
        t: (N,), s, in its episode. episode: (N,), from 0.
    """

    command: Array
    feedback: Array
    t: Array
    episode: Integers

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
        return bool(max(moved) > np.radians(STILL_DEG))


@dataclass(frozen=True, eq=False)
class LeRobotRests:
    """R rests of a dataset, in the order recorded.

    Attributes:
        command, feedback: (R, n), means over the rest (rad).
        feedback_sd: RMS deviation of a reading within a rest, but no less than the encoder's rounding (rad).
        t: (R,), s, of the middle of each rest in its episode. episode, frame: (R,), where it is in the dataset.
    """

    command: Array
    feedback: Array
    feedback_sd: float
    t: Array
    episode: Integers
    frame: Integers


def read_frames(folder: Path, arm: Arm) -> LeRobotFrames:
    """All frames of a dataset. Raises `FileError`: not such a dataset, or of other joints."""
    info = dataset_info(folder)
    order = [_columns_of(folder, info, name, arm) for name in (COMMAND, FEEDBACK)]
    table = read_columns(folder / "data", COLUMNS)
    command, feedback = (
        np.radians(np.array(table[name], dtype=np.float64)[:, columns])
        for name, columns in zip((COMMAND, FEEDBACK), order, strict=True)
    )
    t, episode = np.array(table["timestamp"], dtype=np.float64), np.array(table["episode_index"], dtype=np.int64)
    return LeRobotFrames(command, feedback, t, episode)


def read_lerobot(folder: Path, arm: Arm, dwell: float) -> LeRobotRests:
    """The rests of at least `dwell` seconds. Raises `FileError`: not such a dataset, or of other joints."""
    frames = read_frames(folder, arm)
    command, feedback, t, episode = frames.command, frames.feedback, frames.t, frames.episode
    rests = list(frames.rests(dwell))
    if not rests:
        raise LrmError(f"{folder}: the arm never rests for {dwell:g} s; record it standing still at each pose")
    scatter = float(np.sqrt(np.mean([feedback[rows].var(axis=0).mean() for rows in rests])))
    middle = np.array([rows[len(rows) // 2] for rows in rests])
    commanded, read = (np.array([values[rows].mean(axis=0) for rows in rests]) for values in (command, feedback))
    sd = float(max(scatter, np.radians(LEAST_SD_DEG)))
    return LeRobotRests(commanded, read, sd, t[middle], episode[middle], middle)


def dataset_info(folder: Path) -> Mapping[str, Any]:
    """Content of `meta/info.json`. Raises `FileError`: not such a dataset."""
    path = folder / "meta" / "info.json"
    info = read_json(path, "a LeRobot dataset of format v2.1 or v3 has it")
    version = str(info.get("codebase_version", "")) if isinstance(info, dict) else ""
    if not version.startswith(VERSIONS):
        right = "convert it with the scripts of LeRobot"
        raise FileError(path, "codebase_version", version or "missing", f"v2.1 or v3.0; {right}")
    if not isinstance(info.get("features"), dict):
        raise FileError(path, "features", "missing")
    return dict(info)


def _columns_of(folder: Path, info: Mapping[str, Any], feature: str, arm: Arm) -> list[int]:
    """Columns of a feature that are the arm's joints, by the names of both. Raises `FileError`."""
    path = folder / "meta" / "info.json"
    names = info.get("features", {}).get(feature, {}).get("names")
    if isinstance(names, dict):
        names = next(iter(names.values()), None)
    if not isinstance(names, list):
        raise FileError(path, feature, "no names of its columns", "shoulder_pan.pos, …")
    plain = [str(name).removesuffix(".pos").removeprefix("main_") for name in names]
    wanted = joint_labels(arm)
    missing = [name for name in wanted if name not in plain]
    if missing:
        what = f"no joint '{missing[0]}' among {', '.join(plain)}"
        raise FileError(path, feature, what, f"the joints of {arm.name} have other names? see name in its [[joint]]")
    return [plain.index(name) for name in wanted]


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
