"""Distances of the TCP from a fixed point: string potentiometer, or telescoping ball bar; positions may be missing.

Goswami, Quaid & Peshkin 1993 (ball bar); Driels & Swayze 1994 (single wire draw).
"""

from __future__ import annotations

import numpy as np

from lrm_ident.data.apply_reading import read_positions
from lrm_ident.data.csv_table import CsvTable, require
from lrm_ident.data.measurement_file.metadata import Metadata
from lrm_ident.data.measurement_file.pose_columns import maybe_numbers, positive
from lrm_ident.data.measurement_table import POSITION
from lrm_math.arm.arm_file import MM
from lrm_math.arrays import Array
from lrm_math.errors import FileError
from lrm_math.model.reading import Reading

DISTANCE, DISTANCE_SD = "distance_mm", "distance_sd_mm"


def read_tcp(table: CsvTable, how: Reading) -> Array:
    """(N, 3), measured positions (m), NaN where a row has a distance only. Raises `FileError`."""
    if DISTANCE not in table.header:
        positions = np.stack([table.numbers(name) for name in POSITION], axis=1)
    elif not set(POSITION) & set(table.header):
        positions = np.full((len(table.rows), 3), np.nan)
    else:
        require(table, POSITION)
        positions = np.stack([maybe_numbers(table, name) for name in POSITION], axis=1)
    gone = np.isnan(positions)
    for i, name in enumerate(POSITION):
        table.reject(gone[:, i] & ~gone.all(axis=1), name, "empty, the rest of the position is not")
    return read_positions(how, positions * MM)


def read_distance(table: CsvTable, tcp: Array) -> Array | None:
    """(N,), distances (m), NaN where the cell is empty; None without such a column.

    Raises `FileError`: a distance that is not above zero, or a row with neither position `tcp` (N, 3) nor distance.
    """
    if DISTANCE not in table.header:
        return None
    distance = maybe_numbers(table, DISTANCE) * MM
    table.reject(distance <= 0, DISTANCE, "not above zero")
    table.reject(np.isnan(distance) & np.isnan(tcp[:, 0]), DISTANCE, "empty, and the row has no position either")
    return distance


def read_distance_sd(table: CsvTable, metadata: Metadata | None) -> Array | None:
    """(N,), standard deviations of the distances (m), of the column or for all of the file beside the data."""
    if DISTANCE_SD in table.header:
        return positive(table, DISTANCE_SD) * MM
    if metadata is None or metadata.distance_sd_mm is None:
        return None
    return np.full(len(table.rows), metadata.distance_sd_mm * MM)


def read_anchor(metadata: Metadata | None, how: Reading) -> Array | None:
    """(3,), the point that distances are measured from (m), in the frame of the positions; None if not stated."""
    if metadata is None or metadata.distance_from_mm is None:
        return None
    return np.asarray(read_positions(how, np.array([metadata.distance_from_mm]) * MM)[0])


def check_alike(table: CsvTable, tcp: Array) -> None:
    """Raises `FileError` if some rows have positions and others distances only: their weights must be stated then."""
    gone = np.isnan(tcp[:, 0])
    if gone.any() and not gone.all():
        what = "some rows have a position, others only a distance"
        right = "state the standard deviation of both: distance_sd_mm, and sd_mm or noise_sd_mm"
        raise FileError(table.path, "header", what, right)
