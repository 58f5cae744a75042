"""Total derivatives of the TCP through the elastic equilibrium.

At rest s = s0 + E(tau(s)), with s the slots' amounts, E the effects and tau the loads. A small motion δ added to the
slots therefore ends as ds = δ + D H ds with D = ∂E/∂tau and H = ∂tau/∂s, and moves the TCP by (implicit function)

    dx = (J + Λ H) δ,   Λ = J_E D (I − H D)⁻¹,

J being the geometric Jacobian of the slots. Every parameter of every effect is such a motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lrm_math.arrays import Array
from lrm_math.effects import Effect
from lrm_math.effects.base import STEP
from lrm_math.kinematics import statics
from lrm_math.kinematics.chain import Chain, Number
from lrm_math.kinematics.forward import Walk, walk
from lrm_math.model.equilibrium import Equilibrium


def slot_jacobian(chain: Chain, geometry: Walk) -> Array:
    """Geometric Jacobian of the TCP for every slot, rigid arm: (S, 3, N), m/rad or 1."""
    rotates = np.array([slot.rotates for slot in chain.slots])
    out = geometry.axis.copy()
    turning = geometry.axis[rotates]
    out[rotates] = statics.cross(turning, geometry.tcp - geometry.origin[rotates])
    return out


@dataclass(frozen=True, eq=False)
class Response:
    """How the TCP, as the tracker sees it, answers small changes, the arm coming to rest again each time.

    Attributes:
        rest: the equilibrium that is left a little.
        geometry: its screws and bodies.
        slots: (S, 3, N), TCP's motion for a unit motion added at each slot (m/rad or 1).
        loads: (K, 3, N), TCP's motion for a unit load added on each slot of `model.felt` (m/N·m).
    """

    rest: Equilibrium
    geometry: Walk
    slots: Array
    loads: Array


def respond(rest: Equilibrium) -> Response:
    """The response at an equilibrium."""
    model, chain = rest.model, rest.model.chain
    geometry = walk(chain, rest.slots, len(rest.poses), [weight.com for weight in rest.weights])
    rigid = slot_jacobian(chain, geometry)
    if not model.felt:
        return _through_the_tracker(Response(rest, geometry, rigid, np.empty((0, 3, len(rest.poses)))))
    H = statics.load_derivatives(chain, geometry, rest.weights, model.felt)
    D, moved = _effect_stiffness(rest)
    system = np.eye(len(model.felt)) - np.einsum("ksn,sjn->nkj", H[:, moved], D)
    push = np.einsum("scn,sjn->njc", rigid[moved], D)
    answer = np.linalg.solve(system.transpose(0, 2, 1), push)
    total = rigid + np.einsum("nkc,ksn->scn", answer, H)
    return _through_the_tracker(Response(rest, geometry, total, answer.transpose(1, 2, 0)))


def _through_the_tracker(response: Response) -> Response:
    """The same response as a distorted frame of measurement shows it."""
    rest = response.rest
    for effect, p in rest.model.parts():
        if effect.seen(rest.true_tcp[:1], p) is not None:
            distort = np.eye(3) + np.stack([effect.seen(axis[None, :], p)[0] for axis in np.eye(3)], axis=1)  # type: ignore[index]
            slots, loads = (np.einsum("dc,scn->sdn", distort, moves) for moves in (response.slots, response.loads))
            response = replace(response, slots=slots, loads=loads)
    return response


def parameter_jacobian(rest: Equilibrium, keys: Sequence[str] | None = None) -> Array:
    """∂TCP/∂parameters through the equilibrium: (N, 3, P), SI, for `keys` (every parameter if None)."""
    model, response = rest.model, respond(rest)
    wanted = model.keys if keys is None else tuple(keys)
    position = {key: column for column, key in enumerate(wanted)}
    out = np.zeros((len(wanted), 3, len(rest.poses)))
    for effect, span in zip(model.effects, model.spans, strict=True):
        columns = [position.get(key) for key in model.keys[span]]
        if any(column is not None for column in columns):
            moved = effect_columns(effect, model.values[span].tolist(), response)
            for column, motion in zip(columns, moved, strict=True):
                if column is not None:
                    out[column] = motion
    return out.transpose(2, 1, 0)


def effect_columns(effect: Effect, p: Sequence[float], response: Response) -> Array:
    """∂TCP/∂p of one effect at parameter values p: (P, 3, N), SI. Its slots must be felt by the response's model."""
    rest, index = response.rest, response.rest.model.chain.index
    out = np.zeros((len(p), 3, len(rest.poses)))
    if effect.moves:
        for j, amounts in enumerate(effect.d_parameters(rest.poses, _felt_by(effect, rest), p)):
            _add_moved(out[j], effect, amounts, index, response.slots)
    units = np.eye(len(p)).tolist()
    felt = {k: row for row, k in enumerate(rest.model.felt)}
    for key, *loads in zip(effect.pushes, *(effect.push(rest.poses, unit) for unit in units), strict=True):
        if index[key] in felt:
            for j, load in enumerate(loads):
                out[j] += response.loads[felt[index[key]]] * load
    for body, *added in zip(effect.weighs, *(effect.weight(rest.poses.carried, unit) for unit in units), strict=True):
        if felt:
            args = (rest.model.chain, response.geometry, rest.weights, rest.model.felt, body)
            by_mass, by_com = statics.weight_derivatives(*args)
            for j, ballast in enumerate(added):
                load = by_mass * ballast.mass + sum(by_com[:, axis] * ballast.shift[axis] for axis in range(3))
                out[j] += np.einsum("kcn,kn->cn", response.loads, load)
    for j, unit in enumerate(units):
        shift = effect.seen(rest.true_tcp, unit)
        if shift is not None:
            out[j] += shift.T
    return out


def joint_jacobian(rest: Equilibrium) -> Array:
    """∂TCP/∂q of the commanded joint angles through the equilibrium: (N, 3, n), m/rad."""
    model, response = rest.model, respond(rest)
    index, felt = model.chain.index, {k: row for row, k in enumerate(model.felt)}
    out = response.slots[list(model.chain.joint_slots)]
    for effect, p in model.parts():
        if effect.follows_angles and effect.moves:
            rows = effect.d_q(rest.poses, _felt_by(effect, rest), p)
            for joint, amounts in enumerate(rows):
                _add_moved(out[joint], effect, amounts, index, response.slots)
        for i, key in enumerate(effect.pushes):
            for joint in range(model.arm.dof if index[key] in felt else 0):
                plus, minus = (effect.push(rest.poses.nudged(joint, h), p)[i] for h in (STEP, -STEP))
                out[joint] += response.loads[felt[index[key]]] * ((plus - minus) / (2.0 * STEP))
    return out.transpose(2, 1, 0)


def _add_moved(out: Array, effect: Effect, amounts: Sequence[Number], index: dict[str, int], slots: Array) -> None:
    """Adds to out (3, N) the TCP's motion for these amounts at the slots that the effect moves."""
    for key, amount in zip(effect.moves, amounts, strict=True):
        if not (isinstance(amount, float) and amount == 0.0):
            out += slots[index[key]] * amount


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
