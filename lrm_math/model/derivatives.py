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
from lrm_math.kinematics.chain import Chain, Number, is_zero
from lrm_math.kinematics.forward import ChainGeometry, chain_geometry
from lrm_math.model.equilibrium import Equilibrium
from lrm_math.model.sensed import TCP_ONLY, Sensed, along_distance


def slot_jacobian(chain: Chain, geometry: ChainGeometry) -> Array:
    """Geometric Jacobian of the TCP for every slot, rigid arm: (S, 3, N), m/rad or 1."""
    rotates = np.array([slot.rotates for slot in chain.slots])
    out = geometry.axis.copy()
    turning = geometry.axis[rotates]
    out[rotates] = statics.cross(turning, geometry.tcp - geometry.origin[rotates])
    return out


@dataclass(frozen=True, eq=False)
class Response:
    """Sensitivity of what is measured to small changes, through the equilibrium: R rows of each pose.

    Attributes:
        rest: the equilibrium at which it is linearised.
        geometry: screw axes and bodies there.
        slots: (S, R, N), ∂TCP/∂(motion added at each slot) (m/rad or 1), and of what else is `sensed`.
        loads: (K, R, N), ∂TCP/∂(load added on each slot of `model.load_slots`) (m/N·m), and of what else is sensed.
    """

    rest: Equilibrium
    geometry: ChainGeometry
    slots: Array
    loads: Array
    sensed: Sensed = TCP_ONLY


def respond(rest: Equilibrium, sensed: Sensed = TCP_ONLY) -> Response:
    """The response at an equilibrium."""
    model, chain = rest.model, rest.model.chain
    geometry = chain_geometry(chain, rest.slots, len(rest.poses), [weight.com for weight in rest.weights])
    rigid = slot_jacobian(chain, geometry)
    if sensed != TCP_ONLY:
        rigid = _with_sensed(rigid, rest, geometry, sensed)
    if not model.load_slots:
        return _as_measured(Response(rest, geometry, rigid, np.empty((0, *rigid.shape[1:])), sensed))
    H = statics.load_derivatives(chain, geometry, rest.weights, model.load_slots)
    moving = list(model.binding.moving)
    D = _elastic_compliance(rest)
    system = np.eye(len(model.load_slots)) - np.einsum("ksn,sjn->nkj", H[:, moving], D)
    deflected = np.einsum("scn,sjn->njc", rigid[moving], D)
    if sensed.feedback:
        _add_before_encoder(deflected, rest, sensed)
    by_load = np.ascontiguousarray(np.linalg.solve(system.transpose(0, 2, 1), deflected).transpose(1, 2, 0))
    total = rigid + np.einsum("kcn,ksn->scn", by_load, H)
    return _as_measured(Response(rest, geometry, total, by_load, sensed))


def _with_sensed(rigid: Array, rest: Equilibrium, geometry: ChainGeometry, sensed: Sensed) -> Array:
    """(S, R, N), the Jacobian of the TCP (S, 3, N) with the rows of its attitude, empty ones of the encoders, and that
    of its distance from a point: the TCP's motion along the line.

    An attitude error is a rotation vector in world axes. A motion that is added before an encoder adds to its row.
    """
    chain, parts = rest.model.chain, [rigid]
    if sensed.attitude:
        rotates = np.array([slot.rotates for slot in chain.slots])
        parts.append(np.where(rotates[:, None, None], geometry.axis, 0.0))
    if sensed.feedback:
        parts.append(np.zeros((len(rigid), chain.dof, rigid.shape[2])))
    if sensed.distance_from is not None:
        parts.append(np.einsum("nc,scn->sn", along_distance(rest, sensed.distance_from), rigid)[:, None])
    return np.concatenate(parts, axis=1)


def _add_before_encoder(deflected: Array, rest: Equilibrium, sensed: Sensed) -> None:
    """Adds to deflected (N, K, R) what loads do to the encoders' angles."""
    for bound in rest.model.binding.elastic:
        if bound.effect.before_encoder:
            rows = bound.effect.d_tau(rest.poses, tuple(rest.tau[i] for i in bound.feels), bound.p)
            for i, amounts in zip(bound.feels, rows, strict=True):
                for k, amount in zip(bound.moves, amounts, strict=True):
                    deflected[:, i, sensed.first_feedback + _joint(rest, k)] += amount


def _joint(rest: Equilibrium, slot: int) -> int:
    """Number of the joint whose angle a slot is."""
    joint = rest.model.chain.slots[slot].joint
    assert joint is not None, "what is before an encoder turns a joint"
    return joint


def _as_measured(response: Response) -> Response:
    """The response in the tracker's distorted frame."""
    for bound in response.rest.model.binding.distorting:
        errors = [bound.effect.seen(axis[None, :], bound.p) for axis in np.eye(3)]
        if errors[0] is not None:
            distort = np.eye(3) + np.stack([error[0] for error in errors], axis=1)  # type: ignore[index]
            slots, loads = response.slots.copy(), response.loads.copy()
            for moves in (slots, loads):
                moves[:, :3] = np.einsum("dc,scn->sdn", distort, moves[:, :3])
            response = replace(response, slots=slots, loads=loads)
    return response


def parameter_jacobian(rest: Equilibrium, keys: Sequence[str] | None = None, sensed: Sensed = TCP_ONLY) -> Array:
    """∂TCP/∂parameters through the equilibrium: (N, 3, P), SI, for `keys` (every parameter if None).

    (N, R, P) with what else is `sensed`.
    """
    model, response = rest.model, respond(rest, sensed)
    position = {key: column for column, key in enumerate(model.keys if keys is None else keys)}
    out = np.zeros((len(position), response.slots.shape[1], len(rest.poses)))
    for effect, span in zip(model.effects, model.spans, strict=True):
        columns = [position.get(key) for key in model.keys[span]]
        if any(column is not None for column in columns):
            moved = effect_columns(effect, model.values[span].tolist(), response)
            for column, motion in zip(columns, moved, strict=True):
                if column is not None:
                    out[column] = motion
    return out.transpose(2, 1, 0)


def effect_columns(effect: Effect, p: Sequence[float], response: Response) -> Array:
    """∂TCP/∂p of one effect at parameter values p: (P, R, N), SI. The model's `load_slots` must hold what it feels."""
    rest, index = response.rest, response.rest.model.chain.index
    out = np.zeros((len(p), response.slots.shape[1], len(rest.poses)))
    if effect.moves:
        for j, amounts in enumerate(effect.d_parameters(rest.poses, _loads_felt(effect, rest), p)):
            _add_motion(out[j], effect, amounts, index, response.slots)
            if effect.before_encoder and response.sensed.feedback:
                for key, amount in zip(effect.moves, amounts, strict=True):
                    out[j][response.sensed.first_feedback + _joint(rest, index[key])] += amount
    units = np.eye(len(p)).tolist()
    load_row = {k: row for row, k in enumerate(rest.model.load_slots)}
    for key, *loads in zip(effect.pushes, *(effect.push(rest.poses, unit) for unit in units), strict=True):
        if index[key] in load_row:
            for j, load in enumerate(loads):
                out[j] += response.loads[load_row[index[key]]] * load
    for body, *added in zip(effect.weighs, *(effect.weight(rest.poses.carried, unit) for unit in units), strict=True):
        if load_row:
            args = (rest.model.chain, response.geometry, rest.weights, rest.model.load_slots, body)
            by_mass, by_com = statics.weight_derivatives(*args)
            for j, ballast in enumerate(added):
                load = by_mass * ballast.mass + sum(by_com[:, axis] * ballast.shift[axis] for axis in range(3))
                out[j] += np.einsum("kcn,kn->cn", response.loads, load)
    for j, unit in enumerate(units):
        shift = effect.seen(rest.true_tcp, unit)
        if shift is not None:
            out[j][:3] += shift.T
        anchor, start = effect.anchor_shift(unit), response.sensed.distance_from
        if anchor is not None and start is not None:
            out[j][-1] -= along_distance(rest, start) @ anchor
    return out


def joint_jacobian(rest: Equilibrium) -> Array:
    """∂TCP/∂q of the commanded joint angles through the equilibrium: (N, 3, n), m/rad."""
    model, response = rest.model, respond(rest)
    index, load_row = model.chain.index, {k: row for row, k in enumerate(model.load_slots)}
    out = response.slots[list(model.chain.joint_slots)]
    for effect, p in model.parts():
        if effect.follows_angles and effect.moves:
            for joint, amounts in enumerate(effect.d_q(rest.poses, _loads_felt(effect, rest), p)):
                _add_motion(out[joint], effect, amounts, index, response.slots)
        for i, key in enumerate(effect.pushes):
            for joint in range(model.arm.dof if index[key] in load_row else 0):
                plus, minus = (effect.push(rest.poses.perturbed(joint, h), p)[i] for h in (STEP, -STEP))
                out[joint] += response.loads[load_row[index[key]]] * ((plus - minus) / (2.0 * STEP))
    return out.transpose(2, 1, 0)


def _add_motion(out: Array, effect: Effect, amounts: Sequence[Number], index: dict[str, int], slots: Array) -> None:
    """Adds to out (3, N) the TCP's motion for these amounts at the slots that the effect moves."""
    for key, amount in zip(effect.moves, amounts, strict=True):
        if not is_zero(amount):
            out += slots[index[key]] * amount


def _loads_felt(effect: Effect, rest: Equilibrium) -> tuple[Number, ...]:
    load = dict(zip(rest.model.load_slots, rest.tau, strict=True))
    return tuple(load[rest.model.chain.index[key]] for key in effect.feels)


def _elastic_compliance(rest: Equilibrium) -> Array:
    """D = ∂E/∂tau: (M, K, N) for the M slots `binding.moving` and the K slots `load_slots` (rad/N·m or m/N·m)."""
    model, moving = rest.model, rest.model.binding.moving
    D = np.zeros((len(moving), len(model.load_slots), len(rest.poses)))
    for bound in model.binding.elastic:
        rows = bound.effect.d_tau(rest.poses, tuple(rest.tau[i] for i in bound.feels), bound.p)
        for i, amounts in zip(bound.feels, rows, strict=True):
            for k, amount in zip(bound.moves, amounts, strict=True):
                D[moving.index(k), i] += amount
    return D
