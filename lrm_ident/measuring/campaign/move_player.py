"""Plays a sequence of moves on an arm, and keeps what was commanded and what the encoders read meanwhile."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from lrm_ident.data.measurement_file.known_columns import ANGLE, FEEDBACK
from lrm_ident.measuring.campaign.plan import PlannedPose
from lrm_ident.measuring.campaign.rover_arm import RoverArm
from lrm_ident.measuring.campaign.run import CampaignArm
from lrm_ident.measuring.campaign.servo_arm import ServoArm
from lrm_ident.measuring.excitation.sequence import MoveSequence, PlayedRow
from lrm_ident.measuring.recordings.command_log import CommandLog
from lrm_math.errors import FileError, LrmError


def sequence_of(log: CommandLog) -> MoveSequence:
    """The moves of a log of commands. Raises `FileError`: beyond the limits."""
    for number, joint in enumerate(log.arm.joints):
        low, high = float(log.q[:, number].min()), float(log.q[:, number].max())
        if low < joint.lower or high > joint.upper:
            limits = f"{math.degrees(joint.lower):g} to {math.degrees(joint.upper):g} deg"
            raise FileError(
                log.path, ANGLE.format(number + 1), f"{math.degrees(low):.1f} to {math.degrees(high):.1f} deg", limits
            )
    return MoveSequence(log.t, log.q)


def play(arm: CampaignArm, moves: MoveSequence, rows: list[PlayedRow]) -> None:
    """Drives to the first pose, and along the moves; `rows` gets what was played, of an arm with encoders.

    Raises `LrmError`.
    """
    if not isinstance(arm, ServoArm | RoverArm):
        raise LrmError("this arm plays no moves")
    arm.check_speed(moves)
    arm.go(PlannedPose(1, tuple(moves.q[0].tolist()), 0.0, (), 1))
    arm.follow(moves, rows.append)


def played_csv(rows: Sequence[PlayedRow]) -> str:
    """A recording of commands and encoders: t_s, q1_deg …, q1_meas_deg …"""
    n = range(1, 1 + len(rows[0].command))
    head = ["t_s", *(ANGLE.format(k) for k in n), *(FEEDBACK.format(k) for k in n)]
    out = [",".join(head)]
    for row in rows:
        angles = (f"{math.degrees(q):.4f}" for q in (*row.command, *row.seen))
        out.append(",".join([f"{row.t - rows[0].t:.5f}", *angles]))
    return "\n".join(out) + "\n"


def keeps_rows(path: Path | None, by_daemon: bool) -> None:
    """Checks that there is a file where encoders are read, and none where there are none. Raises `LrmError`."""
    if by_daemon and path is not None:
        raise LrmError("-o: a daemon's arm has no encoders; log its commands with lrm record, its tip with a tracker")
    if not by_daemon and path is None:
        raise LrmError("-o RECORDING.csv is missing: what the encoders read has to be kept")
