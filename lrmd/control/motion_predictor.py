"""What a model of motion says of the arm's commands: how long its tip swings after a move, and the shaper against it.

Theory of operation: without a model (`[motion] model` of the configuration) nothing is predicted and nothing shaped.
The modes are those of the posture in which a leg ends, with the load that is carried. A leg whose servos run together
goes the same way shaped, only with gentler ends. One whose servos run each at their own rate, jogs, contacts and the
way to rest of a hot arm are never shaped. A hold or an emergency stop orders no motion, so there is nothing to shape.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lrm_math.arm.arm_digest import WHAT_COUNTS, arm_sha256
from lrm_math.arrays import Array, Vector3
from lrm_math.errors import FileError
from lrm_math.motion.modes import modes_at
from lrm_math.motion.motion_model import MotionModel, load_motion
from lrm_math.motion.settling import settling_after
from lrm_math.motion.shaping import ShaperKind, shaper
from lrmd.config import SECOND, Config
from lrmd.control.ramp_orders import Leg, Pulses, overlaid
from lrmd.ramp.shared_memory import IMPULSES
from lrmd.ramp.stepping import SHARES, Move, Pace, valid_impulses


@dataclass(frozen=True)
class FinalLeg:
    """The last leg of a motion: its `move` of pulses (ns), and the load (kg) and its centre (m) along it."""

    move: Move
    payload: float
    load_at: Vector3


class MotionPredictor:
    """A model of motion of the daemon's arm."""

    def __init__(self, config: Config, model: MotionModel) -> None:
        self._config, self._model = config, model

    @staticmethod
    def of(config: Config) -> MotionPredictor | None:
        """That of the configuration; None without one. Raises `FileError`: the file cannot be used for this arm."""
        if config.motion.model is None:
            return None
        path = Path(config.motion.model)
        _, model = load_motion(path)
        if model.arm.name != config.arm.name or arm_sha256(model.arm) != arm_sha256(config.arm):
            what = f"a motion model of {model.arm.name}, whose {WHAT_COUNTS} differ from those of {config.arm.name}"
            raise FileError(path, "arm", what, f"one of {config.arm.name} as this daemon's arm file has it")
        return MotionPredictor(config, model)

    def shaped(self, start: Pulses, leg: Leg, kind: ShaperKind, payload: float, load_at: Vector3) -> Leg:
        """The leg from pulses (ns), shaped for a load (kg) and its centre (m).

        As it is where nothing swings, or its servos do not run together.
        """
        modes = modes_at(self._carrying(load_at), self._angles(np.array([overlaid(start, leg.target)]))[0], payload)
        if modes is None or leg.pace is not Pace.TOGETHER:
            return leg
        impulses = shaper(kind, modes, self._config.tick / SECOND, SHARES, IMPULSES)
        fits = valid_impulses(impulses) and len(impulses) <= IMPULSES
        return replace(leg, impulses=impulses) if fits else leg

    def settle_s(self, final_leg: FinalLeg) -> float:
        """Time (s) from the end of the last leg until the tip stays within `motion.within_mm` of its rest.

        The command is the board's: pulses rounded to its counts, tick by tick.
        """
        rows = np.array([final_leg.move.at(k) for k in range(final_leg.move.length + 1)])
        path = self._angles(rows)
        within, tick = self._config.motion.within_mm * 1e-3, self._config.tick / SECOND
        return settling_after(self._carrying(final_leg.load_at), path[0], path, tick, within, final_leg.payload).seconds

    def _carrying(self, load_at: Vector3) -> MotionModel:
        return replace(self._model, arm=self._model.arm.with_load_at(load_at)) if any(load_at) else self._model

    def _angles(self, pulses: Array) -> Array:
        """(M, n), angles (rad) of the joints at pulses (M, servos), ns, as the board rounds them."""
        count = self._config.clock.count_s
        joints = self._config.servos[: self._config.dof]
        rounded = np.floor(pulses * (1e-9 / count) + 0.5) * count
        return np.stack([np.asarray(s.table.angle_of(rounded[:, i])) for i, s in enumerate(joints)], axis=1)
