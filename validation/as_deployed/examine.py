"""The record of any case by its key."""

from __future__ import annotations

from pathlib import Path

from examples.demo.world import SPEED
from lrm_math.errors import LrmError
from validation.as_deployed.absurd import said_by_auto
from validation.as_deployed.board.loop import loop_record
from validation.as_deployed.board.without_board import InstantLoop
from validation.as_deployed.outcome import Record, examined
from validation.as_deployed.real_arm import nested_record
from validation.as_deployed.worlds import SimulatedCase, seed_of


def examine(key: str, real: Path | None = None, speed: float = SPEED) -> Record:
    """The record of a case. Never raises `LrmError`.

    `real`: folder of the real measurements. `speed`: of the simulated board's clock against the computer's.
    """
    part = key.partition("/")[0]
    if part == "loop":
        return InstantLoop(seed_of(key)).record()
    if part == "board":
        return loop_record(seed_of(key), speed)
    if part == "real" and real is not None:
        parameters, folding = key.split("/")[1].split(", ")
        try:
            return nested_record(real, parameters, folding)
        except LrmError as problem:
            return {"trouble": str(problem)}
    case = SimulatedCase.of(key)
    try:
        run = case.record()
    except RuntimeError as problem:  # the world itself has no equilibrium
        return {"hidden": case.hidden, "trouble": f"world: {problem}"}
    said = {"says": said_by_auto(run)} if part == "absurd" else {}
    return {"hidden": case.hidden, **examined(run, floor=part == "lean"), **said}
