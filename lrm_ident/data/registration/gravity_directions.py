"""Directions in which gravity may act on an arm, where its file states another one: upside down, or on a wall."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from lrm_math.arm.arm import Arm

G = 9.81
"""m/s²."""
ALIKE = np.radians(46.0)
"""A direction of the six that is nearer than this to the stated one is the stated one, of an arm on a slope."""


def hung_otherwise(arm: Arm) -> Iterator[tuple[Arm, str]]:
    """The arm with gravity along each axis that it does not act along as stated, and that as a file has it."""
    stated = np.array(arm.gravity)
    length = float(np.linalg.norm(stated))
    for direction in (*-np.eye(3)[::-1], *np.eye(3)):
        if length == 0.0 or np.arccos(np.clip(direction @ stated / length, -1.0, 1.0)) > ALIKE:
            x, y, z = (G * direction + 0.0).tolist()
            yield replace(arm, gravity=(x, y, z)), f"gravity_m_per_s2 = [{x:g}, {y:g}, {z:g}]"
