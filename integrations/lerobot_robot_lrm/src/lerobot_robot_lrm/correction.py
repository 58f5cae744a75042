"""Commands for a calibrated arm: wished joint angles in, those to command out, and back from what encoders read.

Wished angles are those of the arm as drawn. Its tool there, on the base as fitted, is the goal; the real arm's joints
are brought to where its tool is nearest to it, and the compiled kernel gives the command that holds them there under
the loads, for the side that each joint arrives from.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from lerobot_robot_lrm.kernel_arm import KernelArmModel
from lerobot_robot_lrm.lead import Lead
from lerobot_robot_lrm.least_deviation import FARTHEST
from lerobot_robot_lrm.servo_motion import dead_times, half_dead_band, unused_effects
from lrm_math.arm.arm import BASE, TOOL
from lrm_math.arm.arm_digest import WHAT_COUNTS, arm_sha256
from lrm_math.arrays import Array
from lrm_math.effects import Effect, constant
from lrm_math.effects.backlash import Hysteresis
from lrm_math.errors import LrmError
from lrm_math.kinematics.forward import frames
from lrm_math.kinematics.motion import Motion
from lrm_math.model.deployed_model import deployed_part, of_a_session
from lrm_math.model.model import Model, model_of
from lrm_math.model.model_file import load_model
from lrm_math.motion.effects import DeadTime
from lrm_math.motion.motion_model import MotionModel, load_motion

REVERSAL = 2.0 * np.pi / 4096.0
"""rad, one step of a servo's encoder: joints whose error depends on their direction are not turned back by less."""
FEWEST_JOINTS = 3
FARTHEST_BASE_M = 0.03
"""m, by which a base may stand beside where another arm's says; of an arm of 0.3 m reach 0.1 rad of a joint."""


def places_of(keep: str) -> list[str]:
    """Places by an option, `base,tool`."""
    return [word.strip() for word in keep.split(",") if word.strip()]


@dataclass(frozen=True, eq=False)
class Corrected:
    """A command (n,), rad, and how far from its goal the tip then stays by the model (m)."""

    command: Array
    left: float


@dataclass(frozen=True, eq=False)
class Correction:
    """The correction of one arm, of its model's effects that a command can undo.

    Attributes:
        payload: kg, what the tool carries.
        left_out: names of the model's effects that are not corrected.
        keep: places whose constant errors are none of the arm, see `of`.
        moved: (4, 4), m, by which the goals are moved in the frame of the measurement, see `on_the_base_of`.
        seen: names of effects that the encoders show: what `model` has from the model of motion.
        unused_effects: ids of effects of the model of motion that no command uses.
        with_direction: names of joints whose friction by the model of motion is not used, since `model` has it already.
        lead: by which moving joints are commanded ahead, before the first wish; None: they are not.
    """

    model: Model
    payload: float = 0.0
    left_out: tuple[str, ...] = ()
    keep: tuple[str, ...] = (BASE, TOOL)
    moved: Array = field(default_factory=lambda: np.eye(4))
    seen: tuple[str, ...] = ()
    unused_effects: tuple[str, ...] = ()
    with_direction: tuple[str, ...] = ()
    lead: Lead | None = None

    @classmethod
    def of_file(
        cls,
        path: str | Path,
        payload: float = 0.0,
        keep: Sequence[str] = (BASE, TOOL),
        motion: str | Path = "",
        lead: bool = False,
    ) -> Correction:
        """The correction by a model file, and the file of a model of motion, if any; see `of`.

        Args:
            lead: whether moving joints are commanded ahead by the dead times of the model of motion.

        Raises `LrmError`; also for a lead without dead times.
        """
        found = cls.of(load_model(path), payload, keep)
        if not motion:
            if lead:
                raise LrmError("lead needs a model of motion that has dead_time; give its file as motion too")
            return found
        moving = load_motion(Path(motion))[1]
        found = found.in_motion(moving)
        return found.led_by(moving) if lead else found

    @classmethod
    def of(cls, fitted: Model, payload: float = 0.0, keep: Sequence[str] = (BASE, TOOL)) -> Correction:
        """The correction by a fitted model.

        Args:
            keep: base, tool or both: their offsets say where the tracker's frame stood, and where a board or target sat
                on the tool. What was measured in the arm's own frame, or at the tip itself, is an error of the arm.

        Raises `LrmError`: another place to keep, a payload that is no weight, an arm of fewer than three joints.
        """
        if unknown := sorted({*keep} - {BASE, TOOL}):
            raise LrmError(f"keep {', '.join(unknown)}; should be {BASE}, {TOOL}, both or none")
        if not 0.0 <= payload < np.inf:
            raise LrmError(f"payload = {1e3 * payload:g} g; should be a weight of zero or more")
        if fitted.arm.dof < FEWEST_JOINTS:
            raise LrmError(f"{fitted.arm.name} has {fitted.arm.dof} joints; a tool is corrected by three or more")
        sessions = sorted({effect.id for effect in fitted.effects if of_a_session(effect)})
        deployed = deployed_part(fitted, sessions)
        kept = [each for each in deployed.effects if not (constant(each) and each.place == TOOL and TOOL in keep)]
        names = {effect.name for effect in deployed.effects}
        left_out = tuple(effect.name for effect in fitted.effects if effect.name not in names)
        return cls(_restricted(deployed, kept), payload, left_out, tuple(keep))

    def in_motion(self, motion: MotionModel) -> Correction:
        """The correction whose joints also stand where their servos stop short.

        Friction and play of the model of motion count where this model has no error that depends on the direction:
        such an error holds them already. Raises `LrmError`: a model of another arm.
        """
        ours, other = self.model.arm, motion.arm
        if arm_sha256(other) != arm_sha256(ours):
            if other.name != ours.name:
                raise LrmError(f"the model of motion is one of {other.name}; should be one of {ours.name}")
            raise LrmError(f"{ours.name} of the model of motion is not as in the model of poses: {WHAT_COUNTS} differ")
        rubs, directed = half_dead_band(motion), self.slack > 0.0
        short = {
            Hysteresis(ours, ours.joint_names[j]): -2.0 * float(rubs[j])
            for j in np.flatnonzero((rubs > 0.0) & ~directed)
        }
        known = {key: self.model.value(key) for effect in self.model.effects for key in effect.keys}
        known |= {effect.keys[0]: h for effect, h in short.items()}
        return replace(
            self,
            model=model_of(ours, [*self.model.effects, *short], known),
            seen=tuple(effect.name for effect in short),
            unused_effects=unused_effects(motion),
            with_direction=tuple(self.names[j] for j in np.flatnonzero((rubs > 0.0) & directed)),
        )

    def led_by(self, motion: MotionModel) -> Correction:
        """The correction that also leads moving joints by their dead times. Raises `LrmError`: there are none."""
        late = dead_times(motion)
        if not late.any():
            raise LrmError("the model of motion has no dead_time, so there is nothing to lead by; leave lead out")
        unused = tuple(each for each in self.unused_effects if each != DeadTime.id)
        return replace(self, lead=Lead.of(late), unused_effects=unused)

    def on_the_base_of(self, other: Correction) -> Correction:
        """The correction whose arm as drawn stands beside another one as the arm files of both have it.

        Both models are measured in one frame. The base of the other is as fitted, and moves this one's along. Raises
        `LrmError`: the two stand so far from that that no command may make up for it.
        """
        base, drawn = _base_frame(other.model), _base_frame(_restricted(other.model, []))
        goal = base @ np.linalg.solve(drawn, _base_frame(_restricted(self.model, [])))
        stands = _base_frame(self.model)
        off, turned = np.linalg.norm(goal[:3, 3] - stands[:3, 3]), _angle(goal[:3, :3].T @ stands[:3, :3])
        if off > FARTHEST_BASE_M or turned > FARTHEST:
            what = f"the bases stand {1e3 * off:.0f} mm and {np.degrees(turned):.1f} deg beside where the arm files say"
            most = f"at most {1e3 * FARTHEST_BASE_M:.0f} mm and {np.degrees(FARTHEST):.1f} deg are corrected"
            raise LrmError(f"{what}; {most}: state where both stand ([base]), and measure both in one frame")
        return replace(self, moved=goal @ np.linalg.inv(_base_frame(self.drawn.model)))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints, those of the robot's own description where the arm file has them."""
        return tuple(joint.name or f"joint{i}" for i, joint in enumerate(self.model.arm.joints, start=1))

    @cached_property
    def limits(self) -> Array:
        """(2, n), of commands (rad)."""
        return np.array([(joint.lower, joint.upper) for joint in self.model.arm.joints]).T

    @cached_property
    def arm(self) -> KernelArmModel:
        """The real arm."""
        return KernelArmModel.of(self.model, self.payload)

    @cached_property
    def behind_encoders(self) -> KernelArmModel:
        """The real arm beyond its encoders."""
        if not self.seen:
            return self.arm
        hidden = [effect for effect in self.model.effects if effect.name not in self.seen]
        return KernelArmModel.of(_restricted(self.model, hidden), self.payload)

    @cached_property
    def drawn(self) -> KernelArmModel:
        """The arm as drawn, on the base as fitted if that is kept; nothing loads it."""
        kept = [BASE] if BASE in self.keep else []
        of_base = [effect for effect in self.model.effects if constant(effect) and effect.place in kept]
        return KernelArmModel.of(_restricted(self.model, of_base), 0.0)

    @cached_property
    def slack(self) -> Array:
        """(n,), rad, by which a joint is not turned back: `REVERSAL` where its error depends on its direction."""
        directed = {effect.place for effect in self.model.effects if "direction" in effect.depends_on}
        everywhere = bool(directed - set(self.model.arm.joint_names))
        return np.array([REVERSAL if everywhere or name in directed else 0.0 for name in self.model.arm.joint_names])

    @cached_property
    def zero_shift(self) -> Array:
        """(n,), rad, that commands are beside the wish for the joints' constant zero offsets alone."""
        at_zero = np.zeros(len(self.names))
        return np.asarray(self.drawn.slots_at(at_zero)[self.drawn.joints] - self.arm.slots_at(at_zero)[self.arm.joints])

    def command(self, wish: Array, motion: Motion) -> Array:
        """(n,), commands (rad) for wished angles (n,), that continue a motion, see `answer`. Raises `NoEquilibrium`."""
        return self.answer(wish, motion).command

    def answer(self, wish: Array, motion: Motion) -> Corrected:
        """The command for wished angles (n,), rad, that continues a motion.

        A joint is sent on in the direction of its last move, or by `slack` and more back. Where neither direction
        brings it there, because it leads after a turn, it stays, or turns back by `slack` if it then stands nearer.
        Raises `NoEquilibrium`.
        """
        low, high = self.limits
        amounts, goal = self._drawn_at(np.clip(wish, low, high))
        side, turned = motion.side, np.zeros(len(wish), dtype=bool)
        off = np.zeros(len(wish))
        while True:
            found, left = self.arm.command(amounts, goal, side, motion)
            q = np.clip(found, low, high)
            moved = q - motion.q
            back = np.where(side == 0.0, moved != 0.0, moved * side < -self.slack) & ~turned
            if not back.any():
                along, turns = moved * side, turned & (motion.side != 0.0)
                by_slack = np.clip(motion.q + self.slack * side, low, high)
                held = np.where(turns & (off > self.slack - along), by_slack, motion.q)
                return Corrected(np.where(along < np.where(turns, self.slack, 0.0), held, q), left)
            off = np.where(back, np.abs(moved), off)
            side, turned = np.where(back, np.sign(moved), side), turned | back

    def true_angles(self, encoders: Array, motion: Motion) -> Array:
        """(n,), angles of the arm as drawn (rad) whose tool is where the real one is, from what encoders read (n,).

        Raises `NoEquilibrium`.
        """
        return self._true_angles(self.behind_encoders, encoders, motion)

    def reached(self, command: Array, motion: Motion) -> Array:
        """(n,), true angles (rad) to which commands (n,) bring the joints: the inverse of `command`.

        Raises `NoEquilibrium`.
        """
        return self._true_angles(self.arm, command, motion)

    def _true_angles(self, arm: KernelArmModel, encoders: Array, motion: Motion) -> Array:
        slots = arm.settled(encoders, motion)
        goal = np.linalg.solve(self.moved, arm.kernel.forward(slots[None])[0][0])
        zero = self.drawn.slots_at(np.zeros_like(encoders))[self.drawn.joints]
        return self.drawn.joints_near(slots[arm.joints], goal) - zero

    def _drawn_at(self, wish: Array) -> tuple[Array, Array]:
        """Slot amounts (n,), rad, of the drawn arm's joints at wished angles (n,), and its tool's frame (4, 4), m."""
        drawn = self.drawn.slots_at(wish)
        return drawn[self.drawn.joints], self.moved @ self.drawn.kernel.forward(drawn[None])[0][0]


def _base_frame(model: Model) -> Array:
    """(4, 4), m, of the base of an arm by the constant effects of its model."""
    return np.asarray(frames(model.chain, list(model.binding.constants), 1)[0, 0])


def _angle(R: Array) -> float:
    """rad, of a rotation (3, 3)."""
    return float(np.arccos(np.clip(0.5 * (np.trace(R) - 1.0), -1.0, 1.0)))


def _restricted(model: Model, effects: list[Effect]) -> Model:
    """A model with some of its effects only."""
    known = {key: model.value(key) for effect in effects for key in effect.keys}
    return model_of(model.arm, effects, known)
