"""Which effects the kernel computes and which Python has to: springs, joint laws, and the laws that users bring.

The TCP depends on the slots of the chain only. Once these are solved for, the effects on the joints follow without
kinematics: commanded = true − (what springs, play and gears add there). Of these the kernel knows the laws of
`kernel.laws`; others follow here, after it. Other slots follow loads in proportion in the kernel; an effect that moves
them otherwise is linearised about the loads found, and the kernel asked again (see `calibrated_arm`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lrm_math.arrays import Array
from lrm_math.effects.backlash import AxialPlay
from lrm_math.ik.kernel.laws import KernelLaw, kernel_laws, nonlinear_effects
from lrm_math.ik.kernel.moving_slots import MovingSlots, moving_slots_of
from lrm_math.kinematics.chain import Number
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.model.effect_binding import BoundEffect
from lrm_math.model.equilibrium import effect_loads, rigid_amounts
from lrm_math.model.model import Model

SETTLED, MOST_STEPS = 1e-11, 60
"""rad; iterations of commands that follow from themselves."""


@dataclass(frozen=True, eq=False)
class JointErrorModel:
    """The relation between commands, loads and slots of a model.

    `model`: only effects that can be compensated, and no rounding (see `deployed_model`).
    """

    model: Model

    @cached_property
    def moving(self) -> MovingSlots:
        """The arm, everything that never moves welded together."""
        binding = self.model.binding
        rigid = {k for bound in binding.rigid for k in bound.moves} | {k for k, _, _ in binding.gears}
        also = sorted({*binding.moving, *self.model.load_slots, *rigid})
        return moving_slots_of(self.model.chain, binding.constants, also)

    @cached_property
    def constants(self) -> Array:
        """(V,), moving slots with all joints at zero and no load (rad, m)."""
        return np.array(self.model.binding.constants)[self.moving.slots]

    @cached_property
    def _row(self) -> dict[int, int]:
        return {int(k): v for v, k in enumerate(self.moving.slots)}

    @cached_property
    def _load_rows(self) -> list[int]:
        return [self._row[k] for k in self.model.load_slots]

    @cached_property
    def compliances(self) -> Array:
        """(V, V), response of the linear effects to loads on the moving slots (rad/N·m, m/N·m)."""
        linear = [bound for bound in self.model.binding.elastic if bound.effect.linear]
        return self._responses(poses_of([0.0] * self.model.arm.dof), [0.0] * len(self._row), linear)

    @cached_property
    def known(self) -> tuple[KernelLaw, ...] | None:
        """The laws of the joints, if the kernel has all of them."""
        return kernel_laws(self.model.binding, {k: joint for joint, k in enumerate(self.model.chain.joint_slots)})

    @cached_property
    def others_are_linear(self) -> bool:
        """Whether the slots other than joints follow gravity's loads by springs and axial play, and nothing else."""
        joints, binding = set(self.model.chain.joint_slots), self.model.binding
        moved = {k for bound in nonlinear_effects(binding) for k in bound.moves} | {k for k, _, _ in binding.gears}
        pushed = [self._row[k] for bound in binding.pushing for k in bound.pushes if k in self._row]
        slides = {k for bound in binding.elastic if isinstance(bound.effect, AxialPlay) for k in bound.moves}
        if any(k in slides for bound in binding.pushing for k in bound.pushes):
            return False
        return moved <= joints and not self.compliances[self.moving.others][:, pushed].any()

    @cached_property
    def kernel_laws(self) -> tuple[KernelLaw, ...] | None:
        """The laws that the kernel computes; None if it has not all of them, or other slots do not follow linearly."""
        return self.known if self.others_are_linear else None

    @property
    def complete(self) -> bool:
        """Whether the kernel alone computes the model."""
        return self.kernel_laws is not None

    @cached_property
    def axial_play(self) -> tuple[Array, Array]:
        """Play of the moving slots from end to end (V,), m, zero of most, and the force that takes it up (V,), N."""
        play, force = np.zeros(len(self._row)), np.ones(len(self._row))
        for bound in self.model.binding.elastic:
            if isinstance(bound.effect, AxialPlay) and self.others_are_linear:
                play[self._row[bound.moves[0]]], force[self._row[bound.moves[0]]] = bound.p
        return play, force

    def slots_at(self, poses: Poses, tau: Array) -> Array:
        """(K, V), amounts that the moving slots are due for commands under gravity loads (K, V): rad, m."""
        count, rigid, pushed = len(poses), rigid_amounts(self.model, poses), effect_loads(self.model, poses)
        felt = self._felt(tau, pushed)
        due = {k: rigid[k] for k in self._row}
        for bound in self.model.binding.elastic:
            for k, amount in bound.motion(poses, felt):
                due[k] = due[k] + amount
        return np.stack([np.broadcast_to(due[k], count) for k in self._row], axis=1)

    def command(self, poses: Poses, tau: Array, slots: Array) -> Array:
        """(K, n), commands that hold slot amounts (K, V) under gravity loads (K, V); not finite where none does.

        `poses`: payload and direction, and angles to begin with. Fixed-point iteration with secants (Anderson 1965).
        """
        joints, q = self.moving.joints, poses.q
        before: tuple[Array, Array] | None = None
        step = np.full_like(q, np.inf)
        for _ in range(MOST_STEPS):
            step = (slots - self.slots_at(replace(poses, q=q), tau))[:, joints]
            if not (np.abs(step) > SETTLED).any():
                return np.asarray(q + step)
            moved = step
            if before is not None:
                change = step - before[1]
                share = (step * change).sum(axis=1) / np.maximum((change * change).sum(axis=1), 1e-300)
                moved = step - share[:, None] * (q - before[0] + change)
            before, q = (q, step), q + moved
        settled = np.abs(step).max(axis=1, keepdims=True) < 1e3 * SETTLED
        return np.asarray(np.where(settled, q, np.nan))

    def linearised(self, poses: Poses, tau: Array) -> tuple[Array, Array]:
        """Amounts without load (V,) and compliances (V, V) that stand for the model about one pose and loads (V,).

        Of joints, the linear effects alone.
        """
        loads, others = tau.tolist(), self.moving.others
        springs = self.compliances.copy()
        responses = self._responses(poses, loads, self.model.binding.elastic, effect_loads(self.model, poses))
        springs[others] = responses[others]
        zero = self.constants.copy()
        zero[others] = (self.slots_at(poses, tau[None])[0] - springs @ tau)[others]
        return zero, springs

    def _felt(self, tau: Array, pushed: dict[int, Number]) -> list[Number]:
        """Loads on `model.load_slots`, floats for one pose."""
        rows: list[Number] = [float(tau[0, v]) if len(tau) == 1 else tau[:, v] for v in self._load_rows]
        return [load + pushed.get(k, 0.0) for k, load in zip(self.model.load_slots, rows, strict=True)]

    def _responses(
        self, pose: Poses, tau: list[float], effects: Sequence[BoundEffect], pushed: dict[int, Number] | None = None
    ) -> Array:
        """(V, V), derivatives of some effects by the loads, at one pose and gravity loads (V,)."""
        out, felt = np.zeros((len(self._row), len(self._row))), self._felt(np.array([tau]), pushed or {})
        for bound in effects:
            loads = tuple(felt[i] for i in bound.feels)
            for i, responses in zip(bound.feels, bound.effect.d_tau(pose, loads, bound.p), strict=True):
                for k, response in zip(bound.moves, responses, strict=True):
                    out[self._row[k], self._load_rows[i]] += response
        return out
