"""From the angles that joints really have to the angles that make them so.

Where the TCP is depends only on where the slots of the chain are. Solved for those, the effects on the joints follow
without any inner iteration: commanded = real − (what springs, play and gears add there). Only effects of the
commanded angle itself (gain, eccentricity, coupling, cables) need a few steps, and those cost no kinematics.
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
from lrm_math.ik.linkage import Burden, Linkage, linkage_of
from lrm_math.ik.scalar_pose import OnePose
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.model.effect_binding import Wired
from lrm_math.model.equilibrium import pushes_of
from lrm_math.model.model import LOADS_KEPT, Model

SETTLED = 1e-10
"""rad: the commanded angles are found when no joint has turned more than this; the next step would be far smaller."""
TELLING = 1e-7
"""rad: shorter steps of a joint do not tell how effects follow it."""
MOST_STEPS = 25
MOST_BEND = 0.5
"""How far effects may bend the slope from a joint's command to its angle away from the one at zero."""
Turning: TypeAlias = tuple[
    Callable[[Poses, Amounts, tuple[float, ...]], Amounts], tuple[float, ...], tuple[int, ...], tuple[int, ...]
]
"""An effect's motion, its parameters, which moving slots' loads it feels, and which joints it turns; the number after
the last joint's is that of anything else."""

Pushing: TypeAlias = tuple[Callable[[Poses, tuple[float, ...]], Amounts], tuple[float, ...], tuple[int | None, ...]]
"""An effect's loads, its parameters, and which moving slots they push; None is a slot that does not move."""


@dataclass(frozen=True, eq=False)
class Compensation:
    """A model seen from the angles that its joints really have.

    `model`: only effects that the rover can compensate, and no rounding (see `deployed`).
    """

    model: Model

    @cached_property
    def linkage(self) -> Linkage:
        """The arm with everything welded together that never moves."""
        wiring = self.model.wiring
        rigid = {k for effect in wiring.rigid for k in effect.moves}
        return linkage_of(self.model.chain, wiring.steady, sorted({*wiring.moving, *self.model.felt, *rigid}))

    @cached_property
    def steady(self) -> Array:
        """(V,), what each moving slot has with all joints at zero and no load (rad, m)."""
        return np.array(self.model.wiring.steady)[self.linkage.slots]

    @cached_property
    def _felt(self) -> list[int]:
        return [self._row[k] for k in self.model.felt]

    @cached_property
    def _row(self) -> dict[int, int]:
        return {int(k): v for v, k in enumerate(self.linkage.slots)}

    @cached_property
    def compliances(self) -> Array:
        """(V, V), what the linear effects make of loads on the moving slots (rad/N·m, m/N·m)."""
        out, nowhere = np.zeros((len(self._row), len(self._row))), poses_of([0.0] * self.model.arm.dof)
        for effect in self.model.wiring.elastic:
            if effect.effect.linear:
                rows = effect.effect.d_tau(nowhere, (0.0,) * len(effect.feels), effect.p)
                for i, answers in zip(effect.feels, rows, strict=True):
                    for k, answer in zip(effect.moves, answers, strict=True):
                        out[self._row[k], self._felt[i]] += answer
        return out

    @cached_property
    def _bent(self) -> tuple[Wired, ...]:
        """Effects that are not linear."""
        wiring = self.model.wiring
        return (*wiring.rigid, *(effect for effect in wiring.elastic if not effect.effect.linear))

    @cached_property
    def _on_others(self) -> tuple[Wired, ...]:
        """Those of them that move more than joints."""
        joints = set(self.model.chain.joint_slots)
        return tuple(effect for effect in self._bent if set(effect.moves) - joints)

    def _turning(self, wired: Wired) -> Turning:
        """An effect as `_turns` has it."""
        joints, feels = self._joint_of, tuple(self._felt[i] for i in wired.feels)
        return wired.effect.motion, wired.p, feels, tuple(joints.get(k, len(joints)) for k in wired.moves)

    @cached_property
    def _joint_of(self) -> dict[int, int]:
        """Number of the joint, from 0, whose angle is in a slot of the chain."""
        return {k: joint for joint, k in enumerate(self.model.chain.joint_slots)}

    @cached_property
    def _on_joints(self) -> tuple[Wired, ...]:
        joints = set(self.model.chain.joint_slots)
        return tuple(effect for effect in self._bent if set(effect.moves) & joints)

    def _follows(self, effect: Wired) -> bool:
        pushed = {k for other in self.model.wiring.pushing for k in other.pushes}
        return effect.effect.follows_angles or any(self.model.felt[i] in pushed for i in effect.feels)

    @cached_property
    def _following(self) -> tuple[Turning, ...]:
        """Effects on joints that change with the commanded angle while the arm stays where it is."""
        return tuple(self._turning(effect) for effect in self._on_joints if self._follows(effect))

    @property
    def _depends_on_command(self) -> bool:
        """Whether what is added to the joints changes with the command."""
        wiring = self.model.wiring
        return bool(self._following or wiring.pushing or wiring.gears)

    @cached_property
    def _apart(self) -> tuple[Turning, ...]:
        """The other effects on joints."""
        return tuple(self._turning(effect) for effect in self._on_joints if not self._follows(effect))

    @cached_property
    def follows_command(self) -> bool:
        """Whether the slots other than joints depend on the command itself, so that it must be known to place them."""
        return any(self._follows(effect) or not effect.feels for effect in self._on_others) or any(
            self.compliances[self.linkage.others][:, self._row[k]].any()
            for effect in self.model.wiring.pushing
            for k in effect.pushes
        )

    @property
    def others_are_springs(self) -> bool:
        """Whether the slots other than joints follow loads in proportion, and nothing else."""
        return not (self._on_others or self.follows_command)

    @cached_property
    def burden(self) -> Callable[[float], Burden]:
        """What the arm carries with a load (kg), kept for the last ones."""
        return lru_cache(maxsize=LOADS_KEPT)(lambda carried: self.linkage.burden(self.model.weights(carried)))

    def others(self, poses: Poses, tau: Array) -> Array:
        """(W, K), where the slots that are no joints want to be at gravity's loads (V, K): rad, m."""
        rows = self.linkage.others
        total = tau + self._pushes(poses) if self.follows_command else tau
        out = self.steady[rows, None] + self.compliances[rows] @ total
        if self._on_others:
            bent = np.zeros_like(tau)
            for effect in self._on_others:
                for k, amount in effect.motion(poses, [total[v] for v in self._felt]):
                    bent[self._row[k]] += amount
            out += bent[rows]
        return np.asarray(out)

    def springs(self, poses: Poses, tau: Array) -> Array:
        """(K, W, V), how `others` answers a change of the loads (rad/N·m, m/N·m)."""
        rows = self.linkage.others
        if not self._on_others:
            return self.compliances[None, rows]
        total = tau + self._pushes(poses) if self.follows_command else tau
        out = np.repeat(self.compliances[:, :, None], len(poses), axis=2)
        for effect in self._on_others:
            loads = tuple(total[self._felt[i]] for i in effect.feels)
            for i, answers in zip(effect.feels, effect.effect.d_tau(poses, loads, effect.p), strict=True):
                for k, answer in zip(effect.moves, answers, strict=True):
                    out[self._row[k], self._felt[i]] += answer
        return out[rows].transpose(2, 0, 1)

    def command(self, poses: Poses, tau: Array, real: Array) -> Array:
        """The angles (K, n) to command so that the joints have the angles `real` (K, n) under gravity's loads (V, K).

        `poses`: payload and direction, and angles near those to be found. One candidate after the other: effects
        reckon with floats then, much faster than with short arrays.
        """
        aims = self.roughly(tau, real)
        if not (self._on_joints or self._depends_on_command):
            return aims
        rows = [self._command_one(OnePose.of(poses, k, aim), tau[:, k], aim) for k, aim in enumerate(aims)]
        return np.array(rows).reshape(real.shape)

    def roughly(self, tau: Array, real: Array) -> Array:
        """The same as `command`, with the linear effects only."""
        joints = self.linkage.joints
        return np.asarray(real - self.steady[joints] - (self.compliances[joints] @ tau).T)

    def _command_one(self, pose: OnePose, tau: Array, aim: Array) -> Array:
        """Joints by the slopes at zero, then secants joint by joint, since most effects follow one; then Broyden."""
        loads: list[float] = tau.tolist()
        if self._apart:
            aim = aim - self._turns(self._apart, pose, loads)[:-1]
        if not self._depends_on_command:
            return aim
        inverse, before, largest = self._slope_inverse, 0.0, 0.0
        q = inverse @ (aim - self._at_zero)
        left = aim - q - self._answer(pose.turned_to(q), loads)
        step = inverse @ left
        for number in range(MOST_STEPS):
            q = q + step
            before, largest = largest, max(map(abs, step.tolist()))
            if largest <= SETTLED or largest * largest <= SETTLED * before:
                break
            now = aim - q - self._answer(pose.turned_to(q), loads)
            if number == 0:
                inverse = self._with_secants(step, left - now)
            else:
                answer = inverse @ (left - now)
                along = float(step @ answer)
                if along != 0.0:
                    inverse = inverse + ((step - answer) / along)[:, None] * (step @ inverse)
            left, step = now, inverse @ now
        return np.asarray(q)

    @cached_property
    def _at_zero(self) -> Array:
        """(n,), what the effects that follow the command add at command zero without gravity (rad)."""
        return self._answer(poses_of([0.0] * self.model.arm.dof), [0.0] * len(self._row))

    @cached_property
    def _slope(self) -> Array:
        """(n, n), how a command and the effects that follow it turn the joints, at command zero without gravity."""
        zero, tau = poses_of([0.0] * self.model.arm.dof), [0.0] * len(self._row)
        n, h = zero.q.shape[1], 0.1
        ends = [[self._answer(zero.nudged(i, way), tau) for i in range(n)] for way in (h, -h)]
        return np.asarray(np.eye(n) + (np.array(ends[0]) - np.array(ends[1])).T / (2.0 * h))

    @cached_property
    def _slope_inverse(self) -> Array:
        return np.asarray(np.linalg.inv(self._slope))

    def _with_secants(self, step: Array, answer: Array) -> Array:
        """(n, n), the inverse slope, its diagonal as a step of the joints and its answer (n,) have it.

        To first order in how far the diagonal is from the one at zero.
        """
        told = abs(step) > TELLING
        change = (answer - self._slope @ step) / np.where(told, step, np.inf)
        inverse = self._slope_inverse
        return np.asarray(inverse - (inverse * np.minimum(np.maximum(change, -MOST_BEND), MOST_BEND)) @ inverse)

    def commanding(self, poses: Poses, tau: Array, amounts: Array) -> Poses:
        """The poses that command amounts (K, V) of the moving slots under gravity's loads (V, K)."""
        return replace(poses, q=self.command(poses, tau, amounts[:, self.linkage.joints]))

    def _answer(self, pose: Poses, tau: list[float]) -> Array:
        """(n,), what the effects that follow the command add to the joints (rad), for one pose and loads (V,)."""
        pushed = [
            (v, float(load))
            for push, p, rows in self._pushing
            for v, load in zip(rows, push(pose, p), strict=True)
            if v is not None
        ]
        loads = list(tau)
        for v, load in pushed:
            loads[v] += load
        turns = self._turns(self._following, pose, loads)
        for v, load in pushed:
            for joint, compliance in self._gives[v]:
                turns[joint] += compliance * load
        return np.asarray(np.array(turns[:-1]) + self._gears @ pose.q[0])

    @cached_property
    def _pushing(self) -> list[Pushing]:
        """Effects that put loads on slots."""
        return [(w.effect.push, w.p, tuple(self._row.get(k) for k in w.pushes)) for w in self.model.wiring.pushing]

    @cached_property
    def _gears(self) -> Array:
        """(n, n), how far each joint is turned by commands of the others alone (rad/rad)."""
        out = np.zeros((self.model.arm.dof, self.model.arm.dof))
        for k, joint, ratio in self.model.wiring.gears:
            out[self._joint_of[k], joint] += ratio
        return out

    @cached_property
    def _gives(self) -> list[list[tuple[int, float]]]:
        """For every moving slot: which joints its load turns, and by how much (rad/N·m)."""
        columns = self.compliances[self.linkage.joints].T
        return [[(joint, k) for joint, k in enumerate(column) if k] for column in columns.tolist()]

    def _turns(self, effects: Iterable[Turning], pose: Poses, loads: list[float]) -> list[float]:
        """(n + 1,), what some effects add to the joints of one pose with loads on the moving slots (V,): rad.

        The last number is of anything else that they move.
        """
        out = [0.0] * (self.model.arm.dof + 1)
        for motion, p, feels, joints in effects:
            amounts = motion(pose, tuple([loads[v] for v in feels]) if feels else (), p)
            for joint, amount in zip(joints, amounts, strict=True):
                out[joint] += amount  # type: ignore[assignment]
        return out

    def _pushes(self, poses: Poses) -> Array:
        """(V, K), loads that effects put on the moving slots (N·m)."""
        out = np.zeros((len(self._row), len(poses)))
        for k, load in pushes_of(self.model, poses).items():
            if k in self._row:
                out[self._row[k]] += load
        return out


def deployed(model: Model, left_out: Sequence[str] = ()) -> Model:
    """The effects of a model that the rover can compensate: not rounding, and none of those `left_out`.

    Raises:
        LrmError: an effect that only explains a measurement session (drift, session, measurement_frame) is neither
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
