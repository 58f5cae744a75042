"""The moving slots of a chain, everything that never moves joined by fixed transforms, as the kernel takes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array
from lrm_math.kinematics.chain import Chain, rotation_about
from lrm_math.kinematics.statics import Weight

Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class MovingSlots:
    """The moving slots of a chain and the rigid transforms between them.

    Attributes:
        slots: (V,), numbers of the moving slots in the chain, ascending.
        joints, others: (n,), (W,), positions among them of joints and of other slots.
        axes: (V,), 0 to 2 for a turn about x, y, z, 3 to 5 for a translation.
        fixed: (V + 1, 4, 4), the transform to each slot, and from the last one to the TCP (m).
        inboard: (B,), number of moving slots inboard of each body; `body_frames`: (B, 4, 4), its frame there.
        frame_inboard, frames: the same of the base, after joint 1 … n, and of the tool, (n + 2,) and (n + 2, 4, 4).
        counted, moved: (V,), the first body that a slot's load counts, and that the slot moves.
        gravity: (3,), m/s².
        mimics, leaders: (K,), positions among them of following joints, and of those that they follow; ratio: (K,).
    """

    slots: Indices
    joints: Indices
    others: Indices
    axes: Indices
    fixed: Array
    inboard: Indices
    body_frames: Array
    frame_inboard: Indices
    frames: Array
    counted: Indices
    moved: Indices
    gravity: Array
    mimics: Indices
    leaders: Indices
    ratio: Array

    def moments(self, weights: Sequence[Weight]) -> Array:
        """(B, 4), first mass moment (kg m) and mass (kg) of every body, in the frame of its moving slot.

        `weights`: of the bodies in chain order.
        """
        com = np.array([[*w.com, 1.0] for w in weights], dtype=np.float64).reshape(-1, 4, 1)
        mass = np.array([float(w.mass) for w in weights])
        return np.asarray(mass[:, None] * (self.body_frames @ com)[:, :, 0])


def moving_slots_of(
    chain: Chain, constants: Sequence[float], also: Sequence[int], gravity: Sequence[float]
) -> MovingSlots:
    """A chain whose slots keep the amounts `constants` (rad, m), except all joints and those in `also`.

    `gravity`: (3,), m/s².
    """
    slots = sorted({*chain.turning_slots, *also})
    edges = [-1, *slots, len(chain.slots)]

    def fixed(ends: Sequence[int]) -> tuple[Indices, Array]:
        """Numbers of moving slots inboard of some places before slots `ends`, and the places' frames there."""
        inboard = [sum(k < end for k in slots) for end in ends]
        fixed = [_fixed(chain, constants, edges[n] + 1, end) for n, end in zip(inboard, ends, strict=True)]
        return np.array(inboard, dtype=np.int64), np.array(fixed).reshape(-1, 4, 4)

    inboard, body_frames = fixed([body.before for body in chain.bodies])
    frame_inboard, frames = fixed(chain.frame_ends)
    return MovingSlots(
        slots=np.array(slots),
        joints=np.array([slots.index(k) for k in chain.joint_slots]),
        others=np.array([v for v, k in enumerate(slots) if chain.slots[k].joint is None], dtype=np.int64),
        axes=np.array([chain.slots[k].axis + (0 if chain.slots[k].rotates else 3) for k in slots]),
        fixed=np.array([_fixed(chain, constants, a + 1, b) for a, b in pairwise(edges)]),
        inboard=inboard,
        body_frames=body_frames,
        frame_inboard=frame_inboard,
        frames=frames,
        counted=np.array([chain.counted[k] for k in slots]),
        moved=np.array([chain.moved[k] for k in slots]),
        gravity=np.array(gravity),
        mimics=np.array([slots.index(k) for k, _, _ in chain.couplings], dtype=np.int64),
        leaders=np.array([slots.index(leader) for _, leader, _ in chain.couplings], dtype=np.int64),
        ratio=np.array([ratio for _, _, ratio in chain.couplings], dtype=np.float64),
    )


def _fixed(chain: Chain, constants: Sequence[float], start: int, stop: int) -> Array:
    """(4, 4), product of the slots start … stop − 1 at their constant amounts."""
    out = np.eye(4)
    for k in range(start, stop):
        slot, motion = chain.slots[k], np.eye(4)
        if slot.rotates:
            motion[:3, :3] = rotation_about(slot.axis, constants[k])
        else:
            motion[slot.axis, 3] = constants[k]
        out = out @ motion
    return out
