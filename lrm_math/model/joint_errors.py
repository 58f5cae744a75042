"""Error model of the joints and other moving slots: what effects add to them, beyond the kernel's formulas.

The TCP depends on the slots of the chain only. Once these are solved for, the commands follow without kinematics:
commanded = true − (what effects add there). Where the kernel has a formula for every effect (`kernel.laws`) it computes
all of this. Else the model comes back to Python by one way: commands follow here, and on the other slots the kernel is
given the model's value and derivative about the state found, and asked again (see `calibrated_arm`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from lrm_math.arrays import Array
from lrm_math.effects.backlash import AxialPlay
from lrm_math.effects.compliance import Spring
from lrm_math.kinematics.chain import Number
from lrm_math.kinematics.motion import Motion
from lrm_math.kinematics.moving_slots import MovingSlots, moving_slots_of
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.model.deployed_model import named_part
from lrm_math.model.effect_binding import BoundEffect
from lrm_math.model.equilibrium import effect_loads, rigid_amounts
from lrm_math.model.fixed_point import FixedPointStep
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
    def _causes(self) -> Model:
        return named_part(self.model)

    @cached_property
    def moving(self) -> MovingSlots:
        """The arm, everything that never moves joined by fixed transforms."""
        binding = self.model.binding
        rigid = {k for bound in binding.rigid for k in bound.slots}
        also = sorted({*self._loaded, *rigid})
        return moving_slots_of(self.model.chain, binding.constants, also, self.model.constant_gravity)

    @cached_property
    def _loaded(self) -> set[int]:
        """Slots that a load moves, or whose load moves another one; without springs of no compliance."""
        slots_loaded: set[int] = set()
        for bound in self.model.binding.elastic:
            if isinstance(bound.effect, Spring):
                slots_loaded |= {k for k, c in zip(bound.slots, bound.effect.compliances(bound.p), strict=True) if c}
            else:
                slots_loaded |= {*bound.slots, *(self.model.load_slots[i] for i in bound.loads)}
        return slots_loaded

    @cached_property
    def constants(self) -> Array:
        """(V,), moving slots with all joints at zero and no load (rad, m)."""
        return np.array(self.model.binding.constants)[self.moving.slots]

    @cached_property
    def row(self) -> dict[int, int]:
        """Position of each moving slot of the chain among them."""
        return {int(k): v for v, k in enumerate(self.moving.slots)}

    @cached_property
    def _load_rows(self) -> list[int | None]:
        """Position of each of the model's `load_slots`; None of one whose load moves nothing."""
        return [self.row.get(k) for k in self.model.load_slots]

    @cached_property
    def compliances(self) -> Array:
        """(V, V), response of the springs to loads on the moving slots (rad/N·m, m/N·m)."""
        return self._responses(
            poses_of([0.0] * self.model.arm.dof), np.zeros(len(self.row)), self.model.binding.of_class(Spring)
        )

    @cached_property
    def axial_play(self) -> tuple[Array, Array]:
        """Play of the moving slots from end to end (V,), m, zero of most, and the force that takes it up (V,), N."""
        play, force = np.zeros(len(self.row)), np.ones(len(self.row))
        for bound in self.model.binding.of_class(AxialPlay):
            play[self.row[bound.slots[0]]], force[self.row[bound.slots[0]]] = bound.p
        return play, force

    def slots_at(self, poses: Poses, tau: Array) -> Array:
        """(K, V), amounts that the moving slots are due for commands under gravity loads (K, V): rad, m.

        Without a residual field (`displaced`), for which the kernel has a formula whatever else the model has.
        """
        count, rigid, applied = len(poses), rigid_amounts(self._causes, poses), effect_loads(self.model, poses)
        loads = self.total_loads(tau, applied)
        due = {k: rigid[k] for k in self.row}
        for bound in self.model.binding.elastic:
            for k, amount in bound.amounts(poses, loads):
                if k in due:
                    due[k] = due[k] + amount
        return np.stack([np.broadcast_to(due[k], count) for k in self.row], axis=1)

    def command(self, poses: Poses, tau: Array, slots: Array, motion: Motion | None = None) -> Array:
        """(K, n), commands that hold slot amounts (K, V) under gravity loads (K, V); not finite where none does.

        `poses`: payload and direction, and angles to begin with. `motion`: record of the moves before, from which
        follows the friction of a command; for one pose. Fixed-point iteration with secants (Anderson 1965).
        """
        joints, q = self.moving.joints, poses.q
        before: FixedPointStep | None = None
        step = np.full_like(q, np.inf)
        for _ in range(MOST_STEPS):
            at = replace(poses, q=q)
            if motion is not None and poses.direction is not None:
                at = replace(at, friction=motion.turned(q[0], poses.direction[0])[None])
            step = (slots - self.slots_at(at, tau))[:, joints]
            if not (np.abs(step) > SETTLED).any():
                return np.asarray(q + step)
            here = FixedPointStep(q.T, step.T)
            before, q = here, q + here.accelerated(before).T
        settled = np.abs(step).max(axis=1, keepdims=True) < 1e3 * SETTLED
        return np.asarray(np.where(settled, q, np.nan))

    def linearised(self, poses: Poses, tau: Array) -> tuple[Array, Array]:
        """Amounts without load (V,) and compliances (V, V) that, with its play, make the kernel agree with the model.

        Of slots that are no joints, by value and derivative about one pose and loads (V,); of joints, the springs.
        """
        others, sliding = self.moving.others, self.model.binding.of_class(AxialPlay)
        response = self._responses(poses, tau, self.model.binding.elastic, effect_loads(self.model, poses))
        compliances = self.compliances.copy()
        compliances[others] = (response - self._responses(poses, tau, sliding))[others]
        due = self.slots_at(poses, tau[None])[0] - compliances @ tau
        for bound in sliding:
            for k, amount in bound.amounts(poses, self.total_loads(tau[None], {})):
                due[self.row[k]] -= float(amount)
        zero = self.constants.copy()
        zero[others] = due[others]
        return zero, compliances

    def displaced(self, poses: Poses) -> Array:
        """(V,), what a residual field adds to the slots at one pose (m)."""
        out = np.zeros(len(self.row))
        for bound in self.model.binding.rigid:
            if not bound.effect.names_a_cause:
                for k, amount in bound.amounts(poses, []):
                    out[self.row[k]] += float(amount)
        return out

    def total_loads(self, tau: Array, applied: dict[int, Number]) -> list[Number]:
        """Loads on `model.load_slots`, floats for one pose: gravity's (K, V) and those that effects put on slots."""
        single = len(tau) == 1
        rows: list[Number] = [0.0 if v is None else float(tau[0, v]) if single else tau[:, v] for v in self._load_rows]
        return [load + applied.get(k, 0.0) for k, load in zip(self.model.load_slots, rows, strict=True)]

    def _responses(
        self, pose: Poses, tau: Array, effects: Sequence[BoundEffect], applied: dict[int, Number] | None = None
    ) -> Array:
        """(V, V), derivatives of some effects by the loads, at one pose and gravity loads (V,)."""
        out, loads = np.zeros((len(self.row), len(self.row))), self.total_loads(tau[None], applied or {})
        for bound in effects:
            rows = bound.by_loads(pose, bound.own_loads(loads))
            for i, responses in zip(bound.loads, rows, strict=True):
                for k, response in zip(bound.slots, responses, strict=True):
                    if (v := self._load_rows[i]) is not None and k in self.row:
                        out[self.row[k], v] += response
        return out
