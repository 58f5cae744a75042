"""First pulses of servos that are switched on. RC servos jump to their first pulse: it must match their position.

Theory of operation: where the position comes from depends on the request and on the pulses that the board puts out. A
board that was left pulsing, by a daemon that ended, knows best: it is taken over or nothing is switched on. Otherwise
the client says where the arm stands, or the pose is that which was stored when the arm last stood still, unless it has
fallen since (`fallen_servos.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import StrEnum

from lrmd.config import Config
from lrmd.control.ramp_orders import within_limits
from lrmd.errors import RequestError
from lrmd.messages.control import ArmRequest
from lrmd.persistence.state_file import StoredState
from lrmd.ramp.shared_memory import RampReport

SAY_WHERE = 'state it: lrm arm --at SERVO ANGLE (--q for all joints; in rpc/arm: "where": "given" with q_rad)'
"""What a client does whose arm is not where the daemon could know; a servo jumps to what is stated."""


class BoardPulses(StrEnum):
    """Output of the board: nothing, only pulses of this daemon, or pulses that somebody else left."""

    NONE = "none"
    OWN = "own"
    LEFT = "left"


@dataclass(frozen=True)
class ArmingSituation:
    """Sources of the pose of an arming request. `fallen`: servos that are not where they were commanded."""

    request: ArmRequest
    config: Config
    report: RampReport
    stored: StoredState
    fallen: frozenset[str]

    @property
    def board(self) -> BoardPulses:
        """The board's pulses."""
        if self.report.board_outputs & ~self.report.outputs:
            return BoardPulses.LEFT
        return BoardPulses.OWN if self.report.board_outputs else BoardPulses.NONE


def arming_pulses(
    request: ArmRequest, config: Config, report: RampReport, stored: StoredState, fallen: Iterable[str]
) -> dict[int, int]:
    """First pulse (ns) by number of every servo that the request switches on, at its present position.

    Raises `RequestError` if the position is unknown, `UnknownName`.
    """
    situation = ArmingSituation(request, config, report, stored, frozenset(fallen))
    pose = TABLE[request.where, situation.board](situation)
    off = {i: pulse for i, pulse in pose.items() if not report.outputs >> i & 1}
    return {i: within_limits(config.servos[i], pulse) for i, pulse in off.items()}


def stored_angles(config: Config, stored: StoredState | None) -> dict[str, float]:
    """Stored angle (rad) of every servo that has one."""
    pulses = stored.pulse_ns if stored else {}
    return {s.name: s.angle(pulses[s.name]) for s in config.servos if s.name in pulses}


def _registers(a: ArmingSituation) -> dict[int, int]:
    return {i: a.report.register[i] for i in range(len(a.config.servos)) if a.report.board_outputs >> i & 1}


def _nothing_to_take_over(a: ArmingSituation) -> dict[int, int]:
    here = "only pulses of this daemon, which go on" if a.report.outputs else "no pulses"
    raise RequestError(
        "pose_needed",
        f"the board has {here}: there is nothing to take over. Look where each servo that is off stands and "
        f"{SAY_WHERE}; it jumps to what you state. Or, if nobody has touched the arm since: lrm arm --stored",
        stored_rad=stored_angles(a.config, a.stored),
        stored_still=bool(a.stored.pulse_ns and a.stored.still and not a.fallen),
    )  # fmt: skip


def _still_pulsing(_: ArmingSituation) -> dict[int, int]:
    raise RequestError(
        "still_pulsing",
        'the board is still pulsing; take its pose over: lrm arm --board (in rpc/arm: "where": "board")',
    )


def _given(a: ArmingSituation) -> dict[int, int]:
    if not a.request.q_rad:
        raise RequestError("pose_needed", '"where": "given" needs q_rad: the present angles of the servos')
    indices = {a.config.index(name): q for name, q in a.request.q_rad.items()}
    return {i: a.config.servos[i].pulse_ns(q) for i, q in indices.items()}


def _from_store(a: ArmingSituation) -> dict[int, int]:
    stored, names = a.stored, a.request.servos
    if not stored.pulse_ns:
        raise RequestError("pose_needed", f"no pose was stored yet; {SAY_WHERE}")
    if not stored.still:
        text = "the arm was moving when its pose was last stored; look where it stands, and"
        raise RequestError("pose_needed", f"{text} {SAY_WHERE}")
    names = [name for name in stored.pulse_ns if name in a.config.names] if names is None else names
    for name in names:
        a.config.index(name)
        if name in a.fallen and name in stored.pulse_ns:
            text = f"{name} is not where it was: its pulses ended in motion or under load, and the arm fell; look where"
            raise RequestError("pose_needed", f"{text} it stands, and {SAY_WHERE}")
        if name not in stored.pulse_ns:
            raise RequestError("pose_needed", f"no pose of {name} was stored; {SAY_WHERE}")
    return {a.config.index(name): stored.pulse_ns[name] for name in names}


TABLE: dict[tuple[str, BoardPulses], Callable[[ArmingSituation], dict[int, int]]] = {
    ("board", BoardPulses.NONE): _nothing_to_take_over,
    ("board", BoardPulses.OWN): _registers,
    ("board", BoardPulses.LEFT): _registers,
    ("given", BoardPulses.NONE): _given,
    ("given", BoardPulses.OWN): _given,
    ("given", BoardPulses.LEFT): _still_pulsing,
    ("stored", BoardPulses.NONE): _from_store,
    ("stored", BoardPulses.OWN): _from_store,
    ("stored", BoardPulses.LEFT): _still_pulsing,
}
"""Source of the pose, by the request's `where` and the board's pulses."""
