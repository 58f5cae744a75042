"""Corrected angles of one arm, call after call: what LeRobot's calibrated robots and processor steps share."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from lerobot_robot_lrm.bounded import FARTHEST, BoundedCommand, bounded_command
from lerobot_robot_lrm.correction import Correction
from lerobot_robot_lrm.lead import Lead
from lrm_math.arm.standing import require_standing
from lrm_math.arrays import Array
from lrm_math.effects import marked
from lrm_math.errors import LrmError, NoEquilibrium
from lrm_math.kinematics.motion import Motion

SUFFIX = ".pos"
NOTABLE_M = 0.002
"""m, that the tip stays beside its goal, from which on it is said."""
logger = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class CorrectedAction:
    """An action to send, with the command in it for wished angles (n,), rad, that continues a motion.

    `led`: (n,), rad, of the command by which moving joints are ahead. `lead`: once it is sent; None: there is none.
    """

    action: dict[str, Any]
    wish: Array
    answer: BoundedCommand
    motion: Motion
    led: Array
    lead: Lead | None


class CorrectedArm:
    """The joints of one arm in actions and observations, `NAME.pos`, corrected by a model; all else passes through.

    Its angles are those of the arm as drawn whose tool is where the real one is. It continues the motion of the actions
    that were sent, until `forget`.

    Attributes:
        source: file of the model, for what is logged. scale: (n,), rad per unit of the angles.
        motion: of the commands sent, without what leads them; None before the first. clock: s, when a wish comes.
    """

    def __init__(self, source: str, correction: Correction, prefix: str = "") -> None:
        self.source, self.correction, self.prefix = source, correction, prefix
        self.keys = tuple(f"{prefix}{name}{SUFFIX}" for name in correction.names)
        _ = correction.arm, correction.drawn, correction.behind_encoders  # packed before the first command
        self.scale: Array = np.empty(0)
        self.motion: Motion | None = None
        self.clock: Callable[[], float] = time.monotonic
        self._before: BoundedCommand | None = None
        self._lead: Lead | None = correction.lead
        self._told: set[str] = set()
        self._tell_what_is_left()

    def forget(self) -> None:
        """Begins a new motion with the next action."""
        self.motion = self._before = None
        self._lead = self.correction.lead

    def check_names(self, features: Mapping[str, Any], robot: str) -> None:
        """Raises `LrmError`: a robot's actions lack a joint of the model."""
        missing = [key for key in self.keys if key not in features]
        if missing:
            what = f"a model of the arm '{self.correction.model.arm.name}', whose '{missing[0].removesuffix(SUFFIX)}'"
            have = ", ".join(key.removesuffix(SUFFIX) for key in features if key.endswith(SUFFIX))
            raise LrmError(f"{self.source}: {what} {robot} does not have; it has {have}")

    def corrected(self, action: Mapping[str, Any], observe: Callable[[], Mapping[str, Any]]) -> CorrectedAction:
        """The action whose tool is where the wished angles would have it on the arm as drawn.

        How far it may be from the wish, and from the command before: `lerobot_robot_lrm.bounded`.

        Args:
            observe: what the encoders read, asked for before the first action.

        Raises `LrmError`: a joint is missing or no number, or the arm cannot stand where it is seen.
        """
        now, wish = self.clock(), self._angles(action, "action")
        motion = self.motion or Motion.at(self._standing(observe()))
        answer = bounded_command(self.correction, wish, motion, self._before)
        self._tell_of(wish, answer)
        lead = None if self._lead is None else self._lead.after(answer.wish, now)
        command = answer.command if lead is None else np.clip(answer.command + lead.ahead, *self.correction.limits)
        return CorrectedAction(self._with(action, command), wish, answer, motion, command - answer.command, lead)

    def follow(self, asked: CorrectedAction, sent: Mapping[str, Any]) -> dict[str, Any]:
        """Takes down what was really sent of a corrected action; the same in true angles. Raises `LrmError`.

        What leads it is taken off: a joint that stops comes from where it was, though its command falls back.
        """
        angles, command = self._angles(sent, "action sent"), asked.answer.command
        angles = angles - np.clip(angles - command, np.minimum(asked.led, 0.0), np.maximum(asked.led, 0.0))
        self.motion, self._before, self._lead = asked.motion.to(angles), asked.answer, asked.lead
        whole = not asked.answer.lost and not asked.answer.bounded.any()
        as_wished = whole and np.allclose(angles, command, rtol=0.0, atol=1e-9)
        held = np.array_equal(command, asked.motion.q)
        if as_wished and not held:
            return self._with(sent, asked.wish)
        return self._with(sent, self._seen_from(self.correction.reached, angles, self.motion))

    def observed(self, seen: Mapping[str, Any]) -> dict[str, Any]:
        """An observation with the joints where the model says that they really are. Raises `LrmError`."""
        encoders = self._angles(seen, "observation")
        motion = self.motion or Motion.at(encoders)
        return self._with(seen, self._seen_from(self.correction.true_angles, encoders, motion))

    def _seen_from(self, inverse: Callable[[Array, Motion], Array], encoders: Array, motion: Motion) -> Array:
        try:
            return inverse(encoders, motion)
        except NoEquilibrium as error:
            self._tell(f"some observations are as the encoders read them ({error})")
            return encoders

    def _standing(self, seen: Mapping[str, Any]) -> Array:
        """(n,), rad, of the joints before the first action."""
        angles = self._angles(seen, "observation")
        require_standing(self.correction.model.arm, angles)
        return angles

    def _angles(self, values: Mapping[str, Any], what: str) -> Array:
        """(n,), rad, of the joints in an action or an observation."""
        if not len(self.scale):
            raise LrmError("the robot is not connected; call connect() first")
        missing = [key for key in self.keys if key not in values]
        if missing:
            raise LrmError(f"the {what} has no '{missing[0]}'; it has {', '.join(sorted(map(str, values)))}")
        angles = np.array([float(values[key]) for key in self.keys]) * self.scale
        if not np.isfinite(angles).all():
            key = self.keys[int(np.flatnonzero(~np.isfinite(angles))[0])]
            raise LrmError(f"the {what} has '{key}' = {values[key]}; should be a finite number")
        return angles

    def _with(self, values: Mapping[str, Any], angles: Array) -> dict[str, Any]:
        """The same with the joints at angles (n,), rad."""
        return {**values, **dict(zip(self.keys, (angles / self.scale).tolist(), strict=True))}

    def _tell_of(self, wish: Array, answer: BoundedCommand) -> None:
        low, high = self.correction.limits
        beyond, names = (wish < low) | (wish > high), self.correction.names
        for name in (name for name, far in zip(names, beyond, strict=True) if far):
            self._tell(f"{name} is wished beyond the limits of the arm file; it goes as far as they allow")
        for name in (name for name, bit in zip(names, answer.bounded, strict=True) if bit):
            most = f"{np.degrees(FARTHEST):.0f} deg in all, and a bounded step"
            self._tell(f"the correction of {name} is held at its bound ({most}); the tip is less accurate there")
        if answer.lost:
            self._tell(f"no command is found for some wishes ({answer.lost}); they go with the correction before")
        elif answer.left > NOTABLE_M and not beyond.any():
            where = "near a singular pose the correction is held back, so that no joint swings out"
            self._tell(f"{where}; there the tip stays more than {1e3 * NOTABLE_M:.0f} mm beside its goal")

    def _tell_what_is_left(self) -> None:
        correction = self.correction
        if correction.left_out:
            self._tell(
                f"not corrected, since no command can know it beforehand: {', '.join(map(marked, correction.left_out))}"
            )
        if correction.unused_effects:
            self._tell(f"not used of the model of motion: {', '.join(correction.unused_effects)}")
        if correction.with_direction:
            where = ", ".join(correction.with_direction)
            has = "the model of poses has an error by direction there"
            self._tell(f"friction and play of the model of motion are not used at {where}: {has}")
        if not correction.arm.complete:
            self._tell("some effect has no formula in the compiled kernel; a command takes 0.7 ms, not 0.2")

    def _tell(self, what: str) -> None:
        """Says something once."""
        if what not in self._told:
            self._told.add(what)
            logger.warning("%s: %s%s", self.source, f"{self.prefix}: " if self.prefix else "", what)
