"""How the joints came to where they are commanded, and since when they have pulses: what friction, play and warming up
depend on (`lrm_math.kinematics.known`).

Theory of operation: the record follows the pulses that the ramp sent. A report has the last pulse of each servo and the
one at which it last turned round, so no turn between two reports is missed. The record outlives pulses that end, and
the daemon, where the servo gets its next pulse where it had its last one: from the board that went on pulsing, or from
the stored pose of an arm that nobody has touched. Of a servo whose position somebody states nothing is known.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from lrm_math.arrays import Array
from lrm_math.kinematics.known import Known
from lrm_math.kinematics.motion import Motion
from lrmd.config import SECOND, Config
from lrmd.persistence.state_file import StoredArrival, StoredState
from lrmd.ramp.shared_memory import FRICTION_ELEMENTS, ArmKnowledge, RampReport


class MotionRecord:
    """`motion`: of the joints. `powered`: since when they have pulses (monotonic ns), None without; `powered_at_c`:
    temperature of the hottest servo then."""

    def __init__(self, config: Config, stored: StoredState | None, now: int, wall: int) -> None:
        self._config = config
        self._joints = (1 << config.dof) - 1
        self._pulses, self._turned_at = (0,) * config.dof, (0,) * config.dof
        self._outputs = 0
        self.motion = Motion.at([0.0] * config.dof)
        self.powered: int | None = None
        self.powered_at_c: float | None = None
        self._temperature: float | None = None
        self._now = now
        self._left: tuple[int, float] | None = None
        if stored is not None and stored.still:
            self._restore(stored, now - (wall - stored.saved_wall_ns))

    def _restore(self, stored: StoredState, saved: int) -> None:
        """The record of a state that was stored at `saved` (monotonic ns): of joints that have pulses from there on."""
        names = self._config.names[: self._config.dof]
        self._pulses = tuple(stored.pulse_ns.get(name, 0) for name in names)
        arrivals = [stored.arrival.get(name, StoredArrival()) for name in names]
        side, friction = [a.direction for a in arrivals], [a.friction for a in arrivals]
        self.motion = Motion(self._angles(self._pulses), np.array(side, dtype=np.float64), np.array(friction))
        if stored.powered_s > 0.0:
            self._left = saved - round(stored.powered_s * SECOND), stored.powered_at_c

    def follow(self, report: RampReport, hottest: float, now: int) -> None:
        """Takes a report of the ramp over; `hottest`: temperature of the hottest servo (degC)."""
        n = self._config.dof
        on, turned_at = report.outputs & self._joints, report.turned_at[:n]
        if begun := on & ~self._outputs:
            self._begin(begun, report.position[:n])
        pulses = self._chosen(on, report.position[:n])
        if pulses != self._pulses:
            turned = sum(1 << i for i in range(n) if turned_at[i] != self._turned_at[i])
            corner = self._chosen(on & self._outputs & turned, turned_at)
            self.motion = self.motion.to(self._angles(corner)).to(self._angles(pulses))
            self._pulses = pulses
        self._power(on, report, hottest, now)
        self._outputs, self._turned_at, self._now, self._temperature = on, turned_at, now, hottest

    def _begin(self, servos: int, pulses: tuple[int, ...]) -> None:
        """Servos (bits) got their first pulses (ns): what is known of those stays that get the pulse they had."""
        count = self._config.clock.count_s * SECOND
        jumped = [abs(new - old) > count for new, old in zip(pulses, self._pulses, strict=True)]
        first = [bool(servos >> i & 1) for i in range(len(jumped))]
        self._pulses = self._chosen(servos, pulses)
        moved = Motion(self._angles(self._pulses), self.motion.side, self.motion.friction)
        self.motion = moved.forgotten(np.logical_and(first, jumped))

    def _power(self, on: int, report: RampReport, hottest: float, now: int) -> None:
        if not on:
            self.powered = self.powered_at_c = None
        elif self.powered is None:
            taken_over = self._left if report.board_outputs & on == on else None
            self.powered, self.powered_at_c = taken_over or (now, hottest)
        if on:
            self._left = None

    def forget(self, servos: Iterable[int]) -> None:
        """Nothing is known of how some servos, by number, came to where they are."""
        gone = set(servos)
        self.motion = self.motion.forgotten(np.array([i in gone for i in range(self._config.dof)]))

    def _chosen(self, servos: int, pulses: Iterable[int]) -> tuple[int, ...]:
        """These pulses (ns) of some servos (bits), the last ones of the others."""
        return tuple(new if servos >> i & 1 else self._pulses[i] for i, new in enumerate(pulses))

    def _angles(self, pulses: tuple[int, ...]) -> Array:
        joints = self._config.servos[: self._config.dof]
        return np.array([s.angle(p) if p else 0.0 for s, p in zip(joints, pulses, strict=True)])

    def added_to(self, state: StoredState) -> StoredState:
        """A state to store, with this record."""
        arrivals = {
            name: StoredArrival(direction=int(side), friction=friction.tolist())
            for name, side, friction in zip(self._config.names, self.motion.side, self.motion.friction, strict=False)
            if side
        }
        powered = {"powered_s": self.powered_s or 0.0, "powered_at_c": self.powered_at_c or 0.0}
        return state.model_copy(update={"arrival": arrivals, **powered})

    @property
    def powered_s(self) -> float | None:
        """Time for which the joints have had pulses (s); None without."""
        return None if self.powered is None else (self._now - self.powered) / SECOND

    @property
    def knowledge(self) -> ArmKnowledge:
        """Present knowledge: nothing of the moves of an arm some of whose joints have no pulses."""
        if self._outputs != self._joints:
            return ArmKnowledge()
        m = self.motion
        return ArmKnowledge(
            joints=len(m.q), q=tuple(m.q.tolist()), side=tuple(m.side.tolist()),
            friction=tuple(m.friction.ravel().tolist()), powered=self.powered or 0,
            temperature=self._temperature or 0.0, warmed=(self._temperature or 0.0) - (self.powered_at_c or 0.0),
        )  # fmt: skip


def known_of(knowledge: ArmKnowledge, now: int) -> Known:
    """The knowledge of the arm at `now` (monotonic ns)."""
    n = knowledge.joints
    if not n:
        return Known()
    q, side = np.array(knowledge.q[:n]), np.array(knowledge.side[:n])
    friction = np.array(knowledge.friction).reshape(-1, FRICTION_ELEMENTS)[:n]
    running = max(0.0, (now - knowledge.powered) / SECOND)
    return Known(Motion(q, side, friction), running, knowledge.temperature, knowledge.warmed)
