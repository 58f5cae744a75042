"""What a model of motion says of the arm's commands: how long its tip swings after a move, and the shaper against it.

Theory of operation: without a model (deployed, or `[motion] model` of the configuration) nothing is predicted and
nothing shaped. Another model counts from the next motion on: one under way goes on as it was ordered.
The modes are those of the posture in which a leg ends, with the load that is carried. A leg whose servos run together
goes the same way shaped, only with gentler ends; a timed one (`lrm_math.motion.waits`) waits for some ticks before its
last counts. One whose servos run each at their own rate, jogs, contacts and the
way to rest of a hot arm are never shaped. A hold or an emergency stop orders no motion, so there is nothing to shape.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from lrm_math.arm.pca9685 import COUNTS_PER_PERIOD
from lrm_math.arrays import Array, Vector3
from lrm_math.motion.modes import modes_at
from lrm_math.motion.motion_model import MotionModel
from lrm_math.motion.settling import settling_after
from lrm_math.motion.shaping import ShaperKind, shaper
from lrm_math.motion.waits import FREQUENCY_FACTORS, waits_of
from lrmd.config import SECOND, Config
from lrmd.control.ramp_orders import Leg, Pulses, overlaid
from lrmd.ramp.shared_memory import IMPULSES
from lrmd.ramp.stepping import SHARES, Move, Pace, valid_impulses

LegShape: TypeAlias = ShaperKind | Literal["timed"]
PHASES_IN_TICK, STEP_S = 4, 0.005
"""Settling is predicted with phases of the board's frames so many in a tick, 12 at 50 Hz; the longest step (s)."""
USUAL, SURE = 0.6, 0.95
"""Shares of these cases in which the tip has settled by the predicted times."""


@dataclass(frozen=True)
class FinalLeg:
    """The last leg of a motion: its `move` of pulses (ns), and the load (kg) and its centre (m) along it."""

    move: Move
    payload: float
    load_at: Vector3


class SettlingTimes(NamedTuple):
    """Times (s) from the end of a move by which its tip has settled in `USUAL` and in `SURE` of the simulated cases."""

    usual: float
    sure: float


class MotionPredictor:
    """A model of motion of the daemon's arm; `path` and `sha256`: of its file."""

    def __init__(self, config: Config, model: MotionModel, path: str = "", sha256: str = "") -> None:
        self._config, self._model, self.path, self.sha256 = config, model, path, sha256

    def shaped(self, start: Pulses, leg: Leg, kind: LegShape, payload: float, load_at: Vector3) -> Leg:
        """The leg from pulses (ns), shaped for a load (kg) and its centre (m).

        As it is where nothing swings, or its servos do not run together.
        """
        if kind == "timed":
            return self._timed(start, leg, payload, load_at)
        modes = modes_at(self._carrying(load_at), self._angles(np.array([overlaid(start, leg.target)]))[0], payload)
        if modes is None or leg.pace is not Pace.TOGETHER:
            return leg
        impulses = shaper(kind, modes, self._config.tick / SECOND, SHARES, IMPULSES)
        fits = valid_impulses(impulses) and len(impulses) <= IMPULSES
        return replace(leg, impulses=impulses) if fits else leg

    def _timed(self, start: Pulses, leg: Leg, payload: float, load_at: Vector3) -> Leg:
        """The leg, waiting so that the jolts of its last counts cancel; as it is unless its servos run together."""
        if leg.pace is not Pace.TOGETHER:
            return leg
        path, tick = self._path(leg.move(start)), self._config.tick / SECOND
        return replace(leg, waits=waits_of(self._carrying(load_at), path, tick, self._frame, payload))

    def settling(self, final_leg: FinalLeg) -> SettlingTimes:
        """Times (s) from the end of the last leg until the tip stays within `motion.within_mm` of its rest.

        The command is the board's: pulses rounded to its counts, frame by frame. The phase of its frames is not known,
        and frequencies only nearly, so several of both are simulated.
        """
        path, model = self._path(final_leg.move), self._carrying(final_leg.load_at)
        tick, frame = self._config.tick / SECOND, self._frame
        steps = math.ceil(frame / STEP_S)
        ends = (len(path) - 1) * tick
        began = np.arange(math.ceil(ends / frame) + 1) * frame
        phases = (np.arange(many := round(PHASES_IN_TICK * frame / tick) or 1) + 0.5)[:, None] / many * frame
        seen = path[np.minimum(((began + phases) / tick).astype(int), len(path) - 1)].repeat(steps, axis=1)
        within = self._config.motion.within_mm * 1e-3
        settling = settling_after(
            model, path[0], seen, frame / steps, within, final_leg.payload, FREQUENCY_FACTORS, (USUAL, SURE)
        )
        begin = (len(began) + 0.5) * frame - ends
        return SettlingTimes(*(begin + leg.seconds if leg.seconds else 0.0 for leg in settling))

    @property
    def _frame(self) -> float:
        """s between two pulses of the board."""
        return COUNTS_PER_PERIOD * self._config.clock.count_s

    def _path(self, move: Move) -> Array:
        """(M + 1, n), angles (rad) that the board puts out after each tick of a move."""
        return self._angles(np.array([move.at(k) for k in range(move.length + 1)]))

    def _carrying(self, load_at: Vector3) -> MotionModel:
        return replace(self._model, arm=self._model.arm.with_load_at(load_at)) if any(load_at) else self._model

    def _angles(self, pulses: Array) -> Array:
        """(M, n), angles (rad) of the joints at pulses (M, servos), ns, as the board rounds them."""
        count = self._config.clock.count_s
        joints = self._config.servos[: self._config.dof]
        rounded = np.floor(pulses * (1e-9 / count) + 0.5) * count
        return np.stack([np.asarray(s.table.angle_of(rounded[:, i])) for i, s in enumerate(joints)], axis=1)
