"""From the tracker's two targets to TCP positions in the base frame, and how far off the targets' origins are.

The preliminary test of Conenna 2024, section 5.3: a fixture holds the TCP target at a known place on the base target;
what the tracker reads there, less the known place, is the targets' deviation. Section 6.1: every measured position is
taken relative to the base target and turned by its orientation; the deviation is then taken off.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lrm_ident.data.csv_table import Table, read_table, table_text
from lrm_ident.data.measurements import read_angles
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import MM
from lrm_math.arrays import Array
from lrm_math.errors import FileError

BASE = ("base_x_mm", "base_y_mm", "base_z_mm")
TURN = ("base_qw", "base_qx", "base_qy", "base_qz")
TCP = ("tcp_x_mm", "tcp_y_mm", "tcp_z_mm")
UNIT_SLACK = 0.01  # how far a written quaternion's length may be from one
KEPT = ("t_s", "session", "payload_g", "temp_c")


@dataclass(frozen=True, eq=False)
class Tracked:
    """N readings in the tracker's frame: `base` (N, 3), m, `turn` (N, 4), w x y z, of the base target, `tcp` (N, 3)."""

    base: Array
    turn: Array
    tcp: Array

    def in_base(self) -> Array:
        """(N, 3), TCP in the frame of the base target (m).

        The base stands still, so its pose is the mean over all readings: the noise of its orientation, magnified by the
        arm's reach, is averaged away.
        """
        rotation = rotation_of(mean_turn(self.turn))
        return np.asarray((self.tcp - self.base.mean(axis=0)) @ rotation)

    def without(self, row: int) -> Tracked:
        """All readings but one."""
        return Tracked(*(np.delete(column, row, axis=0) for column in (self.base, self.turn, self.tcp)))

    def base_wander(self) -> float:
        """RMS distance of the base target from its mean place (m)."""
        return float(np.sqrt(((self.base - self.base.mean(axis=0)) ** 2).sum(axis=1).mean()))


@dataclass(frozen=True, eq=False)
class Alignment:
    """How far the TCP target reads from where it is.

    Attributes:
        deviation, error: (3,), m, and its standard error.
        noise: (3,), standard deviation of one reading per axis (m).
        readings: how many.
    """

    deviation: Array
    error: Array
    noise: Array
    readings: int


def align(tracked: Tracked, known: Array) -> Alignment:
    """The deviation from a fixture that holds the TCP target at `known` (3,), m, in the base target's frame."""
    seen, n = tracked.in_base(), len(tracked.tcp)
    without = np.array([tracked.without(row).in_base().mean(axis=0) for row in range(n)])
    error = np.sqrt((n - 1) * without.var(axis=0))  # jackknife: the base target's noise counts too
    return Alignment(seen.mean(axis=0) - known, error, seen.std(axis=0, ddof=1), n)


def mean_turn(turn: Array) -> Array:
    """(4,), the mean of unit quaternions (N, 4) as rotations: ±q are one (Markley et al. 2007)."""
    _, vectors = np.linalg.eigh(turn.T @ turn)
    return np.asarray(vectors[:, -1])


def rotation_of(q: Array) -> Array:
    """(3, 3), of a unit quaternion (w, x, y, z)."""
    w, v = q[0], q[1:]
    x, y, z = v
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + 2.0 * w * skew + 2.0 * skew @ skew)


def load_tracked(path: Path) -> Tracked:
    """Readings of both targets. Raises `FileError`."""
    return _tracked(read_table(path, [*BASE, *TURN, *TCP]), least=2)


def _tracked(table: Table, least: int) -> Tracked:
    base, turn, tcp = (np.stack([table.numbers(name) for name in names], axis=1) for names in (BASE, TURN, TCP))
    length = np.linalg.norm(turn, axis=1)
    wrong = np.abs(length - 1.0) > UNIT_SLACK
    if wrong.any():
        row = int(np.argmax(wrong))
        what = f"the quaternion's length is {length[row]:.3g}"
        raise FileError(table.path, table.at(row, "base_qw"), what, "it must be one: qw, qx, qy, qz of a rotation")
    if len(base) < least:
        raise FileError(table.path, "", f"{len(base)} reading", f"at least {least} are needed to tell the noise")
    return Tracked(base * MM, turn / length[:, None], tcp * MM)


def measurements_from(path: Path, arm: Arm, deviation: Array) -> tuple[str, Tracked]:
    """CSV text of measurements (schema `lrm/measurements/1`) from raw readings, the deviation (3,), m, taken off.

    `path`: `pose`, `q1_deg` … and the columns of both targets; times, loads and the like are kept.

    Raises:
        FileError: naming file, line and column of the first fault.
    """
    angles = [f"q{i + 1}_deg" for i in range(arm.dof)]
    table = read_table(path, ["pose", *angles, *BASE, *TURN, *TCP])
    tracked = _tracked(table, least=1)
    read_angles(table, arm)
    tcp = (tracked.in_base() - deviation) / MM
    columns = [("pose", table.numbers("pose"), 0)]
    columns += [(name, table.numbers(name), 3) for name in KEPT if name in table.header]
    columns += [(name, table.numbers(name), 6) for name in angles]
    columns += [(name, tcp[:, i], 4) for i, name in enumerate(("x_mm", "y_mm", "z_mm"))]
    return table_text(columns), tracked
