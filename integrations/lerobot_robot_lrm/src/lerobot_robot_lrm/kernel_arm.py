"""A calibrated arm in the compiled kernel, with what the kernel has no formula for added as it is at each state."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from lerobot_robot_lrm.least_deviation import UNLIMITED, HeldState, nearest_state
from lrm_math.arrays import Array
from lrm_math.effects.targets import Kind
from lrm_math.errors import NoEquilibrium
from lrm_math.ik.calibrated_arm import CalibratedArm
from lrm_math.ik.kernel.kernel_model import KernelModel, with_laws
from lrm_math.ik.kernel.laws import kernel_laws, without_formula
from lrm_math.kinematics.motion import Motion
from lrm_math.kinematics.moving_slots import Indices
from lrm_math.kinematics.poses import Poses
from lrm_math.model.effect_binding import BoundEffect
from lrm_math.model.equilibrium import effect_loads
from lrm_math.model.fixed_point import FixedPointStep
from lrm_math.model.joint_errors import JointErrorModel
from lrm_math.model.model import Model
from lrm_math.model.sensed import before_encoders

SETTLED, MOST_STEPS = 1e-6, 30
"""rad; iterations for effects that the kernel has no formula for."""
TOLERANCE = 1e-9
"""m, of an equilibrium."""


@dataclass(frozen=True, eq=False)
class KernelArmModel:
    """A model (see `lrm_math.model.deployed_model`) with a payload (kg), packed for the kernel.

    `kernel`: with every law that it knows. `complete`: whether these are all of the model.
    """

    model: Model
    payload: float
    kernel: KernelModel
    errors: JointErrorModel
    complete: bool

    @classmethod
    def of(cls, model: Model, payload: float) -> KernelArmModel:
        """Packs a model. Raises `LrmError`."""
        arm = CalibratedArm(model)
        kernel = arm.kernel(payload).with_springs(arm.errors.constants, arm.errors.compliances)
        kernel = with_laws(kernel.with_(nonlinear_bound=0.0), kernel_laws(model), True)
        return cls(model, payload, kernel, arm.errors, arm.complete)

    @property
    def joints(self) -> Indices:
        """(n,), positions of the joints among the moving slots."""
        return self.errors.moving.joints

    def slots_at(self, q: Array) -> Array:
        """(V,), slot amounts at joint angles q (n,), rad, without loads."""
        out = self.errors.constants.copy()
        out[self.joints] += q
        return out

    def command(self, amounts: Array, goal: Array, side: Array, motion: Motion) -> tuple[Array, float]:
        """Commands (n,), rad, that hold the tool near a frame (4, 4), m, and how far its position stays from it (m).

        Commands beyond a joint's limits come back to these, and the other joints make up for it as far as they can.
        The joints stay near their amounts (n,), rad, see `nearest_state`. Each arrives from `side` (n,), after a
        motion. Effects without a formula are constants for the kernel, iterated with secants (Anderson 1965). Raises
        `NoEquilibrium`.
        """
        added, before = np.zeros_like(self.errors.constants), None
        for _ in range(MOST_STEPS):
            kernel = self.kernel if self.complete else self.kernel.with_(zero=self.errors.constants + added)
            slots, tau, q = self._nearest(kernel, amounts, goal, side, self._limits)
            if self.complete:
                return q, self._left(slots, goal)
            poses = self._poses(q, side, motion.turned(q, side))
            lacking = self._lacking(poses, tau[None], slots, added)
            if np.abs(lacking).max() < SETTLED:
                return q, self._left(slots, goal)
            here = FixedPointStep(added, lacking)
            before, added = here, added + here.accelerated(before)
        raise NoEquilibrium([1], "the command of these angles does not settle")

    def joints_near(self, amounts: Array, goal: Array) -> Array:
        """(n,), slot amounts (rad) of the joints with the tool near a frame (4, 4), m, from amounts (n,)."""
        slots, _, _ = self._nearest(self.kernel, amounts, goal, np.zeros(len(amounts)), UNLIMITED)
        return np.asarray(slots[self.joints])

    def _left(self, slots: Array, goal: Array) -> float:
        return float(np.linalg.norm(self.kernel.forward(slots[None])[0][0, :3, 3] - goal[:3, 3]))

    def _nearest(self, kernel: KernelModel, amounts: Array, goal: Array, side: Array, limits: Array) -> HeldState:
        slots = self.errors.constants.copy()
        slots[self.joints] = amounts
        return nearest_state(kernel, partial(_held, kernel, side), slots, goal, limits)

    @cached_property
    def _limits(self) -> Array:
        """(2, n), of commands (rad)."""
        return np.array([(joint.lower, joint.upper) for joint in self.model.arm.joints]).T

    def settled(self, encoders: Array, motion: Motion) -> Array:
        """(V,), slot amounts of an arm whose encoders read angles (n,), rad, after a motion. Raises `NoEquilibrium`."""
        q, slots, added = encoders, self.slots_at(encoders), np.zeros_like(self.errors.constants)
        for _ in range(MOST_STEPS):
            kernel = self.kernel.with_(zero=self.errors.constants + added)
            found, _, steps = kernel.settle(q[None], motion.side[None], slots[None], TOLERANCE)
            if steps[0] < 0:
                break
            slots = found[0]
            if self.complete and not self._encoders_move:
                return np.asarray(slots)
            tau, poses = kernel.forward(found)[1], self._poses(q, motion.side, motion.friction)
            lacking = self._lacking(poses, tau, slots, added)
            loads = self.errors.total_loads(tau, effect_loads(self.model, poses))
            left = encoders - before_encoders(self.model, poses, loads)[0] - q
            if max(np.abs(lacking).max(), np.abs(left).max()) < SETTLED:
                return np.asarray(slots)
            q, added = q + left, added + lacking
        raise NoEquilibrium([1], "the arm does not settle at the angles that its encoders read")

    @cached_property
    def _encoders_move(self) -> bool:
        bound = (*self.model.binding.rigid, *self.model.binding.elastic)
        return any(encoder is not None for effect in bound for encoder in effect.encoders)

    @cached_property
    def _missing(self) -> tuple[BoundEffect, ...]:
        """The effects that the kernel has no formula for."""
        return without_formula(self.model)

    def _lacking(self, poses: Poses, tau: Array, slots: Array, added: Array) -> Array:
        """(V,), what slot amounts in equilibrium under loads (1, V) lack of the model's, `added` (V,) being in them."""
        if any(bound.kind is not Kind.MOTION for bound in self._missing):  # loads, which all effects feel
            return np.asarray(self.errors.slots_at(poses, tau)[0] + self.errors.displaced(poses) - slots)
        applied = effect_loads(self.model, poses) if self.model.binding.loading else {}
        loads, out = self.errors.total_loads(tau, applied), -added
        for bound in self._missing:
            for k, amount in bound.amounts(poses, loads):
                out[self.errors.row[k]] += amount
        return out

    def _poses(self, q: Array, side: Array, friction: Array) -> Poses:
        return Poses(q[None], np.array([self.payload]), side[None], friction=friction[None])


def _held(kernel: KernelModel, side: Array, slots: Array) -> HeldState:
    """Slot amounts (V,) whose joints stay, all settled; their loads (V,), and the command (n,)."""
    state = kernel.hold(slots, side)
    if state is None:
        raise NoEquilibrium([1], "no command holds these angles")
    return state
