"""Log of commanded angles: a CSV that `lrm record` writes (`t_s, q1_deg, …`), or joint states of an MCAP file.

The file beside a CSV (`NAME.toml`) may say `count_us`, the board's rounding of pulses; angles are then those that it
put out.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import Field

from lrm_ident.data.measurement_file.load import load_pose_table, read_pose_feedback
from lrm_ident.data.measurement_file.summary_rows import summary_notices
from lrm_ident.measuring.recordings.lerobot import LeRobotFrames
from lrm_ident.measuring.recordings.mcap_file import SUFFIX as MCAP
from lrm_ident.measuring.recordings.mcap_file import joint_track
from lrm_math.arm.arm import Arm
from lrm_math.arm.servo_settings import ServoSettings
from lrm_math.arrays import Array
from lrm_math.errors import FileError
from lrm_math.model.reading import Reading
from lrm_math.toml_file import StrictSchema, read_toml

LOG_SCHEMA = "lrm/command-log/1"
GAP_S = 1.0
GAPS = 1.5
"""Times the usual distance of rows beyond which nothing was recorded between them."""
SPARSE_S, FINEST_S = 0.1, 0.01
"""s between two rows beyond which a ramp is not followed, and between frames of encoders that are read more often."""


class LogFile(StrictSchema):
    """`NAME.toml` beside a log. `count_us`: of the board; its pulses are whole multiples. `servos`: their settings."""

    schema_: str = Field(LOG_SCHEMA, alias="schema")
    arm: str = ""
    count_us: float | None = Field(None, gt=0.0, le=100.0)
    servos: ServoSettings | None = None


@dataclass(frozen=True, eq=False)
class CommandLog:
    """Commanded angles q (N, n), rad, at times t (N,), s.

    `count_s`: rounding of the pulses, 0 if not known. `servos`: how they were set, None if not known. `notices`: what a
    person should know of how the file was read.
    """

    path: Path
    arm: Arm
    t: Array
    q: Array
    count_s: float = 0.0
    servos: ServoSettings | None = None
    notices: tuple[str, ...] = ()

    def encoders(self) -> LeRobotFrames | None:
        """The rows as frames, where the file has what the encoders read (`q1_meas_deg, …`); gaps end an episode."""
        if self.path.suffix == MCAP:
            return None
        read, _ = read_pose_feedback(self.path, self.arm)
        if not read:
            return None
        steps = np.diff(self.t)
        episode = np.concatenate([[0], np.cumsum(steps > GAPS * np.median(steps))])
        return LeRobotFrames(self.q, read[0].values, self.t, episode)

    def beside(self, t: Array, q: Array) -> LeRobotFrames:
        """Frames evenly apart of what encoders read as q (N, n), rad, at times t (N,), s; gaps end an episode.

        Each frame has what was commanded last before it. Raises `FileError`: the two have nothing in common.
        """
        kept = (t >= self.t[0]) & (t <= self.t[-1])
        t, q = t[kept], q[kept]
        if len(t) < 2:
            raise FileError(self.path, "--encoders", "has no times in common with the commands", "record both at once")
        dt = max(float(np.median(np.diff(t))), FINEST_S)
        pieces = np.split(t, np.flatnonzero(np.diff(t) > max(SPARSE_S, GAPS * dt)) + 1)
        even = [piece[0] + dt * np.arange(int((piece[-1] - piece[0]) / dt) + 1) for piece in pieces]
        at, episode = np.concatenate(even), np.repeat(np.arange(len(even)), [len(times) for times in even])
        read = np.stack([np.interp(at, t, column) for column in q.T], axis=1)
        return LeRobotFrames(self.q[np.searchsorted(self.t, at, side="right") - 1], read, at, episode)

    def at(self, t: Array) -> Array:
        """(…, n), angles put out at times (…), straight between rows."""
        flat = np.asarray(t, dtype=np.float64).reshape(-1)
        out = np.stack([np.interp(flat, self.t, column) for column in self.q.T], axis=1)
        for joint, column in enumerate(out.T if self.count_s else ()):
            servo = self.arm.joints[joint].servo
            if servo is not None:
                pulse = np.floor(np.asarray(servo.pulse_of(column)) / self.count_s + 0.5) * self.count_s
                out[:, joint] = servo.angle_of(pulse)
        return out.reshape(*np.shape(t), -1)


def read_command_log(path: Path, arm: Arm, reading: Reading, topic: str | None = None) -> CommandLog:
    """A log of commands. `topic`: of an MCAP file with several of joint states. Raises `FileError`."""
    if path.suffix == MCAP:
        t, q = joint_track(path, arm, topic)
        return _checked(CommandLog(path, arm, t, q))
    poses, table = load_pose_table(path, arm, reading)
    stated = table.column("t")
    if stated is None:
        raise FileError(path, "header", "missing column t_s", "t_s (s) and q1_deg, ... as lrm record writes them")
    beside = path.with_suffix(".toml")
    head = read_toml(beside, LogFile) if beside.is_file() else LogFile()
    said = summary_notices(table.cells)
    return _checked(CommandLog(path, arm, stated, poses.q, 1e-6 * (head.count_us or 0.0), head.servos, said))


def _checked(log: CommandLog) -> CommandLog:
    steps = np.diff(log.t)
    if len(log.t) < 2 or (steps <= 0.0).any():
        row = 1 + int(np.argmax(steps <= 0.0)) if len(log.t) > 1 else 0
        raise FileError(log.path, f"row {row + 1}", "its time is not after that of the row before", "times that ascend")
    if steps.max() > GAP_S:
        row, what = int(np.argmax(steps)) + 2, f"{steps.max():.1f} s without a row before it"
        raise FileError(log.path, f"row {row}", what, "a log without a pause; lrm record writes one")
    if np.median(steps) > SPARSE_S:
        what = f"rows {np.median(steps):.2g} s apart"
        raise FileError(log.path, "t_s", what, f"the commands at least every {SPARSE_S:g} s, as lrm record writes them")
    return log
