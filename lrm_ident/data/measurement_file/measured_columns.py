"""Measured columns of poses: what can be weighed together is used, and what is not, or cannot be meant, is said.

Positions of a lost or frozen tracker, and rows that are copies, are left out.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.measurement_file.commanded_poses import pose_words
from lrm_ident.data.measurement_file.number_table import MISTYPED, NumberTable, cell_error
from lrm_ident.data.measurement_file.pose_quantity import POSITION
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.weights.whitening import joint_covariance, known_part
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import MM
from lrm_math.arm.plausible_arm import reach
from lrm_math.errors import FileError
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of

MOVED = 0.05  # share of the reach
LEAST_EIGENVALUE = 1e-9  # of correlations


def with_comparable(data: Measurements, table: NumberTable, arm: Arm) -> Measurements:
    """The measurements without those that cannot be weighed against positions, or distances where they are alone, since
    the noise of either is not stated; notices say so.

    Raises `FileError`: poses that have nothing else, or a covariance that is not positive definite.
    """
    first, used, notices = data.first, [*data.observations], list[str]()
    for observation in data.observations:
        if observation is first or not observation.measured.any() or (observation.states_noise and first.states_noise):
            continue
        needed = ", and ".join(
            f"{each.needs} (of {each.words})" for each in (observation, first) if not each.states_noise
        )
        if (observation.measured & ~first.measured).any() and observation.is_length:
            what = f"some rows have {first.words}, others only {observation.words}"
            raise FileError(table.cells.path, "header", what, f"state the standard deviations {needed}")
        used.remove(observation)
        notices.append(f"not used: {observation.words}; state the standard deviations {needed}")
    if not data.positions.measured.any():
        notices.append(f"no positions: every error is one of the {first.words}")
    doubts = [words for observation in used for words in observation.doubts(arm)]
    seen = replace(
        data, observations=tuple(observation.weighed() for observation in used) if len(used) > 1 else tuple(used)
    )
    _check_definite(seen, table)
    return seen.noting(*doubts, *notices)


def _check_definite(data: Measurements, table: NumberTable) -> None:
    """Raises `FileError`: a covariance of a pose that is not positive definite."""
    covariance = known_part(joint_covariance(data.observations))
    scale = np.sqrt(np.maximum(np.einsum("nrr->nr", covariance), 1e-300))
    least = np.linalg.eigvalsh(covariance / (scale[:, :, None] * scale[:, None, :]))[:, 0]
    if not (least > LEAST_EIGENVALUE).all():
        place = f"line {table.cells.lines[int(np.argmin(least))]}, column {table.cells.columns[0].stated}"
        raise FileError(table.cells.path, place, "its covariance is not positive definite")


def out_of_reach(arm: Arm, table: NumberTable) -> tuple[tuple[int, FileError], ...]:
    """Row and error of each position that is farther from the others' median than twice the arm's length.

    None where more than `MISTYPED` of the rows are: then their unit or frame is another one.
    """
    tcp = table["position"] if "position" in table else np.empty((0, 3))
    seen, most = tcp[np.isfinite(tcp).all(axis=1)], 2.0 * reach(arm)
    if not len(seen):
        return ()
    away = tcp - np.median(seen, axis=0)
    rows = np.flatnonzero(np.linalg.norm(away, axis=1) > most).tolist()
    if len(rows) > MISTYPED * len(table):
        return ()
    beyond, numbers = [], ",".join(map(str, table.integers("pose")[rows]))
    poses = "its pose" if len(rows) == 1 else f"all {len(rows)} such poses"
    for row in rows:
        axis = int(np.argmax(np.abs(away[row])))
        what = f"the position is {np.linalg.norm(away[row]) / MM:.0f} mm from the others, and {arm.name} is "
        what += f"{reach(arm) / MM:.0f} mm long"
        right = f"correct it, or leave {poses} out with --leave-out {numbers}"
        beyond.append((row, cell_error(table.cells, row, POSITION[axis], what, right)))
    return tuple(beyond)


def without_lost(data: Measurements) -> Measurements:
    """The measurements without positions that are exactly 0, 0, 0: a tracker writes them while it sees nothing.

    Raises `FileError` if all are.
    """
    lost = (data.tcp == 0.0).all(axis=1)
    if not lost.any():
        return data
    if lost.all():
        raise data.source.fault("every position is 0, 0, 0", "was the tracker on?")
    count = f"{int(lost.sum())} positions are exactly 0, 0, 0, as of a lost tracker"
    return _left_out(data, lost, f"{count}, and left out")


def without_copies(data: Measurements, table: NumberTable) -> Measurements:
    """The measurements without rows in which every quantity is that of an earlier row: they are no further measurement.

    Rows that `repeat_of` states to be repetitions stay: an instrument of coarse resolution may read the same twice.

    Args:
        table: the rows that the measurements have, and perhaps others.
    """
    numbers = [table[name] for name in table.quantities if name not in ("pose", "repeat_of")]
    rows = np.nan_to_num(np.concatenate(numbers, axis=1), nan=np.inf) + 0.0
    original = dict(zip(map(bytes, rows[::-1]), table.integers("pose")[::-1].tolist(), strict=True))
    copies = dict(zip(table.integers("pose").tolist(), map(bytes, rows), strict=True))
    copied = np.array([original[copies[number]] != number for number in data.pose.tolist()], dtype=np.bool_)
    copied &= data.repeat_of == data.pose
    if not copied.any():
        return data
    words = "rows that equal an earlier row to the last digit, left out as copies (repetitions: state repeat_of)"
    return _left_out(data, copied, words)


def without_frozen(arm: Arm, data: Measurements) -> Measurements:
    """The measurements without positions that are, to the last digit, those of the row before, while the arm moved."""
    same = np.flatnonzero((np.diff(data.tcp, axis=0) == 0.0).all(axis=1)) + 1
    if not len(same):
        return data
    drawn = solve_equilibrium(model_of(arm, ()), data.poses.take(np.concatenate([same - 1, same]))).tcp
    away = np.linalg.norm(drawn[len(same) :] - drawn[: len(same)], axis=1) > MOVED * reach(arm)
    if not away.any():
        return data
    words = "the position stands still while the arm moves, as of a frozen tracker; left out"
    return _left_out(data, same[away], words)


def _left_out(data: Measurements, rows: NDArray[np.int64] | NDArray[np.bool_], why: str) -> Measurements:
    """The measurements without some rows, with a notice that says why and names their poses."""
    gone = data.pose[rows]
    return data.without(gone.tolist()).noting(f"{why}: {pose_words(gone)}")
