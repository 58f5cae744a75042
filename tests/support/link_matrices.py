"""The kinematic chain as products of 4 x 4 matrices, by none of our code."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array

NOTHING: Mapping[int, Array] = MappingProxyType({})


def turn(axis: int, angle: float) -> Array:
    """(4, 4), about x, y or z."""
    M, c, s = np.eye(4), np.cos(angle), np.sin(angle)
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    M[i, i] = M[j, j] = c
    M[i, j], M[j, i] = -s, s
    return M


def shift(x: float, y: float, z: float) -> Array:
    """(4, 4), m."""
    M = np.eye(4)
    M[:3, 3] = x, y, z
    return M


def link_matrices(arm: Arm, q: Array, after: Mapping[int, Array] = NOTHING) -> list[Array]:
    """Base, after every joint, tool: thesis Eq 2.2 with the extra translations of Table 4.2, and Hayati's angle.

    `after`: further motions (4, 4) after some links, by their number from 0.
    """
    b, t = arm.base, arm.tool
    out = [shift(b.x, b.y, b.z) @ turn(0, b.alpha) @ turn(1, b.beta) @ turn(2, b.gamma)]
    own = iter(q)
    for number, (_, joint, mimic) in enumerate(arm.chain_order):
        angle = next(own) if mimic is None else mimic.ratio * q[mimic.leader] + mimic.offset
        screw = turn(2, joint.theta + angle) @ shift(joint.a, 0, joint.d) @ turn(0, joint.alpha)
        link = screw @ turn(1, joint.beta) @ shift(0, 0, joint.extra_z or 0.0)
        out.append(out[-1] @ link @ after.get(number, np.eye(4)))
    out.append(out[-1] @ turn(0, t.alpha) @ turn(1, t.beta) @ turn(2, t.gamma) @ shift(t.x, t.y, t.z))
    return out
