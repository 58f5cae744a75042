"""Total derivatives of the TCP through the elastic equilibrium.

At rest s = s0 + E(tau(s)), with s the slots' amounts, E the effects and tau the loads. A small motion δ added to the
slots therefore ends as ds = δ + D H ds with D = ∂E/∂tau and H = ∂tau/∂s, and moves the TCP by (implicit function)

    dx = (J + Λ H) δ,   Λ = J_E D (I − H D)⁻¹,

J being the geometric Jacobian of the slots. Every parameter of every effect is such a motion.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lrm_math import statics
from lrm_math.chain import Array, Chain, Number, Walk, walk
from lrm_math.effects import Effect
from lrm_math.model import Equilibrium


def slot_jacobian(chain: Chain, geometry: Walk) -> Array:
    """Geometric Jacobian of the TCP for every slot, rigid arm: (S, 3, N), m/rad or 1."""
    rotates = np.array([slot.rotates for slot in chain.slots])
    out = geometry.axis.copy()
    turning = geometry.axis[rotates]
    out[rotates] = statics.cross(turning, geometry.tcp - geometry.origin[rotates])
    return out


def total_slot_jacobian(rest: Equilibrium) -> Array:
    """The TCP's motion for a unit motion added at each slot, the arm coming to rest again: (S, 3, N), m/rad or 1."""
    model, chain = rest.model, rest.model.chain
    geometry = walk(chain, rest.slots, len(rest.poses))
    rigid = slot_jacobian(chain, geometry)
    if not model.felt:
        return rigid
    mass = statics.masses(chain, rest.poses.payload)
    H = statics.load_derivatives(chain, geometry, mass, model.felt)
    D, moved = _effect_stiffness(rest)
    loop = np.einsum("ksn,sjn->nkj", H[:, moved], D)
    push = np.einsum("scn,sjn->njc", rigid[moved], D)
    system = np.eye(len(model.felt)) - loop
    response = np.linalg.solve(system.transpose(0, 2, 1), push)
    return np.asarray(rigid + np.einsum("nkc,ksn->scn", response, H))


def parameter_jacobian(rest: Equilibrium, keys: Sequence[str] | None = None) -> Array:
    """∂TCP/∂parameters through the equilibrium: (N, 3, P), SI, for `keys` (every parameter if None)."""
    model = rest.model
    wanted = model.keys if keys is None else tuple(keys)
    position = {key: column for column, key in enumerate(wanted)}
    G = total_slot_jacobian(rest)
    out = np.zeros((len(wanted), 3, len(rest.poses)))
    for effect, span in zip(model.effects, model.spans, strict=True):
        columns = [position.get(key) for key in model.keys[span]]
        if any(column is not None for column in columns):
            rows = effect.d_parameters(rest.poses, _felt_by(effect, rest), model.values[span].tolist())
            for column, amounts in zip(columns, rows, strict=True):
                if column is not None:
                    out[column] = _moved_by(effect, amounts, chain=model.chain, G=G)
    return out.transpose(2, 1, 0)


def joint_jacobian(rest: Equilibrium) -> Array:
    """∂TCP/∂q of the commanded joint angles through the equilibrium: (N, 3, n), m/rad."""
    model = rest.model
    G = total_slot_jacobian(rest)
    out = G[list(model.chain.joint_slots)]
    for effect, span in zip(model.effects, model.spans, strict=True):
        if effect.follows_angles:
            rows = effect.d_q(rest.poses, _felt_by(effect, rest), model.values[span].tolist())
            for joint, amounts in enumerate(rows):
                out[joint] += _moved_by(effect, amounts, chain=model.chain, G=G)
    return out.transpose(2, 1, 0)


def _moved_by(effect: Effect, amounts: Sequence[Number], chain: Chain, G: Array) -> Array:
    """(3, N): the TCP's motion for these amounts at the slots that the effect moves."""
    total = np.zeros(G.shape[1:])
    for key, amount in zip(effect.moves, amounts, strict=True):
        if not (isinstance(amount, float) and amount == 0.0):
            total += G[chain.index[key]] * amount
    return total


def _felt_by(effect: Effect, rest: Equilibrium) -> tuple[Number, ...]:
    load = dict(zip(rest.model.felt, rest.tau, strict=True))
    return tuple(load[rest.model.chain.index[key]] for key in effect.feels)


def _effect_stiffness(rest: Equilibrium) -> tuple[Array, list[int]]:
    """D = ∂E/∂tau (M, K, N) for the slots that elastic effects move, and those slots' numbers."""
    model, index = rest.model, rest.model.chain.index
    elastic = [(e, span) for e, span in zip(model.effects, model.spans, strict=True) if e.feels]
    moved = sorted({index[key] for e, _ in elastic for key in e.moves})
    D = np.zeros((len(moved), len(model.felt), len(rest.poses)))
    for effect, span in elastic:
        rows = effect.d_tau(rest.poses, _felt_by(effect, rest), model.values[span].tolist())
        for felt, amounts in zip(effect.feels, rows, strict=True):
            for key, amount in zip(effect.moves, amounts, strict=True):
                D[moved.index(index[key]), model.felt.index(index[felt])] += amount
    return D, moved
