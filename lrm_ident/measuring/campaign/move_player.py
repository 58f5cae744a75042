"""Plays a sequence of moves on an arm, and keeps what was commanded and what the encoders read meanwhile."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import tomli_w

from lrm_ident.data.measurement_file.known_columns import ANGLE, FEEDBACK
from lrm_ident.measuring.campaign.plan import PlannedPose
from lrm_ident.measuring.campaign.rover_arm import RoverArm
from lrm_ident.measuring.campaign.run import CampaignArm
from lrm_ident.measuring.campaign.servo_arm import ServoArm
from lrm_ident.measuring.excitation.sequence import MoveSequence, PlayedRow
from lrm_ident.measuring.recordings.command_log import LOG_SCHEMA, CommandLog
from lrm_math.arm.servo_settings import ServoSettings, settings_tables
from lrm_math.errors import FileError, LrmError

SEEN_DEG = 0.05
"""deg: a joint that turns less stands."""


def sequence_of(log: CommandLog) -> MoveSequence:
    """The moves of a log of commands. Raises `FileError`: no numbers, or beyond the limits."""
    if not (np.isfinite(log.t).all() and np.isfinite(log.q).all()):
        raise FileError(log.path, "", "a time or an angle is no number", "finite times and angles in every row")
    for number, joint in enumerate(log.arm.joints):
        low, high = float(log.q[:, number].min()), float(log.q[:, number].max())
        if low < joint.lower or high > joint.upper:
            limits = f"{math.degrees(joint.lower):g} to {math.degrees(joint.upper):g} deg"
            raise FileError(
                log.path, ANGLE.format(number + 1), f"{math.degrees(low):.1f} to {math.degrees(high):.1f} deg", limits
            )
    return MoveSequence(log.t, log.q)


def play(
    arm: CampaignArm,
    moves: MoveSequence,
    rows: list[PlayedRow],
    announce: Callable[[str], object],
) -> None:
    """Drives to the first pose, and along the moves; `rows` gets what was played, of an arm with encoders.

    `announce`: called before anything moves with what will. Raises `LrmError`; what `check_moves` says, before that.
    """
    if not isinstance(arm, ServoArm | RoverArm):
        raise LrmError("this arm plays no moves")
    arm.check_moves(moves)
    if why := arm.too_warm():
        raise LrmError(f"{why}: let it cool first")
    announce(announcement(moves, arm.names, arm.commanded()))
    arm.go(PlannedPose(1, tuple(moves.q[0].tolist()), 0.0, (), 1))
    arm.follow(moves, rows.append)


def announcement(moves: MoveSequence, names: Sequence[str], here: Sequence[float]) -> str:
    """What will move, from where the arm stands (rad): the way to the first pose, each joint's range, and how long."""
    to_first = np.degrees(np.abs(moves.q[0] - np.array(here)))
    low, high, fastest = (np.degrees(each) for each in (moves.q.min(axis=0), moves.q.max(axis=0), moves.fastest))
    ranges = [
        f"{name} {a:.0f} to {b:.0f} deg at up to {rate:.0f} deg/s"
        for name, a, b, rate in zip(names, low, high, fastest, strict=True)
        if b - a > SEEN_DEG
    ]
    first = f"to the first pose, {names[int(np.argmax(to_first))]} by {to_first.max():.1f} deg, then "
    what = f"{moves.t[-1] - moves.t[0]:.0f} s of moves: {', '.join(ranges) or 'no joint turns'}"
    return f"It moves now: {first if to_first.max() > SEEN_DEG else ''}{what}. Ctrl-C holds."


def played_csv(rows: Sequence[PlayedRow]) -> str:
    """A recording of commands and encoders: t_s, q1_deg …, q1_meas_deg …"""
    n = range(1, 1 + len(rows[0].command))
    head = ["t_s", *(ANGLE.format(k) for k in n), *(FEEDBACK.format(k) for k in n)]
    out = [",".join(head)]
    for row in rows:
        angles = (f"{math.degrees(q):.4f}" for q in (*row.command, *row.seen))
        out.append(",".join([f"{row.t - rows[0].t:.5f}", *angles]))
    return "\n".join(out) + "\n"


def played_toml(settings: ServoSettings | None) -> str:
    """The file beside a recording: how the servos were set, where they tell it."""
    return tomli_w.dumps({"schema": LOG_SCHEMA, **({"servos": settings_tables(settings)} if settings else {})})


def keeps_rows(path: Path | None, by_daemon: bool) -> None:
    """Checks that there is a file where encoders are read, and none where there are none. Raises `LrmError`."""
    if by_daemon and path is not None:
        raise LrmError("-o: a daemon's arm has no encoders; log its commands with lrm record, its tip with a tracker")
    if not by_daemon and path is None:
        raise LrmError("-o RECORDING.csv is missing: what the encoders read has to be kept")
