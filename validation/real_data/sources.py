"""Public data sets: where they are, under which licence, and how their columns become measurements."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from urllib.error import URLError
from urllib.request import urlopen

TIMEOUT_S = 30.0
RAW = "https://raw.githubusercontent.com"


class NotReachable(Exception):
    """A data set that cannot be had here, and why."""


@dataclass(frozen=True)
class Source:
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

    def text(self, mirror: Path | None) -> str:
        """Text of the file, from the network, or from a folder `mirror` / repository / path. Raises `NotReachable`."""
        if mirror is not None:
            here = mirror / self.repository / self.path
            if not here.is_file():
                raise NotReachable(f"no {here}")
            return here.read_text(encoding="utf-8")
        address = f"{RAW}/{self.repository}/{self.commit}/{self.path}"
        try:
            with urlopen(address, timeout=TIMEOUT_S) as answer:
                return str(answer.read().decode("utf-8"))
        except (URLError, OSError) as error:
            raise NotReachable(f"{address}: {getattr(error, 'reason', error)}") from None


def nominal_and_difference(text: str) -> str:
    """Columns `joint_i` (deg), `x_t` … (nominal, mm) and `x_dif` … (measured less nominal, mm)."""
    rows = list(csv.DictReader(io.StringIO(text)))
    joints = sum(name.startswith("joint_") for name in rows[0])
    lines = [",".join([*(f"q{k}_deg" for k in range(1, joints + 1)), "x_mm", "y_mm", "z_mm"])]
    for row in rows:
        place = [repr(float(row[f"{axis}_t"]) + float(row[f"{axis}_dif"])) for axis in "xyz"]
        lines.append(",".join([*(row[f"joint_{k}"] for k in range(1, joints + 1)), *place]))
    return "\n".join(lines) + "\n"


WAM = str(Path(__file__).with_name("wam.toml"))
SOURCES = (
    Source(
        repository="pauljac7700/serial_robots_datasets",
        path="UR5/3D_UR5_uncalibrated_grid_cleaned.csv",
        commit="759068d85a8b95183cd71ff96d9dfc5173bc57fc",
        licence="MIT",
        author="P. Jacobi, Tsinghua University, 2025",
        arm="ur5",
        measurements=nominal_and_difference,
    ),
    Source(
        repository="pauljac7700/serial_robots_datasets",
        path="WAM/3D_WAM_uncalibrated_grid_cleaned.csv",
        commit="759068d85a8b95183cd71ff96d9dfc5173bc57fc",
        licence="MIT",
        author="P. Jacobi, Tsinghua University, 2025",
        arm=WAM,
        measurements=nominal_and_difference,
    ),
)
