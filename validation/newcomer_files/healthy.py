"""Healthy data sets of five arms, by the independent generator, as the files that a person has."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lrm_math.arm.arm_file import shipped_arms
from lrm_math.arrays import Array
from validation import synthetic
from validation.misreadings import of_its_stiffness
from validation.synthetic.files import write

ARMS = ("lrm-lab", "so101", "ur5", "two-joint", "lrm-rover")
POSES = 60
SEED = 7
LOAD = {"ur5": 1.5}  # kg
NOISE = 3e-4  # m


@dataclass(frozen=True)
class NewcomerFiles:
    """Files that a person hands in: cells of the measurements (the header first), the file beside them, the arm file.

    `encoded`: the bytes of the measurements where they are not plain CSV text. `named`: the arm's own joint names.
    """

    arm_name: str
    table: tuple[tuple[str, ...], ...]
    metadata: str
    arm: str
    encoded: bytes | None = None

    @property
    def header(self) -> tuple[str, ...]:
        """The names of the columns."""
        return self.table[0]

    @property
    def rows(self) -> tuple[tuple[str, ...], ...]:
        """The rows below the header."""
        return self.table[1:]

    def column(self, name: str) -> int:
        """The place of a column."""
        return self.header.index(name)

    @property
    def angles(self) -> list[str]:
        """The names of the columns of joint angles."""
        return [name for name in self.header if name.startswith("q") and name.endswith("_deg")]

    def with_column(self, name: str, change: Callable[[Array], Array]) -> NewcomerFiles:
        """The files with the numbers of one column changed."""
        place, rows = self.column(name), [list(row) for row in self.rows]
        values = change(np.array([float(row[place]) for row in rows]))
        for row, value in zip(rows, values.tolist(), strict=True):
            row[place] = f"{value:.9g}"
        return self.with_rows(rows)

    def with_rows(self, rows: list[list[str]], header: list[str] | None = None) -> NewcomerFiles:
        """The files with other rows, and perhaps another header."""
        return replace(self, table=(tuple(header or self.header), *map(tuple, rows)))

    def text(self, delimiter: str = ",") -> str:
        """The measurements as text."""
        return "".join(delimiter.join(row) + "\n" for row in self.table)

    def write(self, folder: Path) -> tuple[Path, Path]:
        """Writes all files; the paths of the measurements and of the arm."""
        data, arm = folder / "data.csv", folder / "arm.toml"
        data.write_bytes(self.text().encode() if self.encoded is None else self.encoded)
        data.with_suffix(".toml").write_text(self.metadata, encoding="utf-8")
        arm.write_text(self.arm, encoding="utf-8")
        return data, arm


def healthy_files(name: str, folder: Path) -> NewcomerFiles:
    """The files of an arm, half of its poses with a load; `folder`: for scratch."""
    rig = synthetic.load_arm(shipped_arms()[name])
    truth = of_its_stiffness(name, synthetic.GroundTruth.random(rig, SEED))
    q = synthetic.random_poses(rig, POSES, SEED + 1)
    load = np.where(np.arange(POSES) % 2 == 0, 0.0, LOAD.get(name, 0.0663))
    table, metadata, _ = write(folder / name, synthetic.simulate(rig, truth, q, load, NOISE, SEED + 2), "synthetic")
    rows = tuple(tuple(line.split(",")) for line in table.read_text().splitlines())
    about = "".join(line + "\n" for line in metadata.read_text().splitlines() if not line.startswith("arm"))
    return NewcomerFiles(name, rows, about, shipped_arms()[name].read_text())
