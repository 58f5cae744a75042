"""Measurements as CSV text, and the metadata beside them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import tomli_w

from lrm_ident.data.atomic_write import write_text
from lrm_ident.data.measurement_file.commanded_poses import after_gap
from lrm_ident.data.measurement_file.known_columns import KNOWN, quantities_of_joints
from lrm_ident.data.measurement_file.pose_quantity import StatedQuantity
from lrm_ident.data.measurements import Measurements
from lrm_math.arm.arm_file import arm_name_for
from lrm_math.arrays import Array


def csv_text(columns: Iterable[tuple[str, Array, int]]) -> str:
    """CSV text of (name, values (N,), decimals)."""
    named = list(columns)
    head = ",".join(name for name, _, _ in named)
    lines = (
        ",".join(
            "" if math.isnan(value) else f"{value:.{decimals}f}"
            for value, (_, _, decimals) in zip(row, named, strict=True)
        )
        for row in zip(*(values for _, values, _ in named), strict=True)
    )
    return "\n".join([head, *lines]) + "\n"


def quantity_columns(stated: Iterable[StatedQuantity]) -> Iterator[tuple[str, Array, int]]:
    """The columns, as `csv_text` takes them, of those quantities that are known."""
    for name, values, decimals in stated:
        if values is not None:
            table = np.asarray(values, dtype=np.float64)
            table = table[:, None] if table.ndim == 1 else table
            by_name = {each.name: each for each in (*KNOWN, *quantities_of_joints(table.shape[1]))}[name]
            for column, numbers in zip(by_name.columns, table.T / by_name.si, strict=True):
                yield column, numbers, decimals


def measurements_csv(data: Measurements) -> str:
    """CSV text of measurements, with the optional columns that they have."""
    poses = data.poses
    gap = after_gap(data.pose).any()  # what the rows alone do not say any more
    stated: list[StatedQuantity] = [
        ("pose", data.pose, 0),
        ("t", poses.t, 3),
        ("session", poses.session, 0),
        ("payload", poses.payload, 4),
        ("angles", poses.q, 9),
        *(stated for observation in data.observations for stated in observation.columns()),
        ("temperature", poses.temperature, 3),
        ("gravity", poses.gravity, 9),
        ("repeat_of", data.repeat_of, 0),
        ("sides", poses.direction if gap else None, 0),
    ]
    return csv_text(quantity_columns(stated))


def metadata_toml(arm: str, source: str, **entries: object) -> str:
    """Text of the file beside measurements of an arm; `entries`: what else it states, None for what it does not."""
    about = {"schema": "lrm/measurements/1", "arm": arm, "source": source, **entries}
    return tomli_w.dumps({key: value for key, value in about.items() if value is not None})


def write_with_metadata(path: Path, table: str, arm: str, source: str, **entries: object) -> None:
    """Writes the CSV text of a table, and beside it the metadata that `metadata_toml` makes. Raises `FileError`.

    `arm`: name of a shipped arm, or path of its file.
    """
    write_text(path, table)
    write_text(path.with_suffix(".toml"), metadata_toml(arm_name_for(arm, path.parent), source, **entries))
