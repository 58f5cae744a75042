"""Total derivatives of the TCP through the elastic equilibrium.

At equilibrium s = s0 + E(tau(s)), with s the slots' amounts, E the effects and tau the loads. A small motion δ added to
the slots therefore ends as ds = δ + D H ds with D = ∂E/∂tau and H = ∂tau/∂s, and moves the TCP by (implicit function)

    dx = (J + Λ H) δ,   Λ = J_E D (I − H D)⁻¹,

J being the geometric Jacobian of the slots. Every parameter of every effect is such a motion.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import numpy as np

from lrm_math.arrays import Array
from lrm_math.effects import Effect
from lrm_math.effects.targets import Kind
from lrm_math.kinematics import statics
from lrm_math.kinematics.chain import Chain, Number, is_zero
from lrm_math.kinematics.forward import ChainGeometry, chain_geometry
from lrm_math.model.effect_binding import BoundEffect, bind_effect, changes_of
from lrm_math.model.equilibrium import Equilibrium
from lrm_math.model.fixed_point import NewtonPreconditioner
from lrm_math.model.sensed import TCP_ONLY, Column, Sensed

BLOCK = 1000
"""Poses whose Jacobian is computed at once: memory grows with the poses only by what is returned."""


def slot_jacobian(chain: Chain, geometry: ChainGeometry) -> Array:
    """Geometric Jacobian of the TCP for every slot that moves alone, rigid arm: (S, 3, N), m/rad or 1."""
    turned = statics.cross(geometry.axis, geometry.tcp - geometry.origin)
    return np.where(chain.rotates[:, None, None], turned, geometry.axis)


@dataclass(frozen=True, eq=False)
class Response:
    """Sensitivity of what is measured to small changes, through the equilibrium: R rows of each pose.

    Attributes:
        equilibrium: where it is linearised.
        geometry: screw axes and bodies there.
        slots: (S, R, N), ∂TCP/∂(motion added at each slot) (m/rad or 1), and of what else is `sensed`.
        loads: (K, R, N), ∂TCP/∂(load added on each slot of `model.load_slots`) (m/N·m), and of what else is sensed.
        preconditioner: of the elastic slots and the loads on them; None where nothing gives way.
    """

    equilibrium: Equilibrium
    geometry: ChainGeometry
    slots: Array
    loads: Array
    sensed: Sensed
    preconditioner: NewtonPreconditioner | None = None
    _by_body: dict[int, tuple[Array, Array]] = field(init=False, default_factory=dict, repr=False)

    def weight_derivatives(self, body: int) -> tuple[Array, Array]:
        """(R, N), ∂TCP/∂(mass of a body) (m/kg), and (3, R, N), by its centre of mass (m/m), and of what else is
        sensed; computed once per body, whose several effects all need it."""
        if body not in self._by_body:
            settled, model = self.equilibrium, self.equilibrium.model
            args = (model.chain, self.geometry, settled.weights, settled.gravity, model.load_slots, body)
            by_mass, by_com = statics.weight_derivatives(*args)
            by_weight = np.einsum("kcn,kn->cn", self.loads, by_mass), np.einsum("kcn,kan->acn", self.loads, by_com)
            self._by_body[body] = by_weight
        return self._by_body[body]

    @cached_property
    def gravity_derivatives(self) -> Array:
        """(3, R, N), ∂TCP/∂(component of gravity) (m per m/s²), and of what else is sensed."""
        settled, model = self.equilibrium, self.equilibrium.model
        by_gravity = statics.gravity_derivatives(model.chain, self.geometry, settled.weights, model.load_slots)
        return np.asarray(np.einsum("kcn,kan->acn", self.loads, by_gravity))


@lru_cache(maxsize=2)  # what is identifiable, and the fit that follows, ask at the same equilibrium
def respond(settled: Equilibrium, sensed: Sensed = TCP_ONLY) -> Response:
    """The response at an equilibrium."""
    model, chain = settled.model, settled.model.chain
    geometry = chain_geometry(chain, settled.slots, len(settled.poses), [weight.com for weight in settled.weights])
    rigid = _as_measured(settled, geometry, sensed)
    acting = _Compliance.of(settled)
    loads = np.zeros((len(model.load_slots), *rigid.shape[1:]))
    if not acting.loads:
        return Response(settled, geometry, rigid, loads, sensed)
    D, moving, load_slots = acting.D, list(acting.moving), [model.load_slots[i] for i in acting.loads]
    H = statics.load_derivatives(chain, geometry, settled.weights, settled.gravity, load_slots)
    by_slot = H[:, moving]
    # per pose: I − H D, in the order of `acting.loads`. Its inverse also preconditions Newton steps of later equilibria
    system = np.eye(len(H)) - by_slot.transpose(2, 0, 1) @ D.transpose(2, 0, 1)
    inverse = np.ascontiguousarray(np.linalg.inv(system).transpose(1, 2, 0))
    # J_E D: what the TCP does if a load is added and the deflection does not load the arm anew
    deflected = np.einsum("man,mcn->acn", D, rigid[moving])
    _add_before_encoders(deflected, settled, sensed, acting.loads)
    # Λ = J_E D (I − H D)⁻¹, and below J + Λ H
    by_load = np.einsum("abn,acn->bcn", inverse, deflected)
    loads[list(acting.loads)] = by_load
    total = rigid + np.einsum("kcn,ksn->scn", by_load, H)
    preconditioner = NewtonPreconditioner(acting.moving, D, by_slot, inverse)
    return Response(settled, geometry, total, loads, sensed, preconditioner)


def joint_levers(settled: Equilibrium) -> Array:
    """(n, 3, N), motion of the TCP for a rotation added at each joint (m/rad)."""
    return np.asarray(respond(settled).slots[list(settled.model.chain.joint_slots)])


def _as_measured(settled: Equilibrium, geometry: ChainGeometry, sensed: Sensed) -> Array:
    """(S, R, N), the Jacobian of what is measured of a rigid arm."""
    chain = settled.model.chain
    tcp = slot_jacobian(chain, geometry)
    parts = [measurand.by_slots(settled, geometry, tcp) for measurand in sensed.measurands]
    return statics.carried_along(chain, np.concatenate(parts, axis=1) if len(parts) > 1 else parts[0])


def _add_before_encoders(deflected: Array, settled: Equilibrium, sensed: Sensed, acting: Sequence[int]) -> None:
    """Adds to deflected (A, R, N), of the `acting` loads, what loads do to the encoders' angles."""
    for bound in settled.model.binding.elastic:
        if not bound.idle and any(encoder is not None for encoder in bound.encoders):
            rows = bound.by_loads(settled.poses, bound.own_loads(settled.tau))
            by_load = [(deflected[acting.index(i)], amounts) for i, amounts in zip(bound.loads, rows, strict=True)]
            _add_direct(by_load, bound, settled, sensed)


def parameter_jacobian(settled: Equilibrium, keys: Sequence[str] | None = None, sensed: Sensed = TCP_ONLY) -> Array:
    """∂TCP/∂parameters through the equilibrium: (N, 3, P), SI, for `keys` (every parameter if None).

    (N, R, P) with what else is `sensed`.
    """
    if (count := len(settled.poses)) > BLOCK:
        blocks = np.split(np.arange(count), range(BLOCK, count, BLOCK))
        return np.concatenate([parameter_jacobian(settled.take(rows), keys, sensed) for rows in blocks])
    model, response = settled.model, respond(settled, sensed)
    out = np.zeros((len(model.keys if keys is None else keys), response.slots.shape[1], len(settled.poses)))
    for bound, columns in _by_effect(out, settled, model.keys if keys is None else keys):
        _add_responses(columns, bound, response)
    return out.transpose(2, 1, 0)


def direct_jacobian(settled: Equilibrium, keys: Sequence[str], sensed: Sensed) -> Array:
    """(N, R, P), the part of `parameter_jacobian` by which parameters change what is measured and not the arm: all of
    it for those of the tracker and of the measuring set-up."""
    out = np.zeros((len(keys), sensed.rows(settled.model.arm.dof), len(settled.poses)))
    for bound, columns in _by_effect(out, settled, keys):
        _add_direct(columns, bound, settled, sensed)
    return out.transpose(2, 1, 0)


def _by_effect(out: Array, settled: Equilibrium, keys: Sequence[str]) -> Iterator[tuple[BoundEffect, list[Column]]]:
    """The effects of a model, each with the columns of `out` (P, R, N) that are of its own parameters among `keys`."""
    model, position = settled.model, {key: column for column, key in enumerate(keys)}
    for bound, span in zip(model.binding.bound, model.spans, strict=True):
        columns = {row: position[key] for row, key in enumerate(model.keys[span]) if key in position}
        if columns:
            rows = bound.by_parameters(settled.poses, settled.tau, [*columns])
            yield bound, list(zip(map(out.__getitem__, columns.values()), rows, strict=True))


def effect_columns(
    effect: Effect, p: Sequence[float], response: Response, rows: Iterable[int]
) -> Iterator[tuple[int, Array]]:
    """∂TCP/∂p of those parameters `rows` of an effect that move something at these poses: the row, and (R, N), SI.

    Args:
        p: the effect's parameter values. response: of a model of whose `load_slots` are the effect's.
    """
    settled, model = response.equilibrium, response.equilibrium.model
    bound = bind_effect(model.chain, effect, p, model.load_slots, model.within)
    chosen, shape = tuple(rows), (response.slots.shape[1], len(settled.poses))
    amounts = dict(zip(chosen, bound.by_parameters(settled.poses, settled.tau, chosen), strict=True))
    out = {row: np.zeros(shape) for row in chosen if not all(is_zero(amount) for amount in amounts[row])}
    _add_responses([(moved, amounts[row]) for row, moved in out.items()], bound, response)
    yield from ((row, moved) for row, moved in out.items() if moved.any())


def joint_jacobian(settled: Equilibrium) -> Array:
    """∂TCP/∂q of the commanded joint angles through the equilibrium: (N, 3, n), m/rad."""
    model, response = settled.model, respond(settled)
    out = response.slots[list(model.chain.joint_slots)]
    for bound in (*model.binding.rigid, *model.binding.elastic, *model.binding.loading):
        rows = bound.by_angles(settled.poses, bound.own_loads(settled.tau))
        _add_responses([*zip(out, rows, strict=True)], bound, response)
    return out.transpose(2, 1, 0)


def _add_responses(columns: Sequence[Column], bound: BoundEffect, response: Response) -> None:
    """Adds to each column (R, N) how what is measured follows its amounts at the effect's targets."""
    if bound.kind in (Kind.MOTION, Kind.LOAD):
        for out, amounts in columns:
            for k, amount in zip(bound.slots, amounts, strict=True):
                if not is_zero(amount):
                    _add_slot(out, bound.kind, k, amount, response)
    elif bound.kind is Kind.WEIGHT:
        for out, amounts in columns:
            for body, change in changes_of(bound.effect, amounts):
                _add_weight(out, body, change, response)
    elif bound.kind is Kind.GRAVITY:
        for out, amounts in columns:
            for moved, amount in zip(response.gravity_derivatives, amounts, strict=True):
                out += moved * amount
    _add_direct(columns, bound, response.equilibrium, response.sensed)


def _add_direct(columns: Sequence[Column], bound: BoundEffect, settled: Equilibrium, sensed: Sensed) -> None:
    """Adds to each column (R, N) what an effect does to what is measured beside moving the arm."""
    for measurand, rows in sensed.spans(settled.model.arm.dof):
        measurand.add_direct([(out[rows], amounts) for out, amounts in columns], bound, settled)


def _add_slot(out: Array, kind: Kind, k: int, amount: Number, response: Response) -> None:
    """Adds the response to a motion of slot k, or to a load on it."""
    if kind is Kind.MOTION:
        out += response.slots[k] * amount
    elif k in (load_slots := response.equilibrium.model.load_slots):
        out += response.loads[load_slots.index(k)] * amount


def _add_weight(out: Array, body: int, change: statics.WeightChange, response: Response) -> None:
    """Adds the response to a change of one body's weight."""
    if response.equilibrium.model.load_slots:
        by_mass, by_com = response.weight_derivatives(body)
        out += by_mass * change.mass
        for moved, shift in zip(by_com, change.shift, strict=True):
            out += moved * shift


@dataclass(frozen=True, eq=False)
class _Compliance:
    """D = ∂E/∂tau (M, A, N) of the effects that act (rad/N·m or m/N·m).

    Attributes:
        moving: the M slots that they move. loads: places in the model's `load_slots` of the A loads that they read.
    """

    D: Array
    moving: tuple[int, ...]
    loads: tuple[int, ...]

    @staticmethod
    def of(settled: Equilibrium) -> _Compliance:
        """Derivatives at an equilibrium."""
        binding = settled.model.binding
        acting = [bound for bound in binding.elastic if not bound.idle]
        moving = tuple(sorted({k for bound in acting for k in bound.slots}))
        loads = tuple(sorted({i for bound in acting for i in bound.loads}))
        D = np.zeros((len(moving), len(loads), len(settled.poses)))
        D += binding.springs[np.ix_([binding.moving.index(k) for k in moving], loads)][:, :, None]
        for bound in (bound for bound in binding.nonlinear if not bound.idle):
            rows = bound.by_loads(settled.poses, bound.own_loads(settled.tau))
            for i, amounts in zip(bound.loads, rows, strict=True):
                for k, amount in zip(bound.slots, amounts, strict=True):
                    D[moving.index(k), loads.index(i)] += amount
        return _Compliance(D, moving, loads)
