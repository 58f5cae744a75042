"""Forward kinematics, Jacobian and gravity loads of a batch of arm states, all that never moves welded together.

Only the slots that change from goal to goal remain: the joints, and virtual joints that effects move (a tilting base, a
bending link). A state is then a product of a handful of 4x4 matrices; screws, loads and their derivatives are array
expressions over slots, about as cheap for eight branches as for one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array
from lrm_math.kinematics.chain import Chain, Slot
from lrm_math.kinematics.statics import Weight

Indices = NDArray[np.int64]
IDENTITY = np.eye(4)


@dataclass(frozen=True, eq=False)
class LinkageState:
    """Forward kinematics of K candidates, in the base frame.

    `tcp`: (K, 4, 4), the tool frame (m). `frames`: (V + 1, K, 4, 4), the base and the frame after each moving slot.
    `axis`, `origin`: (V, 3, K), of every moving slot (unit vectors; m).
    """

    tcp: Array
    frames: Array
    axis: Array
    origin: Array


@dataclass(frozen=True, eq=False)
class MassMoments:
    """Masses that the linkage carries.

    `moment`: (B, 1, 4, 1), first mass moment and mass of every body (kg m, kg), in the frame of its moving slot.
    `outboard`: (B + 1,), mass of each body and all further outboard (kg).
    """

    moment: Array
    outboard: Array


@dataclass(frozen=True, eq=False)
class Loads:
    """Gravity loads of K candidates.

    `tau`: (V, K), on every moving slot (N·m). `lever`: (V, 3, K), gravity x axis, zero for translations.
    `outboard`: (B + 1, 3, K), first mass moment of each body and all further outboard (kg m).
    """

    tau: Array
    lever: Array
    outboard: Array


@dataclass(frozen=True, eq=False)
class Linkage:
    """The moving slots of a chain and the rigid transforms between them.

    Attributes:
        slots: (V,), numbers of the moving slots in the chain, ascending.
        joints, others, slides: (n,), (W,), (S,), positions among them of joints, other slots, translating slots.
        axes: (V,), index (0 to 2) of the axis along or about which each moves.
        pieces: (3, V, 1, 4, 4); the step to the frame after slot v is pieces[0] + c pieces[1] + s pieces[2], with c, s
            the cosine and sine of the slot's amount, or the amount and zero for a translation.
        end: (4, 4), from the last moving slot to the TCP.
        inboard_slots: (B,), number of moving slots inboard of each body; `body_frames`: (B, 4, 4), its frame there.
        counted, moved: (V,), the first body that a slot's load counts, and that the slot moves.
        gravity_cross: (3, 3), matrix of the cross product with gravity (m/s²).
    """

    slots: Indices
    joints: Indices
    others: Indices
    slides: Indices
    axes: Indices
    pieces: Array
    end: Array
    inboard_slots: Indices
    body_frames: Array
    counted: Indices
    moved: Indices
    gravity_cross: Array

    @cached_property
    def after(self) -> Indices:
        """(V,), number of the frame after each moving slot."""
        return np.arange(1, len(self.slots) + 1)

    @cached_property
    def inner(self) -> NDArray[np.bool_]:
        """(V, V, 1), whether slot k is inboard of slot j, or is it."""
        return (self.after[:, None] <= self.after)[:, :, None]

    def forward(self, amounts: Array) -> LinkageState:
        """Forward kinematics at slot amounts (K, V), rad or m."""
        c, s = np.cos(amounts.T), np.sin(amounts.T)
        for v in self.slides:
            c[v], s[v] = amounts[:, v], 0.0
        fixed, by_c, by_s = self.pieces
        steps = fixed + c[:, :, None, None] * by_c + s[:, :, None, None] * by_s
        frames = np.empty((len(steps) + 1, *steps.shape[1:]))
        frames[0] = IDENTITY
        for v, step in enumerate(steps):
            np.matmul(frames[v], step, out=frames[v + 1])
        axis = frames[self.after, :, :3, self.axes].transpose(0, 2, 1)
        return LinkageState(frames[-1] @ self.end, frames, axis, frames[1:, :, :3, 3].transpose(0, 2, 1))

    def jacobian(self, state: LinkageState) -> Array:
        """(K, 6, V): TCP velocity (m/rad or 1) above angular velocity, base frame, slot by slot."""
        out = np.empty((len(state.axis), 6, len(state.tcp)))
        out[:, 3:] = state.axis
        out[:, :3] = cross(state.axis, state.tcp[:, :3, 3].T - state.origin)
        for v in self.slides:
            out[v, :3], out[v, 3:] = state.axis[v], 0.0
        return out.transpose(2, 1, 0)

    def loads(self, state: LinkageState, masses: MassMoments) -> Loads:
        """Gravity loads on the moving slots."""
        centres = (state.frames[self.inboard_slots] @ masses.moment).transpose(0, 2, 1, 3)[:, :3, :, 0]
        outboard = np.zeros((len(centres) + 1, 3, len(state.tcp)))
        np.cumsum(centres[::-1], axis=0, out=outboard[-2::-1])
        lever = self.gravity_cross @ state.axis
        for v in self.slides:
            lever[v] = 0.0
        counted = outboard[self.counted] - masses.outboard[self.counted, None, None] * state.origin
        return Loads(np.einsum("vck,vck->vk", lever, counted), lever, outboard)

    @cached_property
    def behind(self) -> tuple[Indices, Indices]:
        """Slots k outboard of j where the load of k also counts bodies inboard of j."""
        k, j = np.nonzero(self.counted[:, None] < self.moved)
        return k[j < k], j[j < k]

    def load_derivatives(self, state: LinkageState, masses: MassMoments, loads: Loads) -> Array:
        """(V, V, K): ∂tau_k/∂s_j, as `statics.load_derivatives`: the Hessian of gravity's potential energy.

        Not symmetric where loads count bodies that their slots do not move.
        """
        every = np.arange(len(self.slots))
        by_outer = self._swept(state, masses, loads, every, self.moved)
        by_inner = self._swept(state, masses, loads, every, self.counted)
        outer, inner = (np.einsum("ack,bck->abk", loads.lever, swept) for swept in (by_outer, by_inner))
        out = np.asarray(np.where(self.inner, outer, inner.transpose(1, 0, 2)))
        k, j = self.behind
        unmoved = self._swept(state, masses, loads, j, self.counted[k]) - by_outer[j]
        out[k, j] -= np.einsum("pck,pck->pk", loads.lever[k], unmoved)
        return out

    def _swept(self, state: LinkageState, masses: MassMoments, loads: Loads, slots: Indices, first: Indices) -> Array:
        """(len(slots), 3, K): derivative by slot motion of the mass moment of bodies from `first` outwards."""
        mass, axis = masses.outboard[first, None, None], state.axis[slots]
        swept = cross(axis, loads.outboard[first] - mass * state.origin[slots])
        slides = np.isin(slots, self.slides)
        swept[slides] = (mass * axis)[slides]
        return swept

    def mass_moments(self, weights: Sequence[Weight]) -> MassMoments:
        """From the weights of the bodies in chain order (each the same for all candidates)."""
        mass = np.array([float(w.mass) for w in weights])
        com = np.array([[*w.com, 1.0] for w in weights], dtype=np.float64).reshape(-1, 4, 1)
        moment = mass[:, None, None] * (self.body_frames @ com)
        return MassMoments(moment[:, None], np.concatenate([np.cumsum(mass[::-1])[::-1], [0.0]]))


def cross(a: Array, b: Array) -> Array:
    """(V, 3, K), cross product over the middle axis; `b` may be (1, 3, K)."""
    out = np.empty_like(a)
    for x, y, z in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.subtract(a[:, y] * b[:, z], a[:, z] * b[:, y], out=out[:, x])
    return out


def linkage_of(chain: Chain, constants: Sequence[float], also: Sequence[int]) -> Linkage:
    """A chain whose slots keep the amounts `steady` (rad, m), except the joints and those in `also`."""
    slots = sorted({*chain.joint_slots, *also})
    edges = [-1, *slots, len(chain.slots)]
    welds = [_weld(chain, constants, a + 1, b) for a, b in pairwise(edges)]
    x, y, z = chain.gravity
    motions = np.array([_motion(chain.slots[k]) for k in slots])
    inboard = [sum(k < body.before for k in slots) for body in chain.bodies]
    body_frames = [_weld(chain, constants, edges[n] + 1, b.before) for n, b in zip(inboard, chain.bodies, strict=True)]
    return Linkage(
        slots=np.array(slots),
        joints=np.array([slots.index(k) for k in chain.joint_slots]),
        others=np.array([v for v, k in enumerate(slots) if chain.slots[k].joint is None], dtype=np.int64),
        slides=np.array([v for v, k in enumerate(slots) if not chain.slots[k].rotates], dtype=np.int64),
        axes=np.array([chain.slots[k].axis for k in slots]),
        pieces=(np.array(welds[:-1]) @ motions.transpose(1, 0, 2, 3))[:, :, None],
        end=welds[-1],
        inboard_slots=np.array(inboard, dtype=np.int64),
        body_frames=np.array(body_frames).reshape(-1, 4, 4),
        counted=np.array([chain.counted[k] for k in slots]),
        moved=np.array([chain.moved[k] for k in slots]),
        gravity_cross=np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]),
    )


def _weld(chain: Chain, constants: Sequence[float], start: int, stop: int) -> Array:
    """(4, 4), product of the slots start … stop − 1 at their steady amounts."""
    out = np.eye(4)
    for k in range(start, stop):
        fixed, by_c, by_s = _motion(chain.slots[k])
        c, s = (np.cos(constants[k]), np.sin(constants[k])) if chain.slots[k].rotates else (constants[k], 0.0)
        out = out @ (fixed + c * by_c + s * by_s)
    return out


def _motion(slot: Slot) -> Array:
    """(3, 4, 4): constant part of a slot's transform, and its parts times cosine and sine (or times the length)."""
    out = np.zeros((3, 4, 4))
    if not slot.rotates:
        out[0], out[1, slot.axis, 3] = np.eye(4), 1.0
        return out
    i, j = (slot.axis + 1) % 3, (slot.axis + 2) % 3
    out[0, slot.axis, slot.axis] = out[0, 3, 3] = 1.0
    out[1, i, i] = out[1, j, j] = 1.0
    out[2, j, i], out[2, i, j] = 1.0, -1.0
    return out
