"""The record of any case."""

from __future__ import annotations

from pathlib import Path

from examples.demo.world import SPEED
from lrm_math.errors import LrmError
from validation.as_deployed.absurd import said_by_auto
from validation.as_deployed.board.loop import loop_record
from validation.as_deployed.board.without_board import InstantLoop
from validation.as_deployed.outcome import Record, examined
from validation.as_deployed.real_arm import nested_record
from validation.as_deployed.worlds import OngoingCase


def examine(case: OngoingCase, real: Path | None = None, speed: float = SPEED) -> Record:
    """The record of a case. Never raises `LrmError`.

    `real`: folder of the real measurements. `speed`: of the simulated board's clock against the computer's.
    """
    match case.part:
        case "loop":
            return InstantLoop(case.seed).record()
        case "board":
            return loop_record(case.seed, speed)
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
    said = {"says": said_by_auto(run)} if case.part == "absurd" else {}
    return {"hidden": case.hidden, **examined(run, floor=case.part == "lean"), **said}
