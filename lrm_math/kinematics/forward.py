"""Forward kinematics of a chain: frames, screw axes and centres of mass in the world frame."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from lrm_math.arrays import Array
from lrm_math.kinematics.chain import INVERSE, Chain, Number, X, Y, Z, is_zero, rotate, trig


@dataclass(frozen=True, eq=False)
class ChainGeometry:
    """Screw axes, bodies and tool of a chain in the world frame, for N poses, components first for speed.

    `axis`, `origin`: (S, 3, N), of every slot (unit vectors; m). `body`: (B, 3, N), centres of mass (m).
    `body_axes`: (B, 3, 3, N), unit vectors x, y, z of the frame that each body is fixed to.
    `tool`: (4, 3, N), columns x, y, z and origin of the tool frame.
    """

    axis: Array
    origin: Array
    body: Array
    body_axes: Array
    tool: Array

    @property
    def tcp(self) -> Array:
        """(3, N), TCP position (m)."""
        return np.asarray(self.tool[3])


def chain_geometry(
    chain: Chain, values: Sequence[Number], count: int, coms: Sequence[Sequence[Number]] | None = None
) -> ChainGeometry:
    """Forward kinematics from base to TCP for `count` poses, slots' amounts `values` (rad, m).

    `coms`: centres of mass of the bodies in their own frames (m); the chain's own if None.
    """
    coms = [body.com for body in chain.bodies] if coms is None else coms
    axes, origins = np.empty((2, len(chain.slots), 3, count))
    bodies, body_axes = np.empty((len(chain.bodies), 3, count)), np.empty((len(chain.bodies), 3, 3, count))
    tool = np.empty((4, 3, count))
    body = 0
    for k, columns, p in _outwards(chain, values):
        while body < len(chain.bodies) and chain.bodies[body].before == k:
            x, y, z = coms[body]
            body_axes[body, X], body_axes[body, Y], body_axes[body, Z] = columns
            bodies[body] = p + x * columns[X] + y * columns[Y] + z * columns[Z]
            body += 1
        if k < len(chain.slots):
            axes[k], origins[k] = columns[chain.slots[k].axis], p
    tool[X], tool[Y], tool[Z], tool[3] = *columns, p
    return ChainGeometry(axes, origins, bodies, body_axes, tool)


def frames(chain: Chain, values: Sequence[Number], count: int) -> Array:
    """Homogeneous frames (N, L + 2, 4, 4) for slots' amounts (rad, m): base, after link 1 … L, tool; m."""
    out = np.zeros((len(chain.frame_ends), 4, 4, count))
    out[:, 3, 3] = 1.0
    end = 0
    for k, columns, p in _outwards(chain, values):
        while end < len(out) and chain.frame_ends[end] == k:
            out[end, :3, X], out[end, :3, Y], out[end, :3, Z], out[end, :3, 3] = *columns, p
            end += 1
    return out.transpose(3, 0, 1, 2)


def _outwards(chain: Chain, values: Sequence[Number]) -> Iterator[tuple[int, list[Array], Array]]:
    """The frame before every slot, and last the tool's: number of the slot, columns x, y, z and origin.

    Each (3, N), or (3, 1) as long as all poses share it.
    """
    angles = trig(chain, values)
    columns, p = [np.eye(3)[:, [axis]] for axis in (X, Y, Z)], np.zeros((3, 1))
    for k, slot in enumerate(chain.slots):
        yield k, columns, p
        if slot.rotates:
            columns = list(columns)
            rotate(columns, INVERSE[slot.axis], angles[k])  # type: ignore[arg-type]
        elif not is_zero(values[k]):
            p = p + values[k] * columns[slot.axis]
    yield len(chain.slots), columns, p
