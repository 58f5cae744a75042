"""The record of any case by its key."""

from __future__ import annotations

from validation.as_deployed.absurd import said_by_auto
from validation.as_deployed.loop import InstantLoop
from validation.as_deployed.outcome import Record, examined
from validation.as_deployed.worlds import SimulatedCase, seed_of


def examine(key: str) -> tuple[str, Record]:
    """The record of a case. Never raises `LrmError`."""
    part = key.partition("/")[0]
    if part == "loop":
        return key, InstantLoop(seed_of(key)).record()
    case = SimulatedCase.of(key)
    try:
        run = case.record()
    except RuntimeError as problem:  # the world itself has no equilibrium
        return key, {"hidden": case.hidden, "trouble": f"world: {problem}"}
    said = {"says": said_by_auto(run)} if part == "absurd" else {}
    return key, {"hidden": case.hidden, **examined(run, floor=part == "lean"), **said}
