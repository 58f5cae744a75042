"""Rows of a measurement file that cannot be what they say, left out or told.

A lost or frozen tracker, times that run backwards, repetitions elsewhere, a noise that no tracker has.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.measurement_file.commanded_poses import pose_words
from lrm_ident.data.measurement_file.metadata import Metadata
from lrm_ident.data.measurement_file.number_table import NumberTable
from lrm_ident.data.measurements import Measurements
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import MM
from lrm_math.arm.plausible_arm import reach
from lrm_math.errors import FileError
from lrm_math.model.equilibrium import equilibrium
from lrm_math.model.model import model_of

FINEST = 1e-5
"""Share of the reach: no tracker that arms are measured with is so exact."""
SAME_POSE = float(np.radians(1.0))
MOVED = 0.05  # share of the reach


def without_lost(data: Measurements) -> Measurements:
    """The measurements without positions that are exactly 0, 0, 0: a tracker writes them while it sees nothing.

    Raises `FileError` if all are.
    """
    lost = (data.tcp == 0.0).all(axis=1)
    if not lost.any():
        return data
    if lost.all():
        raise FileError(data.path, "", "every position is 0, 0, 0", "was the tracker on?")
    count = f"{int(lost.sum())} positions are exactly 0, 0, 0, as of a lost tracker"
    return _left_out(data, lost, f"{count}, and left out")


def without_frozen(arm: Arm, data: Measurements) -> Measurements:
    """The measurements without positions that are, to the last digit, those of the row before, while the arm moved."""
    same = np.flatnonzero((np.diff(data.tcp, axis=0) == 0.0).all(axis=1)) + 1
    if not len(same):
        return data
    drawn = equilibrium(model_of(arm, ()), data.poses.take(np.concatenate([same - 1, same]))).tcp
    away = np.linalg.norm(drawn[len(same) :] - drawn[: len(same)], axis=1) > MOVED * reach(arm)
    if not away.any():
        return data
    words = "the position stands still while the arm moves, as of a frozen tracker; left out"
    return _left_out(data, same[away], words)


def _left_out(data: Measurements, rows: NDArray[np.int64] | NDArray[np.bool_], why: str) -> Measurements:
    """The measurements without some rows, with a notice that says why and names their poses."""
    gone = data.pose[rows]
    return replace(data.without(gone.tolist()), notices=(*data.notices, f"{why}: {pose_words(gone)}"))


def row_notices(table: NumberTable, arm: Arm, metadata: Metadata) -> Iterator[str]:
    """Notices about the times, the repetitions and the stated noise of a file."""
    number = table.integers("pose")
    yield from _times(table, number)
    yield from _repetitions(table, number)
    yield from _noise(table, arm, metadata)


def _times(table: NumberTable, number: NDArray[np.int64]) -> Iterator[str]:
    t, session = table.column("t"), table.column("session")
    if t is None:
        return
    same_session = True if session is None else np.diff(session) == 0
    back = np.concatenate([[False], (np.diff(t) < 0) & same_session])
    if back.any():
        yield f"t_s runs backwards at {pose_words(number[back])}: are the rows in the order measured?"


def _repetitions(table: NumberTable, number: NDArray[np.int64]) -> Iterator[str]:
    """Repetitions that were commanded elsewhere than what they repeat."""
    stated = table.column("repeat_of")
    if stated is None:
        return
    q, first = table["angles"], {int(pose): row for row, pose in enumerate(number)}
    of = [first.get(int(pose), row) for row, pose in enumerate(np.nan_to_num(stated, nan=-1.0))]
    away = np.abs(q - q[of]).max(axis=1) > SAME_POSE
    if away.any():
        yield f"repeat_of: {pose_words(number[away])} is not commanded where the pose is that it repeats"


def _noise(table: NumberTable, arm: Arm, metadata: Metadata) -> Iterator[str]:
    """A standard deviation smaller than that of any tracker."""
    sd, noise = table.column("sd"), metadata.noise_sd_mm or np.nan
    name, usual = ("noise_sd_mm", noise) if sd is None else ("sd_mm", float(np.median(sd)) / MM)
    if 0.0 < usual < FINEST * reach(arm) / MM:
        yield f"{name} is {usual:.3g} mm: no tracker is so exact; were it in metres, it would be {usual * 1e3:.3g} mm"
