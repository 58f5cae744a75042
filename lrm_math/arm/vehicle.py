"""What an arm stands on, where that may tip over: its mass, and where it touches the ground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lrm_math.arrays import Vector3
from lrm_math.errors import LrmError

FLAT = 1e-6
"""m²: twice the area that contacts span at least."""


@dataclass(frozen=True)
class Vehicle:
    """A vehicle without its arm, in the frame of TCP positions.

    `mass`: kg. `com`: its centre of mass (m). `contacts`: of its wheels with the ground, in order round it (m).

    Raises `LrmError`: contacts on one line.
    """

    mass: float
    com: Vector3
    contacts: tuple[Vector3, ...]

    def __post_init__(self) -> None:
        places = np.array(self.contacts)
        if np.linalg.norm(np.cross(places[1:-1] - places[0], places[2:] - places[0]).sum(axis=0)) < FLAT:
            raise LrmError("vehicle: contacts_mm lie on one line, or do not go round it in order")
