"""The record of any case."""

from __future__ import annotations

from pathlib import Path

from lrm_math.errors import LrmError
from validation.as_deployed.loop import InstantLoop
from validation.as_deployed.outcome import Record, examined
from validation.as_deployed.real_arm import nested_record
from validation.as_deployed.worlds import OngoingCase


def examine(case: OngoingCase, real: Path | None = None) -> Record:
    """The record of a case; `real`: folder of the real measurements. Never raises `LrmError`."""
    match case.part:
        case "loop":
            return InstantLoop(case.seed).record()
        case "real":
            assert real is not None
            try:
                parameters, folding = case.name.split(", ")
                return nested_record(real, parameters, folding, case.poses)
            except LrmError as problem:
                return {"trouble": str(problem)}
    try:
        run = case.record()
    except RuntimeError as problem:  # the world itself has no equilibrium
        return {"hidden": case.hidden, "trouble": f"world: {problem}"}
    return {"hidden": case.hidden, **examined(run, floor=case.part == "lean")}
