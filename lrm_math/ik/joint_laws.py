"""Laws of the joints: from true joint angles to the commands that produce them.

The TCP depends on the slots of the chain only. Once these are solved for, the effects on the joints follow without
inner iteration: commanded = true − (what springs, play and gears add there). Only effects of the commanded angle itself
(gain, eccentricity, coupling, cables) need a few steps, and those need no kinematics.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import TypeAlias

import numpy as np

from lrm_math.arrays import Array
from lrm_math.effects.base import Amounts
from lrm_math.errors import LrmError
from lrm_math.ik.linkage import Linkage, MassMoments, linkage_of
from lrm_math.ik.scalar_pose import SinglePose
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.model.effect_binding import BoundEffect
from lrm_math.model.equilibrium import effect_loads
from lrm_math.model.model import CACHED_PAYLOADS, Model

SETTLED = 1e-10
"""rad: iteration stops when no joint has turned more than this; the next step would be far smaller."""
LEAST_STEP = 1e-7
"""rad: shorter steps of a joint give no secant."""
MOST_STEPS = 25
SLOPE_BOUND = 0.5
"""Bound on the change of a joint's slope, true angle by command, from that at zero."""
JointMotion: TypeAlias = tuple[
    Callable[[Poses, Amounts, tuple[float, ...]], Amounts], tuple[float, ...], tuple[int, ...], tuple[int, ...]
]
"""An effect's motion, its parameters, the moving slots whose loads it feels, and the joints that it turns; anything
else has the number after the last joint's.
"""

AppliedLoad: TypeAlias = tuple[Callable[[Poses, tuple[float, ...]], Amounts], tuple[float, ...], tuple[int | None, ...]]
"""An effect's loads, its parameters, and the moving slots that they act on; None is a slot that does not move."""


@dataclass(frozen=True, eq=False)
class JointLaws:
    """The relation between commands and true joint angles of a model.

    `model`: only effects that can be compensated, and no rounding (see `deployed`).
    """

    model: Model

    @cached_property
    def linkage(self) -> Linkage:
        """The arm, everything that never moves welded together."""
        binding = self.model.binding
        rigid = {k for effect in binding.rigid for k in effect.moves}
        return linkage_of(
            self.model.chain, binding.constants, sorted({*binding.moving, *self.model.load_slots, *rigid})
        )

    @cached_property
    def constants(self) -> Array:
        """(V,), moving slots with all joints at zero and no load (rad, m)."""
        return np.array(self.model.binding.constants)[self.linkage.slots]

    @cached_property
    def _load_rows(self) -> list[int]:
        return [self._row[k] for k in self.model.load_slots]

    @cached_property
    def _row(self) -> dict[int, int]:
        return {int(k): v for v, k in enumerate(self.linkage.slots)}

    @cached_property
    def compliances(self) -> Array:
        """(V, V), response of the linear effects to loads on the moving slots (rad/N·m, m/N·m)."""
        out, nowhere = np.zeros((len(self._row), len(self._row))), poses_of([0.0] * self.model.arm.dof)
        for effect in self.model.binding.elastic:
            if effect.effect.linear:
                rows = effect.effect.d_tau(nowhere, (0.0,) * len(effect.feels), effect.p)
                for i, responses in zip(effect.feels, rows, strict=True):
                    for k, response in zip(effect.moves, responses, strict=True):
                        out[self._row[k], self._load_rows[i]] += response
        return out

    @cached_property
    def _nonlinear(self) -> tuple[BoundEffect, ...]:
        """Nonlinear effects."""
        binding = self.model.binding
        return (*binding.rigid, *(effect for effect in binding.elastic if not effect.effect.linear))

    @cached_property
    def _on_others(self) -> tuple[BoundEffect, ...]:
        """Nonlinear effects that move slots other than joints."""
        joints = set(self.model.chain.joint_slots)
        return tuple(effect for effect in self._nonlinear if set(effect.moves) - joints)

    def _joint_motion(self, effect: BoundEffect) -> JointMotion:
        joints, feels = self._joint_of, tuple(self._load_rows[i] for i in effect.feels)
        return effect.effect.motion, effect.p, feels, tuple(joints.get(k, len(joints)) for k in effect.moves)

    @cached_property
    def _joint_of(self) -> dict[int, int]:
        """Slots of the chain to joint numbers from 0."""
        return {k: joint for joint, k in enumerate(self.model.chain.joint_slots)}

    @cached_property
    def _on_joints(self) -> tuple[BoundEffect, ...]:
        joints = set(self.model.chain.joint_slots)
        return tuple(effect for effect in self._nonlinear if set(effect.moves) & joints)

    def _follows(self, effect: BoundEffect) -> bool:
        applied = {k for other in self.model.binding.pushing for k in other.pushes}
        return effect.effect.follows_angles or any(self.model.load_slots[i] in applied for i in effect.feels)

    @cached_property
    def _following(self) -> tuple[JointMotion, ...]:
        """Effects on joints that change with the command while the arm stays where it is."""
        return tuple(self._joint_motion(effect) for effect in self._on_joints if self._follows(effect))

    @property
    def _depends_on_command(self) -> bool:
        """Whether the sum of effects on the joints changes with the command."""
        binding = self.model.binding
        return bool(self._following or binding.pushing or binding.gears)

    @cached_property
    def _independent(self) -> tuple[JointMotion, ...]:
        """The other effects on joints."""
        return tuple(self._joint_motion(effect) for effect in self._on_joints if not self._follows(effect))

    @cached_property
    def follows_command(self) -> bool:
        """Whether the slots other than joints depend on the command itself."""
        return any(self._follows(effect) or not effect.feels for effect in self._on_others) or any(
            self.compliances[self.linkage.others][:, self._row[k]].any()
            for effect in self.model.binding.pushing
            for k in effect.pushes
        )

    @property
    def others_are_linear(self) -> bool:
        """Whether the slots other than joints follow loads linearly, and nothing else."""
        return not (self._on_others or self.follows_command)

    @cached_property
    def mass_moments(self) -> Callable[[float], MassMoments]:
        """Mass moments with a payload (kg), cached."""
        return lru_cache(maxsize=CACHED_PAYLOADS)(
            lambda carried: self.linkage.mass_moments(self.model.weights(carried))
        )

    def others_at_loads(self, poses: Poses, tau: Array) -> Array:
        """(W, K), equilibrium amounts of the slots other than joints under gravity loads (V, K): rad, m."""
        rows = self.linkage.others
        total = tau + self._loads_of_effects(poses) if self.follows_command else tau
        out = self.constants[rows, None] + self.compliances[rows] @ total
        if self._on_others:
            deflection = np.zeros_like(tau)
            for effect in self._on_others:
                for k, amount in effect.motion(poses, [total[v] for v in self._load_rows]):
                    deflection[self._row[k]] += amount
            out += deflection[rows]
        return np.asarray(out)

    def others_compliance(self, poses: Poses, tau: Array) -> Array:
        """(K, W, V), derivative of `others_at_loads` by the loads (rad/N·m, m/N·m)."""
        rows = self.linkage.others
        if not self._on_others:
            return self.compliances[None, rows]
        total = tau + self._loads_of_effects(poses) if self.follows_command else tau
        out = np.repeat(self.compliances[:, :, None], len(poses), axis=2)
        for effect in self._on_others:
            loads = tuple(total[self._load_rows[i]] for i in effect.feels)
            for i, responses in zip(effect.feels, effect.effect.d_tau(poses, loads, effect.p), strict=True):
                for k, response in zip(effect.moves, responses, strict=True):
                    out[self._row[k], self._load_rows[i]] += response
        return out[rows].transpose(2, 0, 1)

    def command(self, poses: Poses, tau: Array, real: Array) -> Array:
        """Commands (K, n) for true joint angles `real` (K, n) under gravity loads (V, K).

        `poses`: payload and direction, and angles near those sought. Candidates are solved one by one with floats, much
        faster than with short arrays.
        """
        targets = self.linear_command(tau, real)
        if not (self._on_joints or self._depends_on_command):
            return targets
        rows = [
            self._command_one(SinglePose.of(poses, k, target), tau[:, k], target) for k, target in enumerate(targets)
        ]
        return np.array(rows).reshape(real.shape)

    def linear_command(self, tau: Array, real: Array) -> Array:
        """As `command`, with the linear effects only."""
        joints = self.linkage.joints
        return np.asarray(real - self.constants[joints] - (self.compliances[joints] @ tau).T)

    def _command_one(self, pose: SinglePose, tau: Array, target: Array) -> Array:
        """Start by the slopes at zero, then secants joint by joint, since most effects follow one; then Broyden."""
        loads: list[float] = tau.tolist()
        if self._independent:
            target = target - self._joint_turns(self._independent, pose, loads)[:-1]
        if not self._depends_on_command:
            return target
        inverse, before, largest = self._slope_inverse, 0.0, 0.0
        q = inverse @ (target - self._at_zero)
        residual = target - q - self._response(pose.turned_to(q), loads)
        step = inverse @ residual
        for number in range(MOST_STEPS):
            q = q + step
            before, largest = largest, max(map(abs, step.tolist()))
            if largest <= SETTLED or largest * largest <= SETTLED * before:
                break
            new_residual = target - q - self._response(pose.turned_to(q), loads)
            if number == 0:
                inverse = self._with_secants(step, residual - new_residual)
            else:
                response = inverse @ (residual - new_residual)
                along = float(step @ response)
                if along != 0.0:
                    inverse = inverse + ((step - response) / along)[:, None] * (step @ inverse)
            residual, step = new_residual, inverse @ new_residual
        return np.asarray(q)

    @cached_property
    def _at_zero(self) -> Array:
        """(n,), effects that follow the command, at command zero without gravity (rad)."""
        return self._response(poses_of([0.0] * self.model.arm.dof), [0.0] * len(self._row))

    @cached_property
    def _slope(self) -> Array:
        """(n, n), derivative of the true angles by the commands, at command zero without gravity."""
        zero, tau = poses_of([0.0] * self.model.arm.dof), [0.0] * len(self._row)
        n, h = zero.q.shape[1], 0.1
        ends = [[self._response(zero.perturbed(i, delta), tau) for i in range(n)] for delta in (h, -h)]
        return np.asarray(np.eye(n) + (np.array(ends[0]) - np.array(ends[1])).T / (2.0 * h))

    @cached_property
    def _slope_inverse(self) -> Array:
        return np.asarray(np.linalg.inv(self._slope))

    def _with_secants(self, step: Array, response: Array) -> Array:
        """(n, n), the inverse slope, its diagonal updated by the secants of a step and the response (n,).

        To first order in the change of the diagonal.
        """
        known = abs(step) > LEAST_STEP
        change = (response - self._slope @ step) / np.where(known, step, np.inf)
        inverse = self._slope_inverse
        return np.asarray(inverse - (inverse * np.minimum(np.maximum(change, -SLOPE_BOUND), SLOPE_BOUND)) @ inverse)

    def with_commands(self, poses: Poses, tau: Array, amounts: Array) -> Poses:
        """Poses with the commands for slot amounts (K, V) under gravity loads (V, K)."""
        return replace(poses, q=self.command(poses, tau, amounts[:, self.linkage.joints]))

    def _response(self, pose: Poses, tau: list[float]) -> Array:
        """(n,), sum of the effects that follow the command (rad), for one pose and loads (V,)."""
        applied = [
            (v, float(load))
            for push, p, rows in self._applied_loads
            for v, load in zip(rows, push(pose, p), strict=True)
            if v is not None
        ]
        loads = list(tau)
        for v, load in applied:
            loads[v] += load
        turns = self._joint_turns(self._following, pose, loads)
        for v, load in applied:
            for joint, compliance in self._turned_by[v]:
                turns[joint] += compliance * load
        return np.asarray(np.array(turns[:-1]) + self._gears @ pose.q[0])

    @cached_property
    def _applied_loads(self) -> list[AppliedLoad]:
        """Effects that put loads on slots."""
        return [(w.effect.push, w.p, tuple(self._row.get(k) for k in w.pushes)) for w in self.model.binding.pushing]

    @cached_property
    def _gears(self) -> Array:
        """(n, n), turn of each joint by commands of the others alone (rad/rad)."""
        out = np.zeros((self.model.arm.dof, self.model.arm.dof))
        for k, joint, ratio in self.model.binding.gears:
            out[self._joint_of[k], joint] += ratio
        return out

    @cached_property
    def _turned_by(self) -> list[list[tuple[int, float]]]:
        """For every moving slot: joints that its load turns, and compliances (rad/N·m)."""
        columns = self.compliances[self.linkage.joints].T
        return [[(joint, k) for joint, k in enumerate(column) if k] for column in columns.tolist()]

    def _joint_turns(self, effects: Iterable[JointMotion], pose: Poses, loads: list[float]) -> list[float]:
        """(n + 1,), sum of some effects on the joints of one pose under loads (V,): rad; last, on anything else."""
        out = [0.0] * (self.model.arm.dof + 1)
        for motion, p, feels, joints in effects:
            amounts = motion(pose, tuple([loads[v] for v in feels]) if feels else (), p)
            for joint, amount in zip(joints, amounts, strict=True):
                out[joint] += amount  # type: ignore[assignment]
        return out

    def _loads_of_effects(self, poses: Poses) -> Array:
        """(V, K), loads of effects on the moving slots (N·m)."""
        out = np.zeros((len(self._row), len(poses)))
        for k, load in effect_loads(self.model, poses).items():
            if k in self._row:
                out[self._row[k]] += load
        return out


def deployed(model: Model, left_out: Sequence[str] = ()) -> Model:
    """The effects of a model that can be compensated: not rounding, and none of those `left_out`.

    Raises `LrmError`: an effect that only explains a measurement session (drift, session, measurement_frame) is neither
    compensable nor named in `left_out`; or a name there that the model does not have.
    """
    names = {effect.id for effect in model.effects}
    for name in left_out:
        if name not in names:
            raise LrmError(f"left out: '{name}' is no effect of this model; it has {', '.join(sorted(names))}")
    kept = [e.online and e.id not in left_out for e in model.effects]
    for effect, keep in zip(model.effects, kept, strict=True):
        if not keep and effect.id not in left_out:
            raise LrmError(
                f"effect {effect.id}@{effect.place} explains a measurement session and cannot be compensated on the "
                f"rover; name it as left out (left_out = ['{effect.id}']) to deploy the others"
            )
    effects = tuple(e for e, keep in zip(model.effects, kept, strict=True) if keep and e.id != "quantisation")
    spans = [s for e, s, keep in zip(model.effects, model.spans, kept, strict=True) if keep and e.id != "quantisation"]
    values = np.concatenate([np.empty(0), *(model.values[span] for span in spans)])
    smooth = Model(model.arm, effects, values)
    return replace(smooth, free=tuple(key for key in model.free if key in smooth.keys))
