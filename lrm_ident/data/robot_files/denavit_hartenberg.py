"""Modified Denavit–Hartenberg parameters of joint axes (Denavit & Hartenberg 1955; Hayati & Mirmirani 1985).

Between skew or crossing axes the frames stand on the common normal. Between nearly parallel ones its feet run off to
infinity; there the frames stay where the description has them, and Hayati's angle beta takes the rest.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lrm_ident.data.rigid_motion import inverse, shift, turn
from lrm_math.arm.arm import NEARLY_PARALLEL
from lrm_math.arrays import Array

SAME = 1e-14
"""m or rad: what round-off alone makes of a zero."""


@dataclass(frozen=True)
class DhLink:
    """Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta); rad and m."""

    theta: float
    d: float
    a: float
    alpha: float
    beta: float

    @property
    def motion(self) -> Array:
        """(4, 4), from the frame on one axis to that on the next."""
        along = turn((0, 0, 1), self.theta) @ shift((self.a, 0.0, self.d))
        return along @ turn((1, 0, 0), self.alpha) @ turn((0, 1, 0), self.beta)


def dh_link(point: Array, axis: Array) -> DhLink:
    """The link from a frame whose z is one axis to the next axis: a `point` (3,), m, on it and its direction (3,)."""
    sine = float(np.hypot(axis[0], axis[1]))
    if sine < NEARLY_PARALLEL:
        return _parallel(point, axis)
    theta = math.atan2(-axis[1], -axis[0]) - math.pi / 2.0  # x along z × axis
    normal = np.array([math.cos(theta), math.sin(theta), 0.0])
    alpha = math.atan2(sine, axis[2])
    if theta < -math.pi / 2.0 or theta >= math.pi / 2.0:  # of the two directions of the normal, the smaller turn
        theta, alpha, normal = theta + math.copysign(math.pi, -theta), -alpha, -normal
    beyond = float(point @ np.cross((0.0, 0.0, 1.0), normal)) / (-math.sin(alpha))
    foot = point - beyond * axis
    return DhLink(theta, float(foot[2]), _clean(float(foot @ normal)), alpha, 0.0)


def _parallel(point: Array, axis: Array) -> DhLink:
    """The next frame stands at `point`; alpha and beta turn z into the axis."""
    a = float(np.hypot(point[0], point[1]))
    theta = math.atan2(point[1], point[0]) if a > SAME else 0.0
    if theta < -math.pi / 2.0 or theta >= math.pi / 2.0:
        theta, a = theta - math.copysign(math.pi, theta), -a
    x, y, z = (turn((0, 0, 1), -theta)[:3, :3] @ axis).tolist()
    beta = math.asin(x)
    return DhLink(_clean(theta), float(point[2]), a if abs(a) > SAME else 0.0, _clean(math.atan2(-y, z)), _clean(beta))


def dh_links(axes: Sequence[Array], start: Array) -> tuple[list[DhLink], list[Array]]:
    """Links between consecutive joint frames (4, 4), each turning about its z, and the frames of ours on their axes.

    `start`: (4, 4), the frame on the first axis. All in one fixed frame.
    """
    frames, links = [start], list[DhLink]()
    for after in axes[1:]:
        seen = inverse(frames[-1]) @ after
        links.append(dh_link(seen[:3, 3], seen[:3, 2]))
        frames.append(frames[-1] @ links[-1].motion)
    return links, frames


def _clean(value: float) -> float:
    return value if abs(value) > SAME else 0.0
