"""Where a capability map asks: cells of a grid in space, and boxes of space that matter."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import MM
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.forward import frames

Mask = NDArray[np.bool_]
Triple = tuple[float, float, float]
MOST_CELLS = 2_000_000
NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)"
RANGE = rf"({NUMBER}):({NUMBER})"
AREA = re.compile(rf"([\w-]+)={RANGE},{RANGE},{RANGE}")


@dataclass(frozen=True)
class Area:
    """A box of space that the tool has work in, in the frame of TCP positions: corners (m)."""

    name: str
    low: Triple
    high: Triple

    def holds(self, points: Array) -> Mask:
        """(N,), which points (N, 3) in m lie inside."""
        return np.asarray(((points >= self.low) & (points <= self.high)).all(axis=1))


@dataclass(frozen=True)
class Grid:
    """N cubes of edge `step` (m); number k along an axis is from k to k + 1 steps. `first` number, `count` of each.

    No centre lies on a coordinate plane, where symmetric arms are singular.
    """

    step: float
    first: tuple[int, int, int]
    count: tuple[int, int, int]

    def __len__(self) -> int:
        return int(np.prod(self.count))

    @property
    def cell_volume(self) -> float:
        """m³."""
        return self.step**3

    def axis(self, i: int) -> Array:
        """Centres along one axis (m)."""
        return np.asarray((self.first[i] + np.arange(self.count[i]) + 0.5) * self.step, dtype=np.float64)

    @property
    def centres(self) -> Array:
        """(N, 3), m, z running fastest."""
        return np.stack(np.meshgrid(*(self.axis(i) for i in range(3)), indexing="ij"), axis=-1).reshape(-1, 3)

    def inside(self, area: Area) -> Mask:
        """(N,), which cells have their centre in an area. Raises `LrmError` if there are none."""
        cells = area.holds(self.centres)
        if not cells.any():
            raise LrmError(
                f"area '{area.name}' holds no centre of a cell: it is out of all reach, or too small for a step of "
                f"{self.step * 1e3:g} mm"
            )
        return cells

    def cell_of(self, points: Array) -> NDArray[np.int64]:
        """(N, 3), which cell along each axis, from 0, the points (N, 3) in m lie in; may be outside the grid."""
        return np.floor(points / self.step).astype(np.int64) - self.first

    def by_axis(self, values: Array) -> Array:
        """Values of the cells (N,) by their numbers along x, y and z."""
        return values.reshape(self.count)


def grid_around(arms: Sequence[Arm], step: float) -> Grid:
    """The smallest grid that holds all that any of the arms could reach without limits.

    Raises:
        LrmError: a step that is not above zero, or so small that there are too many cells.
    """
    if not 0.0 < step < np.inf:
        raise LrmError(f"the step of the grid is {step * 1e3:g} mm; it must be above zero")
    balls = [ball_of(arm) for arm in arms]
    low = np.floor(np.min([centre - radius for centre, radius in balls], axis=0) / step)
    high = np.ceil(np.max([centre + radius for centre, radius in balls], axis=0) / step)
    cells = float(np.prod(high - low))
    if cells > MOST_CELLS:
        enough = np.ceil(step * 1e3 * (cells / MOST_CELLS) ** (1 / 3))
        raise LrmError(
            f"a step of {step * 1e3:g} mm makes {cells:.3g} cells; at most {MOST_CELLS} fit, take {enough:g} mm or more"
        )
    x, y, z = low.astype(int).tolist()
    a, b, c = (high - low).astype(int).tolist()
    return Grid(step, (x, y, z), (a, b, c))


def ball_of(arm: Arm) -> tuple[Array, float]:
    """Centre (3,) and radius (m) of a ball that the TCP cannot leave, whatever the joints do.

    About the first axis, as high up as the second joint stands: every further link adds its length at most.
    """
    chain = chain_of(arm)
    stands = frames(chain, chain.values([0.0] * arm.dof), 1)[0]
    origin, axis, ends = stands[0, :3, 3], stands[0, :3, 2], stands[1:, :3, 3]
    centre = origin + axis * float(axis @ (ends[0] - origin))
    steps = np.diff(np.concatenate([centre[None], ends]), axis=0)
    return centre, float(np.linalg.norm(steps, axis=1).sum())


def area_named(words: str) -> Area:
    """An area from words such as `ground=50:350,-150:150,0:100`: ranges of x, y and z in mm.

    Raises:
        LrmError: words that say something else, or a range that ends before it starts.
    """
    found = AREA.fullmatch(words.strip())
    if not found:
        raise LrmError(f"area '{words}'; should be NAME=X:X,Y:Y,Z:Z in mm, for instance ground=50:350,-150:150,0:100")
    name, *ends = found.groups()
    x0, x1, y0, y1, z0, z1 = (float(end) * MM for end in ends)
    if not (x0 < x1 and y0 < y1 and z0 < z1):
        raise LrmError(f"area '{words}': every range must start below its end")
    return Area(name, (x0, y0, z0), (x1, y1, z1))
