"""Distances of the TCP from a fixed point: string potentiometer, or telescoping ball bar; positions may be missing.

Goswami, Quaid & Peshkin 1993 (ball bar); Driels & Swayze 1994 (single wire draw).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lrm_ident.data.apply_reading import read_positions
from lrm_ident.data.measurement_file.metadata import Metadata
from lrm_ident.data.number_table import NumberTable
from lrm_math.arm.arm_file import MM
from lrm_math.arrays import Array
from lrm_math.model.reading import Reading

DISTANCE, DISTANCE_SD = "distance_mm", "distance_sd_mm"


@dataclass(frozen=True, eq=False)
class Distances:
    """Distances (N,) (m), NaN where not measured, their standard deviation (N,) and the point (3,) where they start.

    None: not measured or not used; not stated; not known. `notices`: why they are not used, or what is estimated.
    """

    distance: Array | None = None
    sd: Array | None = None
    start: Array | None = None
    notices: tuple[str, ...] = ()


def read_distances(table: NumberTable, metadata: Metadata, how: Reading, tcp: Array, weighed: bool) -> Distances:
    """The distances of a file, if they can be weighed beside the positions `tcp` (N, 3).

    Args:
        weighed: whether the positions have a standard deviation.

    Raises `FileError`: rows with neither position nor distance, or of both kinds without their standard deviations.
    """
    sd = distance_sd(table, metadata)
    if DISTANCE not in table:
        return Distances(sd=sd)
    distance, gone = table.columns[DISTANCE] * MM, np.isnan(tcp[:, 0])
    table.reject(np.isnan(distance) & gone, DISTANCE, "empty, and the row has no position either")
    if not gone.all() and (sd is None or not weighed):
        if gone.any():
            right = "state the standard deviation of both: distance_sd_mm, and sd_mm or noise_sd_mm"
            raise table.fault("header", "some rows have a position, others only a distance", right)
        why = "the distances are not used: state distance_sd_mm, and the positions' sd_mm or noise_sd_mm"
        return Distances(notices=(why,))
    if metadata.distance_from_mm is None:
        words = "the point that distances are measured from is not stated (distance_from_mm): it is estimated"
        return Distances(distance, sd, None, (words,))
    return Distances(distance, sd, read_positions(how, np.array([metadata.distance_from_mm]) * MM)[0])


def distance_sd(table: NumberTable, metadata: Metadata) -> Array | None:
    """(N,), standard deviations of the distances (m), of the column or for all of the file beside the data."""
    if DISTANCE_SD in table:
        return table.columns[DISTANCE_SD] * MM
    return None if metadata.distance_sd_mm is None else np.full(len(table), metadata.distance_sd_mm * MM)
