"""Public grids of measured positions, held out by folds of joint space, beside rigid least squares and black boxes."""

from __future__ import annotations

import csv
import io
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import lrm_ident as lrm
from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.fitting.cross_validation import joint_space_folds
from lrm_math.arrays import Array
from lrm_math.model.equilibrium import solve_equilibrium
from validation.real_data.rivals import BLACK_BOXES, OURS, RIGID
from validation.real_data.sources import fetched


@dataclass(frozen=True)
class GridSource:
    """A file of a public repository on GitHub.

    Attributes:
        repository: owner/name. path, commit: of the file there. licence, author: of the data.
        arm: shipped arm that was measured, or the path of its file. measurements: makes a
            measurement file's text of its text.
    """

    repository: str
    path: str
    commit: str
    licence: str
    author: str
    arm: str
    measurements: Callable[[str], str]

    def held_out(self, mirror: Path | None, most: int | None) -> dict[str, float]:
        """RMS distance (m) of every method, over the same folds of at most so many poses. Raises `NotReachable`."""
        return held_out(self.measured(mirror, most))

    def measured(self, mirror: Path | None, most: int | None = None) -> Measurements:
        """At most so many of its poses. Raises `NotReachable`."""
        text = fetched(self.repository, self.commit, self.path, mirror)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "data.csv"
            path.write_text(self.measurements(text), encoding="utf-8")
            data = lrm.load(path, arm=self.arm)
        rows = np.random.default_rng(1).permutation(len(data))[: most or len(data)]
        return data.take(np.sort(rows))


def held_out(data: Measurements) -> dict[str, float]:
    """Held-out RMS distance (m) of every method, over the same folds."""
    left = {name: np.empty_like(data.tcp) for name in ("as drawn", RIGID, *BLACK_BOXES, OURS)}
    for known, unseen, rows in parts(data):
        nominal = lrm.Study.of(data, "offsets").model
        left["as drawn"][rows] = unseen.tcp - solve_equilibrium(nominal, unseen.poses).tcp
        rigid = lrm.Study.of(known, "offsets").fit().model
        left[RIGID][rows] = unseen.tcp - solve_equilibrium(rigid, unseen.poses).tcp
        rest = known.tcp - solve_equilibrium(rigid, known.poses).tcp
        for name, learn in BLACK_BOXES.items():
            left[name][rows] = left[RIGID][rows] - learn(known.poses.q, rest, unseen.poses.q)
        ours = lrm.Study.of(known).fit().model
        left[OURS][rows] = unseen.tcp - solve_equilibrium(ours, unseen.poses).tcp
    return {name: error_stats(error).rms for name, error in left.items()}


def parts(data: Measurements) -> Iterator[tuple[Measurements, Measurements, Array]]:
    """Measurements that are known and that are predicted, for each fold of joint space, and the latter's rows (N,)."""
    fold = joint_space_folds(data.poses.q, data.repeat_of)
    for number in range(int(fold.max()) + 1):
        yield data.take(fold != number), data.take(fold == number), fold == number


def nominal_and_difference(text: str) -> str:
    """Columns `joint_i` (deg), `x_t` … (nominal, mm) and `x_dif` … (measured less nominal, mm)."""
    rows = list(csv.DictReader(io.StringIO(text)))
    joints = sum(name.startswith("joint_") for name in rows[0])
    lines = [",".join([*(f"q{k}_deg" for k in range(1, joints + 1)), "x_mm", "y_mm", "z_mm"])]
    for row in rows:
        place = [repr(float(row[f"{axis}_t"]) + float(row[f"{axis}_dif"])) for axis in "xyz"]
        lines.append(",".join([*(row[f"joint_{k}"] for k in range(1, joints + 1)), *place]))
    return "\n".join(lines) + "\n"
