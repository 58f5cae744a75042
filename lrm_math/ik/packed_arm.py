"""One model packed for the kernel, its equilibria, and a library of settled poses: seeds of every search."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from lrm_math.arm.arm import JointLimits
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.ik.kernel.kernel_model import KernelModel, frames_as_numbers, packed, with_laws
from lrm_math.ik.kernel.laws import kernel_field, kernel_laws, without_formula
from lrm_math.ik.reach_ball import ReachBall, reach_ball
from lrm_math.kinematics.chain import Number
from lrm_math.kinematics.moving_slots import Indices
from lrm_math.kinematics.pieper import PieperForm, pieper_form
from lrm_math.kinematics.poses import poses_of, roberts_sequence
from lrm_math.kinematics.screw_axes import screw_axes_of
from lrm_math.model.equilibrium import batch_equilibrium
from lrm_math.model.joint_errors import JointErrorModel
from lrm_math.model.model import CACHED_PAYLOADS, Model

LIBRARY_SIZE, COARSE = 2048, 1e-5
"""Poses of a library, before those that do not settle are left out; m: tolerance of their equilibria."""


@dataclass(frozen=True, eq=False)
class EquilibriumBatch:
    """Equilibria of K commands, M of which settle: `rows` (M,), slot amounts (M, V), tool frames (M, 12) by columns."""

    rows: Indices
    slots: Array
    tcp: Array


@dataclass(frozen=True, eq=False)
class PoseLibrary:
    """M settled poses without payload, evenly spread over the limits.

    Attributes:
        q: (M, n), commands (rad). slots: (M, V), amounts of the moving slots (rad, m). tau: (M, V), their loads (N·m).
        tcp: (M, 4, 4), tool frames (m).
        reach_ball: contains every position that the TCP can have.
    """

    q: Array
    slots: Array
    tau: Array
    tcp: Array
    reach_ball: ReachBall


@dataclass(frozen=True, eq=False)
class PackedArm:
    """A model without rounding, and what follows from it alone. Errors of packing: `LrmError`."""

    model: Model

    @cached_property
    def errors(self) -> JointErrorModel:
        """Amounts that effects add to commands."""
        return JointErrorModel(self.model)

    @cached_property
    def complete(self) -> bool:
        """Whether the kernel has a formula for every effect of the model."""
        return not without_formula(self.model)

    @cached_property
    def limits(self) -> JointLimits:
        """Limits of the joints."""
        return JointLimits.of(self.model.arm)

    @cached_property
    def form(self) -> PieperForm | None:
        """The closed form of the inverse of the arm as drawn, if it has one."""
        return None if self.model.arm.mimics else pieper_form(screw_axes_of(self.model.arm))

    @cached_property
    def packed(self) -> KernelModel:
        """The arm without payload and seeds. The kernel computes all laws or, for commands in one place, none."""
        errors, limits = self.errors, self.limits
        moments, (play, force) = errors.moving.moments(self.model.weights(0.0)), errors.axial_play
        arm = packed(errors.moving, moments, self.model.binding.reach, limits.lower, limits.upper)
        arm = arm.with_springs(errors.constants, errors.compliances).with_(play=play, play_force=force)
        arm = arm.with_form(self.form).with_(**kernel_field(self.model, errors.row))
        return with_laws(arm, kernel_laws(self.model) if self.complete else (), self.complete)

    @cached_property
    def library(self) -> PoseLibrary:
        """Settled poses. Raises `LrmError`: none settles."""
        lower, upper = np.array(self.limits.lower), np.array(self.limits.upper)
        q = lower + roberts_sequence(LIBRARY_SIZE, len(lower)) * (upper - lower)
        settled = self._settled(self.packed, q, 0.0, None, None, COARSE)
        if not len(settled.rows):
            raise LrmError(
                "the arm comes to rest in none of many poses without load; its compliances must be too large"
            )
        tcp, tau = self.packed.forward(settled.slots)
        return PoseLibrary(q[settled.rows], settled.slots, tau, tcp, reach_ball(self.model))

    @cached_property
    def _ready(self) -> KernelModel:
        """The arm without payload, with seeds; effects without formula about the library's mean loads."""
        errors, library, joints = self.errors, self.library, self.errors.moving.joints
        linear = library.slots[:, joints] - errors.constants[joints] - library.tau @ errors.compliances[joints].T
        bound = 2.0 * float(np.abs(linear - library.q).max())
        arm = self.packed.with_(nonlinear_bound=bound)
        if not self.complete:
            arm = arm.with_springs(*errors.linearised(poses_of([0.0] * self.model.arm.dof), library.tau.mean(axis=0)))
        return arm.with_library(library.tcp, library.q, library.slots)

    @cached_property
    def kernel(self) -> Callable[[float], KernelModel]:
        """The arm with a payload (kg) and seeds, cached."""

        def loaded(payload: float) -> KernelModel:
            return self._ready.with_(moment=self.errors.moving.moments(self.model.weights(payload)))

        return lru_cache(maxsize=CACHED_PAYLOADS)(loaded)

    def _settled(
        self, arm: KernelModel, q: Array, payload: float, direction: Array | None, start: Array | None,
        tolerance: float, friction: Array | None = None,
    ) -> EquilibriumBatch:  # fmt: skip
        """Equilibria of those of K commands (K, n) that settle, the arm packed with the payload; see `equilibria`."""
        if self.complete:
            begin = self.unloaded_slots(q) if start is None else start
            side = np.zeros_like(q) if direction is None else direction
            slots, tcp, iterations = arm.settle(q, side, begin, tolerance)
            rows = np.flatnonzero(iterations > 0)
            return EquilibriumBatch(rows, slots[rows], tcp[rows])
        poses = poses_of(q, payload, direction, friction)
        first = None if start is None else self.chain_amounts(start)
        settled, rows = batch_equilibrium(self.model, poses, first, tolerance)
        slots = np.stack([np.broadcast_to(settled.slots[k], len(rows)) for k in self.errors.moving.slots], axis=1)
        frames = arm.forward(slots)[0]
        return EquilibriumBatch(rows, slots, frames_as_numbers(frames[:, :3, 3], frames[:, :3, :3]))

    def unloaded_slots(self, q: Array) -> Array:
        """(K, V), slot amounts of the arm without loads at commands (K, n)."""
        out = np.repeat(self.errors.constants[None], len(q), axis=0)
        out[:, self.errors.moving.joints] += q
        return out

    def frames(self, q: Array) -> Array:
        """(K, n + 2, 4, 4), unloaded frames of the base, after joint 1 … n, and of the tool, at commands (K, n); m."""
        return self.packed.frames(self.unloaded_slots(q))

    def chain_amounts(self, slots: Array) -> list[Number]:
        """Amounts of all slots of the chain, from those of the moving ones (K, V); floats for a single pose."""
        out: list[Number] = list(self.model.binding.constants)
        for k, amount in zip(self.errors.moving.slots.tolist(), slots.T, strict=True):
            out[k] = float(amount[0]) if len(slots) == 1 else amount
        return out
