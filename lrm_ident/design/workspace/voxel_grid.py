"""Voxel grid of the workspace, box-shaped areas of interest, and those of an arm that are looked at by default."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import MM
from lrm_math.arrays import Array, Vector3
from lrm_math.errors import LrmError
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.forward import frames

Mask = NDArray[np.bool_]
MAX_CELLS = 2_000_000
NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)"
RANGE = rf"({NUMBER}):({NUMBER})"
AREA = re.compile(rf"([\w-]+)={RANGE},{RANGE},{RANGE}")


@dataclass(frozen=True)
class Area:
    """An axis-aligned box of interest, in the frame of TCP positions: corners (m)."""

    name: str
    low: Vector3
    high: Vector3

    def holds(self, points: Array) -> Mask:
        """(N,), whether points (N, 3) in m are inside."""
        return np.asarray(((points >= self.low) & (points <= self.high)).all(axis=1))

    def raised(self, height: float) -> Area:
        """The same area higher up (m)."""
        (x0, y0, z0), (x1, y1, z1) = self.low, self.high
        return Area(self.name, (x0, y0, z0 + height), (x1, y1, z1 + height))


@dataclass(frozen=True)
class VoxelGrid:
    """N cubes of edge `step` (m); cube k along an axis spans k to k + 1 steps. `first` index and `count` per axis.

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
        """(N, 3), m, z varying fastest."""
        return np.stack(np.meshgrid(*(self.axis(i) for i in range(3)), indexing="ij"), axis=-1).reshape(-1, 3)

    def inside(self, area: Area) -> Mask:
        """(N,), whether the cells have their centre in an area. Along an axis on which it is too thin to hold one, the
        layer of cells at its middle counts. Raises `LrmError` if it holds none along any axis, or is out of reach."""
        layers, thin = [], 0
        for i, (low, high) in enumerate(zip(area.low, area.high, strict=True)):
            held = (self.axis(i) >= low) & (self.axis(i) <= high)
            thin += not held.any()
            middle = self.first[i] + np.arange(self.count[i]) == np.floor(0.5 * (low + high) / self.step)
            layers.append(held if held.any() else middle)
        cells = np.asarray(np.einsum("i,j,k->ijk", *layers).reshape(-1))
        if thin == len(layers) or not cells.any():
            raise LrmError(
                f"area '{area.name}' holds no centre of a cell: it is out of all reach, or too small for a step of "
                f"{self.step * 1e3:g} mm"
            )
        return cells

    def by_axis(self, values: Array) -> Array:
        """Values of the cells (N,) as an array over x, y and z."""
        return values.reshape(self.count)


def grid_around(arms: Sequence[Arm], step: float) -> VoxelGrid:
    """The smallest grid around the bounding balls of all arms, with cells of edge `step` (m).

    Raises `LrmError`: a step that is not above zero, or too small.
    """
    if not 0.0 < step < np.inf:
        raise LrmError(f"the step of the grid is {step * 1e3:g} mm; it must be above zero")
    balls = [bounding_ball(arm) for arm in arms]
    low = np.floor(np.min([centre - radius for centre, radius in balls], axis=0) / step)
    high = np.ceil(np.max([centre + radius for centre, radius in balls], axis=0) / step)
    cells = float(np.prod(high - low))
    if cells > MAX_CELLS:
        enough = np.ceil(step * 1e3 * (cells / MAX_CELLS) ** (1 / 3))
        raise LrmError(
            f"a step of {step * 1e3:g} mm makes {cells:.3g} cells; at most {MAX_CELLS} fit, take {enough:g} mm or more"
        )
    x, y, z = low.astype(int).tolist()
    a, b, c = (high - low).astype(int).tolist()
    return VoxelGrid(step, (x, y, z), (a, b, c))


def bounding_ball(arm: Arm) -> tuple[Array, float]:
    """Centre (3,) and radius (m) of a ball that the TCP cannot leave at any joint angles.

    The centre is on the first axis at the height of the second joint; the radius is the sum of the link lengths.
    """
    chain = chain_of(arm)
    home = frames(chain, chain.values([0.0] * arm.dof), 1)[0]
    origin, axis, ends = home[0, :3, 3], home[0, :3, 2], home[1:, :3, 3]
    centre = origin + axis * float(axis @ (ends[0] - origin))
    steps = np.diff(np.concatenate([centre[None], ends]), axis=0)
    return centre, float(np.linalg.norm(steps, axis=1).sum())


def parse_area(words: str) -> Area:
    """An area from text such as `ground=50:350,-150:150,0:100`: ranges of x, y and z in mm.

    Raises `LrmError`: a syntax error, or a range that ends before it starts.
    """
    match = AREA.fullmatch(words.strip())
    if not match:
        raise LrmError(f"area '{words}'; should be NAME=X:X,Y:Y,Z:Z in mm, for instance ground=50:350,-150:150,0:100")
    name, *ends = match.groups()
    x0, x1, y0, y1, z0, z1 = (float(end) * MM for end in ends)
    if not (x0 < x1 and y0 < y1 and z0 < z1):
        raise LrmError(f"area '{words}': every range must start below its end")
    return Area(name, (x0, y0, z0), (x1, y1, z1))


@dataclass(frozen=True)
class WorkspaceStudy:
    """Areas and variants in the syntax of the command line, and pairs of shapes that may touch."""

    areas: tuple[str, ...] = ()
    variants: tuple[str, ...] = ()
    may_touch: tuple[str, ...] = ()


_CHANGES = product(("", "base_beta_deg=45"), ("", "link2-10mm", "link2+10mm"), ("", "link4-10mm", "link4-20mm"))
ROVER = WorkspaceStudy(
    areas=("ground=-15:235,-125:125,-10:10", "basket=-155:-95,-30:30,226:246"),
    variants=tuple(",".join(filter(None, changes)) for changes in _CHANGES if any(changes)),
    may_touch=("fingers:ground",),
)
"""Thesis section 3.1: the first link at 45° or 60°, links 2 and 4 as first designed or longer by 1 or 2 cm. The choice,
60°, +1 cm, +2 cm, is the shipped arm. The two areas are those of the author's published code
(`Kinematics_Matlab/forward/capability.m`): the ground behind the rover, x 20 to 270, y ±125, z ±10 mm, and the basket
on its back, x -120 to -60, y ±30, z 217 to 237 mm, where the arm's base is at x = 0, z = 227 mm. Ours is at x = -35,
z = 236 mm: both are moved along with it, but for the height of the ground."""


def default_study(arm_name: str) -> WorkspaceStudy:
    """The study of the arm of that name; an empty one for other arms."""
    return ROVER if arm_name == "lrm-rover" else WorkspaceStudy()
