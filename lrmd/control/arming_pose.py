"""First pulses of servos that are switched on. RC servos jump to their first pulse: it must match their position."""

from __future__ import annotations

from collections.abc import Sequence

from lrmd.config import Config
from lrmd.control.pulses import within_limits
from lrmd.errors import RequestError
from lrmd.messages.control import ArmRequest
from lrmd.persistence.state_file import StoredState
from lrmd.ramp.shared_memory import RampReport


def arming_pulses(
    request: ArmRequest, config: Config, report: RampReport, stored: StoredState | None
) -> dict[int, int]:
    """First pulse (ns) by number of every servo that the request switches on, at its present position.

    Raises `RequestError` if the position is unknown, `UnknownName`.
    """
    if request.where == "board":
        pose = _from_board(config, report, stored)
    elif report.board_outputs & ~report.outputs:
        raise RequestError("still_pulsing", "the board is still pulsing; take its pose over with where = 'board'")
    elif request.where == "given":
        if not request.q_rad:
            raise RequestError("pose_needed", "where = 'given' needs q_rad: the present angles of the servos")
        pose = {config.index(n): config.servos[config.index(n)].pulse_ns(q) for n, q in request.q_rad.items()}
    else:
        pose = _from_store(config, stored, request.servos)
    off = {i: pulse for i, pulse in pose.items() if not report.outputs >> i & 1}
    return {i: within_limits(config.servos[i], pulse) for i, pulse in off.items()}


def stored_angles(config: Config, stored: StoredState | None) -> dict[str, float]:
    """Stored angle (rad) of every servo that has one."""
    pulses = stored.pulse_ns if stored else {}
    return {s.name: s.angle(pulses[s.name]) for s in config.servos if s.name in pulses}


def _from_board(config: Config, report: RampReport, stored: StoredState | None) -> dict[int, int]:
    if not report.board_outputs:
        raise RequestError(
            "pose_needed",
            "the board has no pulses to take over. Say where the arm stands: where = 'given' with q_rad, or 'stored' "
            "if it has not been touched since the daemon left it",
            stored_rad=stored_angles(config, stored), stored_still=bool(stored and stored.still),
        )  # fmt: skip
    return {i: report.register[i] for i in range(len(config.servos)) if report.board_outputs >> i & 1}


def _from_store(config: Config, stored: StoredState | None, names: Sequence[str] | None) -> dict[int, int]:
    if stored is None or not stored.pulse_ns:
        raise RequestError("pose_needed", "no pose was stored yet; send it with where = 'given' and q_rad")
    if not stored.still:
        text = "the arm was moving when its pose was last stored; send it with where = 'given' and q_rad"
        raise RequestError("pose_needed", text)
    names = [name for name in stored.pulse_ns if name in config.names] if names is None else names
    for name in names:
        config.index(name)
        if name not in stored.pulse_ns:
            raise RequestError("pose_needed", f"no pose of {name} was stored; send it with where = 'given' and q_rad")
    return {config.index(name): stored.pulse_ns[name] for name in names}
