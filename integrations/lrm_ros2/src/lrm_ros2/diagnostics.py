"""Statements of the daemon about itself, as rows of a `diagnostic_msgs/DiagnosticArray`."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from lrmd.client import ModeState, ThermalState


class Severity(IntEnum):
    """Level of a diagnostic status."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True)
class DiagnosticRow:
    """One status: what, how bad, in words, and further pairs of names and values."""

    name: str
    level: Severity
    text: str
    values: tuple[tuple[str, str], ...] = ()


STOPPED = ("fault", "estop")


def mode_row(state: ModeState) -> DiagnosticRow:
    """Mode of the daemon and its link: error in `fault` and `estop`, warning with troubles or without the board."""
    level = Severity.OK
    if state.mode in STOPPED:
        level = Severity.ERROR
    elif state.troubles or state.link != "ready":
        level = Severity.WARN
    text = "; ".join([f"{state.mode} ({state.why})" if state.why else state.mode, *state.troubles])
    return DiagnosticRow("lrmd: mode", level, text, (("link", state.link), ("holder", state.holder or "")))


def fault_row(faults: dict[str, str]) -> DiagnosticRow:
    """Faults that are not reset yet, by code."""
    level = Severity.ERROR if faults else Severity.OK
    return DiagnosticRow("lrmd: faults", level, "; ".join(faults.values()) or "none", tuple(faults.items()))


def heat_row(state: ThermalState) -> DiagnosticRow:
    """Modelled temperatures (°C): warning if a servo is not at its level `cool`."""
    warm = [f"{name} is {level}" for name, level in zip(state.names, state.level, strict=True) if level != "cool"]
    pairs = zip(state.names, (f"{degrees:.1f} degC" for degrees in state.temperature_c), strict=True)
    return DiagnosticRow(
        "lrmd: servo heat", Severity.WARN if warm else Severity.OK, "; ".join(warm) or "cool", tuple(pairs)
    )


def silent_row() -> DiagnosticRow:
    """Nothing was heard of the daemon."""
    return DiagnosticRow("lrmd: mode", Severity.STALE, "the daemon is silent")
