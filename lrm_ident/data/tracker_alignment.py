"""TCP positions in the base frame from readings of two tracker targets, and the offset between the targets' origins.

Calibration (Conenna 2024, section 5.3): a fixture holds the TCP target at a known position on the base target; measured
less known position is the deviation. Measurement (section 6.1): every TCP position is expressed in the frame of the
base target, and the deviation subtracted.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lrm_ident.data.measurement_file.known_columns import commanded_quantities
from lrm_ident.data.measurement_file.number_table import cell_error, numbers_of, read_csv, read_numbers
from lrm_ident.data.measurement_file.pose_quantity import POSITION
from lrm_ident.data.measurement_file.write import csv_text
from lrm_ident.data.rigid_motion import rotation_matrix
from lrm_ident.data.table_text.csv_file import CsvTable
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import MM
from lrm_math.arrays import Array
from lrm_math.errors import FileError

BASE = ("base_x_mm", "base_y_mm", "base_z_mm")
ORIENTATION = ("base_qw", "base_qx", "base_qy", "base_qz")
TCP = ("tcp_x_mm", "tcp_y_mm", "tcp_z_mm")
UNIT_TOLERANCE = 0.01  # of a quaternion's length
OPTIONAL = ("t_s", "session", "payload_g", "temp_c")


@dataclass(frozen=True, eq=False)
class TrackerReadings:
    """N readings in the tracker's frame: target `base` (N, 3), m, with `turn` (N, 4), w x y z; `tcp` (N, 3)."""

    base: Array
    turn: Array
    tcp: Array

    def in_base(self) -> Array:
        """(N, 3), TCP in the frame of the base target (m).

        The base does not move, so its pose is averaged over all readings: else the noise of its orientation would be
        magnified by the arm's reach.
        """
        rotation = rotation_matrix(mean_quaternion(self.turn))
        return np.asarray((self.tcp - self.base.mean(axis=0)) @ rotation)

    def base_scatter(self) -> float:
        """RMS distance of the base target from its mean position (m)."""
        return float(np.sqrt(((self.base - self.base.mean(axis=0)) ** 2).sum(axis=1).mean()))


@dataclass(frozen=True, eq=False)
class Alignment:
    """Offset of the TCP target.

    Attributes:
        deviation, error: (3,), m, and its standard error.
        noise: (3,), standard deviation of one reading per axis (m).
        readings: their number.
    """

    deviation: Array
    error: Array
    noise: Array
    readings: int


def align(tracked: TrackerReadings, reference: Array) -> Alignment:
    """Deviation from readings of a fixture that holds the TCP target at `reference` (3,), m, in the base's frame."""
    measured, n = tracked.in_base(), len(tracked.tcp)
    columns = (tracked.base, tracked.turn, tracked.tcp)
    without = [TrackerReadings(*(np.delete(column, row, axis=0) for column in columns)) for row in range(n)]
    means = np.array([readings.in_base().mean(axis=0) for readings in without])
    error = np.sqrt((n - 1) * means.var(axis=0))  # jackknife: includes the base target's noise
    return Alignment(measured.mean(axis=0) - reference, error, measured.std(axis=0, ddof=1), n)


def mean_quaternion(turn: Array) -> Array:
    """(4,), average of unit quaternions (N, 4), ±q being the same rotation (Markley et al. 2007)."""
    _, vectors = np.linalg.eigh(turn.T @ turn)
    return np.asarray(vectors[:, -1])


def load_tracked(path: Path) -> TrackerReadings:
    """Readings of both targets. Raises `FileError`."""
    return _tracked(read_csv(path, [*BASE, *ORIENTATION, *TCP]), least=2)


def _tracked(table: CsvTable, least: int) -> TrackerReadings:
    base, turn, tcp = (
        np.stack([numbers_of(table, name) for name in names], axis=1) for names in (BASE, ORIENTATION, TCP)
    )
    length = np.linalg.norm(turn, axis=1)
    wrong = np.abs(length - 1.0) > UNIT_TOLERANCE
    if wrong.any():
        row = int(np.argmax(wrong))
        what = f"the quaternion's length is {length[row]:.3g}"
        raise cell_error(table, row, "base_qw", what, "it must be one: qw, qx, qy, qz of a rotation")
    if len(base) < least:
        raise FileError(table.path, "", f"{len(base)} reading", f"at least {least} are needed to estimate the noise")
    return TrackerReadings(base * MM, turn / length[:, None], tcp * MM)


def measurements_from(path: Path, arm: Arm, deviation: Array) -> tuple[str, TrackerReadings]:
    """CSV text of measurements (schema `lrm/measurements/1`) from raw readings, corrected by the deviation (3,), m.

    `path`: CSV with `pose`, `q1_deg` … and the columns of both targets; the columns `OPTIONAL` are kept.

    Raises `FileError`: naming file, line and column of the first fault.
    """
    angles, *_ = commanded_quantities(arm)
    table = read_csv(path, ["pose", *angles.columns, *BASE, *ORIENTATION, *TCP])
    tracked = _tracked(table, least=1)
    for _, error in read_numbers(table, [angles]).beyond:
        raise error
    tcp = (tracked.in_base() - deviation) / MM
    columns = [("pose", numbers_of(table, "pose"), 0)]
    columns += [(name, numbers_of(table, name), 3) for name in OPTIONAL if name in table.header]
    columns += [(name, numbers_of(table, name), 6) for name in angles.columns]
    columns += [(name, tcp[:, i], 4) for i, name in enumerate(POSITION)]
    return csv_text(columns), tracked
