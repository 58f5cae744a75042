"""Statics: gravity's generalised force on every slot of the chain, and its derivatives.

The load of a slot is the generalised force tau = −∂V/∂s of gravity: for a rotation the moment about its axis (N·m),
for a translation the force along it (N). Thesis Eqs 2.44 to 2.48 are the case of the joint axes.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from lrm_math.arrays import Array
from lrm_math.kinematics.chain import INVERSE, PLANE, Angle, AttachedBody, Chain, Number, Vector, is_zero, rotate, trig
from lrm_math.kinematics.forward import ChainGeometry

Gravity: TypeAlias = tuple[Number, Number, Number]
"""Components of gravity in the frame of measurement (m/s²), floats or (N,)."""
Loads: TypeAlias = "Sequence[Number] | Array"
"""Loads on several slots, each a float or (N,), or derivatives of each."""


LEAST_MASS = 1e-12
"""kg: of what has no mass at all, whose centre does not matter."""


@dataclass(frozen=True)
class WeightChange:
    """Change of one body: mass (kg) and shift of its centre of mass in its own frame (m), floats or (N,)."""

    mass: Number = 0.0
    shift: tuple[Number, Number, Number] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Weight:
    """A body's mass (kg) and centre of mass in its own frame (m), floats or (N,)."""

    mass: Number
    com: tuple[Number, Number, Number]


def weights(chain: Chain, payload: Number, added: Iterable[tuple[int, WeightChange]] = ()) -> tuple[Weight, ...]:
    """Every body in chain order, the payload (kg, float or `(N,)`) and the changes `added` (by number) included."""
    out = [_loaded(body, payload) for body in chain.bodies]
    for number, ballast in added:
        x, y, z = (c + s for c, s in zip(out[number].com, ballast.shift, strict=True))
        out[number] = Weight(out[number].mass + ballast.mass, (x, y, z))
    return tuple(out)


def _loaded(body: AttachedBody, payload: Number) -> Weight:
    """A body with the payload (kg, float or `(N,)`) that it carries: their mass, and their common centre."""
    if not body.carries_payload:
        return Weight(body.mass, body.com)
    mass = body.mass + payload
    if not any(body.load_at):
        return Weight(mass, body.com)
    share = payload / np.maximum(mass, LEAST_MASS)
    x, y, z = (c + share * shift for c, shift in zip(body.com, body.load_at, strict=True))
    return Weight(mass, (x, y, z))


def loads(
    chain: Chain,
    values: Sequence[Number],
    angles: Sequence[Angle],
    weights: Sequence[Weight],
    gravity: Gravity,
    load_slots: Sequence[int],
) -> list[Number]:
    """Gravity's load (`gravity` in m/s²) on the slots `load_slots` (ascending): N·m on a rotation, N on a translation.

    A joint that others follow bears their torques too (`virtual_work`).
    """
    return list(
        virtual_work(chain, load_slots, lambda slots: _each_load(chain, values, angles, weights, gravity, slots))
    )


def virtual_work(chain: Chain, load_slots: Sequence[int], loads_on: Callable[[Sequence[int]], Loads]) -> Loads:
    """Generalised forces on `load_slots`, or their derivatives, for motions of slots that carry following joints along.

    `loads_on`: those on slots (ascending) that each move alone. What follows adds its torque times its ratio.
    """
    led = [coupling for coupling in chain.couplings if coupling[1] in load_slots]
    if not led:
        return loads_on(load_slots)
    wider = sorted({*load_slots, *(k for k, _, _ in led)})
    alone = dict(zip(wider, loads_on(wider), strict=True))
    out = {k: alone[k] for k in load_slots}
    for k, leader, ratio in led:
        out[leader] = out[leader] + ratio * alone[k]
    return [out[k] for k in load_slots]


def _each_load(
    chain: Chain,
    values: Sequence[Number],
    angles: Sequence[Angle],
    weights: Sequence[Weight],
    gravity: Gravity,
    load_slots: Sequence[int],
) -> list[Number]:
    """Gravity's load on each of `load_slots` that moves alone.

    Two recursions in the slots' own frames: gravity's direction outwards, the first mass moment Σ m c inwards.
    """
    seen = _gravity_outwards(chain, angles, gravity, load_slots)
    out: list[Number] = [0.0] * len(load_slots)
    moment: Vector = [0.0, 0.0, 0.0]
    carried: Number = 0.0
    body, row = len(chain.bodies) - 1, len(load_slots) - 1
    for k in range(len(chain.slots) - 1, (load_slots[0] if load_slots else 0) - 1, -1):
        while body >= 0 and chain.bodies[body].before > k:
            mass = weights[body].mass
            moment = [m if is_zero(c) else m + mass * c for m, c in zip(moment, weights[body].com, strict=True)]
            carried = carried + mass
            body -= 1
        slot = chain.slots[k]
        if slot.rotates:
            rotate(moment, PLANE[slot.axis], angles[k])
        elif not is_zero(values[k]):
            moment[slot.axis] = moment[slot.axis] + carried * values[k]
        if row >= 0 and load_slots[row] == k:
            g = seen[row]
            if slot.rotates:
                counted = _with_bodies_behind(chain, values, angles, weights, k, moment)
                i, j = PLANE[slot.axis]
                out[row] = counted[i] * g[j] - counted[j] * g[i]
            else:
                behind = sum((weights[n].mass for n in range(chain.counted[k], chain.moved[k])), 0.0)
                out[row] = (carried + behind) * g[slot.axis]
            row -= 1
    return out


def joint_torques(chain: Chain, gravity: Gravity, q: Sequence[float], payload: float) -> list[float]:
    """Gravity's torque (N·m) on every joint of the rigid nominal arm at angles q (rad), with a payload (kg)."""
    values = chain.values(q)
    torques = loads(chain, values, trig(chain, values), weights(chain, payload), gravity, chain.joint_slots)
    return [float(torque) for torque in torques]


def _gravity_outwards(
    chain: Chain, angles: Sequence[Angle], gravity: Gravity, load_slots: Sequence[int]
) -> list[Vector]:
    """Gravity (m/s²) in the frame before each of `load_slots`."""
    g: Vector = list(gravity)
    out: list[Vector] = []
    for k in range((load_slots[-1] if load_slots else -1) + 1):
        slot = chain.slots[k]
        if load_slots[len(out)] == k:
            out.append(list(g))
        if slot.rotates:
            rotate(g, INVERSE[slot.axis], angles[k])
    return out


def _with_bodies_behind(
    chain: Chain, values: Sequence[Number], angles: Sequence[Angle], weights: Sequence[Weight], k: int, moment: Vector
) -> Vector:
    """Adds the bodies behind slot k that the arm file lets it carry (`loads_joint`; links 1, 3, 5 of the rig)."""
    for number in range(chain.counted[k], chain.moved[k]):
        body = chain.bodies[number]
        com: Vector = list(weights[number].com)
        for between in range(body.before, k):
            slot = chain.slots[between]
            if slot.rotates:
                rotate(com, INVERSE[slot.axis], angles[between])
            elif not is_zero(values[between]):
                com[slot.axis] = com[slot.axis] - values[between]
        moment = [m + weights[number].mass * c for m, c in zip(moment, com, strict=True)]
    return moment


def load_derivatives(
    chain: Chain, geometry: ChainGeometry, weights: Sequence[Weight], gravity: Gravity, load_slots: Sequence[int]
) -> Array:
    """∂tau_k/∂s_j for the slots k in `load_slots` and every slot j: (K, S, N).

    With a the axis of a slot, S the first mass moment that it carries about its origin, g gravity:
    h = g × a (zero for a translation) and u = a × S (m a for a translation) give ∂tau_k/∂s_j = h_inner · u_outer,
    the Hessian of −V. Bodies that load a slot that does not move them are corrected for.
    """

    def alone(slots: Sequence[int]) -> Array:
        return carried_along(chain, _each_load_derivative(chain, geometry, weights, gravity, slots), axis=1)

    return np.asarray(virtual_work(chain, load_slots, alone)).reshape(len(load_slots), *geometry.axis.shape[::2])


def carried_along(chain: Chain, by_slot: Array, axis: int = 0) -> Array:
    """Derivatives by motions of slots that carry following joints along, from those by each alone; in place.

    `axis`: that of the slots.
    """
    along = np.moveaxis(by_slot, axis, 0)
    for k, leader, ratio in chain.couplings:
        along[leader] += ratio * along[k]
    return by_slot


def _each_load_derivative(
    chain: Chain, geometry: ChainGeometry, weights: Sequence[Weight], gravity: Gravity, load_slots: Sequence[int]
) -> Array:
    """`load_derivatives` of the loads on slots, and by slots, that each move alone."""
    m, mc = _suffix_moments(geometry, weights)
    moved = list(chain.moved)
    u = _levers(chain, geometry, slice(None), m[moved], mc[moved])
    h = _levers_of_gravity(chain, geometry, gravity, slice(None))
    out = np.empty((len(load_slots), *geometry.axis.shape[::2]))
    for row, k in enumerate(load_slots):
        first, u_k = chain.counted[k], u[k]
        behind = slice(bisect_right(chain.moved, first, hi=k), k)
        if first < chain.moved[k]:
            u_k = _levers(chain, geometry, slice(k, k + 1), m[first], mc[first])[0]
        np.einsum("jcn,cn->jn", h[:k], u_k, out=out[row, :k])
        np.einsum("cn,jcn->jn", h[k], u[k:], out=out[row, k:])
        if behind.start < k:
            differences = _levers(chain, geometry, behind, m[first] - m[moved[behind]], mc[first] - mc[moved[behind]])
            out[row, behind] -= np.einsum("cn,jcn->jn", h[k], differences)
    return out


def weight_derivatives(
    chain: Chain,
    geometry: ChainGeometry,
    weights: Sequence[Weight],
    gravity: Gravity,
    load_slots: Sequence[int],
    body: int,
) -> tuple[Array, Array]:
    """∂tau/∂mass (K, N) and ∂tau/∂com (K, 3, N) of the slots `load_slots`, for one body's mass and centre of mass."""
    if not chain.couplings:
        return _each_weight_derivative(chain, geometry, weights, gravity, load_slots, body)

    def alone(slots: Sequence[int]) -> Array:
        by_mass, by_com = _each_weight_derivative(chain, geometry, weights, gravity, slots, body)
        return np.concatenate([by_mass[:, None], by_com], axis=1)

    derivatives = np.array(virtual_work(chain, load_slots, alone)).reshape(len(load_slots), 4, -1)
    return derivatives[:, 0], derivatives[:, 1:]


def _each_weight_derivative(
    chain: Chain, geometry: ChainGeometry, weights: Sequence[Weight], gravity: Gravity, slots: Sequence[int], body: int
) -> tuple[Array, Array]:
    """`weight_derivatives` of the loads on slots that each move alone."""
    load_slots = list(slots)
    h = _levers_of_gravity(chain, geometry, gravity, load_slots)
    counts = np.array([chain.counted[k] <= body for k in load_slots], dtype=np.float64)[:, None]
    by_mass = np.einsum("kcn,kcn->kn", h, geometry.body[body] - geometry.origin[load_slots])
    along = sum(g * geometry.axis[load_slots, c] for c, g in enumerate(gravity))
    by_mass += ~chain.rotates[load_slots][:, None] * along
    by_com = np.einsum("kcn,acn->kan", h, geometry.body_axes[body]) * weights[body].mass
    return counts * by_mass, counts[:, :, None] * by_com


def gravity_derivatives(
    chain: Chain, geometry: ChainGeometry, weights: Sequence[Weight], load_slots: Sequence[int]
) -> Array:
    """∂tau_k/∂g of the slots `load_slots` by the components of gravity: (K, 3, N), kg m or kg.

    tau = g · (a × S), with a the axis of a slot and S the first mass moment that its load counts about its origin;
    g · m a for a translation.
    """

    def alone(slots: Sequence[int]) -> Array:
        return _each_gravity_derivative(chain, geometry, weights, slots)

    return np.asarray(virtual_work(chain, load_slots, alone)).reshape(len(load_slots), *geometry.axis.shape[1:])


def _each_gravity_derivative(
    chain: Chain, geometry: ChainGeometry, weights: Sequence[Weight], load_slots: Sequence[int]
) -> Array:
    """`gravity_derivatives` of the loads on slots that each move alone."""
    m, mc = _suffix_moments(geometry, weights)
    out = np.empty((len(load_slots), *geometry.axis.shape[1:]))
    for row, k in enumerate(load_slots):
        first = chain.counted[k]
        out[row] = _levers(chain, geometry, slice(k, k + 1), m[first], mc[first])[0]
    return out


def _levers_of_gravity(chain: Chain, geometry: ChainGeometry, gravity: Gravity, slots: Sequence[int] | slice) -> Array:
    """(len(slots), 3, N): h = g × a of rotating slots, zero for translations; tau = h · (first mass moment)."""
    x, y, z = gravity
    a = geometry.axis[slots]
    h = np.empty_like(a)
    h[:, 0], h[:, 1], h[:, 2] = y * a[:, 2] - z * a[:, 1], z * a[:, 0] - x * a[:, 2], x * a[:, 1] - y * a[:, 0]
    h[~chain.rotates[slots]] = 0.0
    return h


def _suffix_moments(geometry: ChainGeometry, weights: Sequence[Weight]) -> tuple[Array, Array]:
    """Mass (B + 1, 1, N) in kg and world first moment (B + 1, 3, N) of all bodies from number b = 0 … B outwards."""
    B, N = geometry.body.shape[::2]
    m, mc = np.zeros((B + 1, 1, N)), np.zeros((B + 1, 3, N))
    for number in range(B - 1, -1, -1):
        m[number] = m[number + 1] + weights[number].mass
        mc[number] = mc[number + 1] + weights[number].mass * geometry.body[number]
    return m, mc


def _levers(chain: Chain, geometry: ChainGeometry, slots: slice, m: Array, mc: Array) -> Array:
    """∂(Σ m c)/∂s, (…, 3, N), of the bodies with total mass m and first moment mc, for a slice of the slots."""
    axis = geometry.axis[slots]
    out = cross(axis, mc - m * geometry.origin[slots])
    slides = ~chain.rotates[slots]
    out[slides] = np.broadcast_to(m, (len(out), *m.shape[-2:]))[slides] * axis[slides]
    return out


def cross(a: Array, b: Array) -> Array:
    """Cross product over the component axis, the last but one: (..., 3, N)."""
    a0, a1, a2 = a[..., 0, :], a[..., 1, :], a[..., 2, :]
    b0, b1, b2 = b[..., 0, :], b[..., 1, :], b[..., 2, :]
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    out[..., 0, :], out[..., 1, :], out[..., 2, :] = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
    return out
