"""Held-out error of a field beside names and outside regressors on more arms: the two-joint one, ten simulated ones.

The simulated arms each hide an effect that no name of the catalogue has exactly: the first ten of the second catalogue
that depend on angles, loads and directions alone.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

from rich.table import Table

from lrm_ident.data.error_stats import error_stats
from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.data.measurements import Measurements
from lrm_ident.fitting.cross_validation import joint_space_folds
from lrm_math.arm.arm_file import load_arm
from lrm_math.model.reading import Reading
from validation.hidden_effects.catalogue import UNFAMILIAR
from validation.hidden_effects.data import write_data
from validation.residual_field.nested import lines

CASES = (
    "bends-at-near-end2", "bends-at-far-end4", "bearing3", "unequal-play2", "stick-slip3", "dahl1", "stop2", "gear1",
    "cable-over-3-and-5", "base-lifts-about-x",
)  # fmt: skip
POSES = 200
TWO_JOINT_AXES = "-x,-y,z"
PLAIN = ("identifiable", "plain fit")
"""The default of `fit`: the options of the thesis are of its own arm."""


def hidden(name: str) -> Measurements:
    """Measurements of an arm with a hidden effect."""
    with tempfile.TemporaryDirectory(prefix="hidden-") as folder:
        path, _ = write_data(UNFAMILIAR[f"{name}/tune"], 0, POSES, Path(folder))
        return load_measurements(path, load_arm("lrm-lab"))


def two_joint(path: Path) -> Measurements:
    """The measurements of the two-joint arm, its axes read as the tool says."""
    return load_measurements(path, load_arm("two-joint"), Reading(axes=TWO_JOINT_AXES))


def held_out(arms: Iterator[tuple[str, Measurements]]) -> Iterator[tuple[str, dict[str, float]]]:
    """Name of each arm, and held-out RMS (m) in blocks of joint space of each way to predict."""
    for name, data in arms:
        found = lines(data, joint_space_folds(data.poses.q, data.repeat_of), *PLAIN)
        yield name, {words: error_stats(residual).rms for words, residual in found}


def arms_table(rows: Iterator[tuple[str, dict[str, float]]]) -> Table:
    """One row per arm, as soon as it is known; one column per way to predict."""
    table = Table(title="held-out RMS mm, blocks of joint space")
    for name, errors in rows:
        if not table.columns:
            for column in ("arm", *errors):
                table.add_column(column)
        table.add_row(name, *(f"{error * 1e3:.2f}" for error in errors.values()))
        print(name, {words: round(error * 1e3, 3) for words, error in errors.items()}, flush=True)
    return table
