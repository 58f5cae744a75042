"""Where the servos stand that are to be switched on. RC servos jump to their first pulse, so it must be right."""

from __future__ import annotations

from collections.abc import Sequence

from lrmd.config import Config
from lrmd.control.pulses import within_limits
from lrmd.errors import Refused
from lrmd.messages.control import ArmRequest
from lrmd.persistence.state_file import Saved
from lrmd.ramp.shared_memory import Report


def standing(request: ArmRequest, config: Config, report: Report, stored: Saved | None) -> dict[int, int]:
    """Pulse (ns) by number of every servo that the request switches on, from what it knows of where they stand.

    Raises `Refused` where nobody knows, `UnknownName`.
    """
    if request.where == "board":
        pose = _on_the_board(config, report, stored)
    elif report.board_outputs & ~report.outputs:
        raise Refused("still_pulsing", "the board is still pulsing; take its pose over with where = 'board'")
    elif request.where == "given":
        if not request.q_rad:
            raise Refused("pose_needed", "where = 'given' needs q_rad: the angles where the servos stand")
        pose = {config.index(n): config.servos[config.index(n)].pulse_ns(q) for n, q in request.q_rad.items()}
    else:
        pose = _as_stored(config, stored, request.servos)
    fresh = {i: pulse for i, pulse in pose.items() if not report.outputs >> i & 1}
    return {i: within_limits(config.servos[i], pulse) for i, pulse in fresh.items()}


def stored_angles(config: Config, stored: Saved | None) -> dict[str, float]:
    """Angle (rad) of every servo as it was stored."""
    pulses = stored.pulse_ns if stored else {}
    return {s.name: s.angle(pulses[s.name]) for s in config.servos if s.name in pulses}


def _on_the_board(config: Config, report: Report, stored: Saved | None) -> dict[int, int]:
    if not report.board_outputs:
        raise Refused(
            "pose_needed",
            "the board has no pulses to take over. Say where the arm stands: where = 'given' with q_rad, or 'stored' "
            "if it has not been touched since the daemon left it",
            stored_rad=stored_angles(config, stored), stored_still=bool(stored and stored.still),
        )  # fmt: skip
    return {i: report.register[i] for i in range(len(config.servos)) if report.board_outputs >> i & 1}


def _as_stored(config: Config, stored: Saved | None, names: Sequence[str] | None) -> dict[int, int]:
    if stored is None or not stored.pulse_ns:
        raise Refused("pose_needed", "no pose was stored yet; say it with where = 'given' and q_rad")
    if not stored.still:
        text = "the arm was moving when its pose was last stored; say it with where = 'given' and q_rad"
        raise Refused("pose_needed", text)
    wanted = [name for name in stored.pulse_ns if name in config.names] if names is None else names
    for name in wanted:
        config.index(name)
        if name not in stored.pulse_ns:
            raise Refused("pose_needed", f"no pose of {name} was stored; say it with where = 'given' and q_rad")
    return {config.index(name): stored.pulse_ns[name] for name in wanted}
