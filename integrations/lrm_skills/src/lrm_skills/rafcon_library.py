"""A RAFCON library of the daemon's skills, and state machines made of it, for the execution engine without a window.

`python -m lrm_skills.rafcon_library FOLDER` writes the library: a state for each skill, with the input port `fields`
(those of `SkillRequest`) and an outcome for whatever may come of it. The states take the rover, whose lease is held,
from the global variable `lrm_rover`. A state that is preempted holds the arm.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, get_args

from rafcon.core.singleton import global_variable_manager
from rafcon.core.state_machine import StateMachine
from rafcon.core.states.execution_state import ExecutionState
from rafcon.core.states.hierarchy_state import HierarchyState
from rafcon.core.storage import storage

from lrm_math.errors import LrmError
from lrmd.client import RequestRefused, Rover
from lrmd.messages.skills import Outcome, SkillName

ROVER, LOOK_S = "lrm_rover", 0.05
"""Name of the global variable, and s between two looks at a skill."""
ENDS = [outcome for outcome in get_args(Outcome) if outcome not in ("none", "running")]
SCRIPT = """\
from lrm_skills.rafcon_library import run_skill


def execute(self, inputs, outputs, gvm):
    return run_skill(self, {skill!r}, inputs["fields"], outputs, gvm)
"""


def give_rover(rover: Rover) -> None:
    """Lets the states of all machines use this rover."""
    global_variable_manager.set_variable(ROVER, rover, per_reference=True)


def run_skill(state: Any, skill: SkillName, fields: Mapping[str, Any], outputs: dict[str, Any], variables: Any) -> str:
    """Carries out a skill for a RAFCON state: the name of its outcome; in words it is the output `text`."""
    rover: Rover = variables.get_variable(ROVER)
    if rover is None:
        raise LrmError(f"the global variable {ROVER} has no rover; call lrm_skills.rafcon_library.give_rover first")
    try:
        now = rover.skill(skill, wait=False, **fields)
    except LrmError as error:
        outputs["text"] = str(error)
        return "refused" if isinstance(error, RequestRefused) else "stopped"
    while now.outcome == "running":
        if state.preemptive_wait(LOOK_S):
            rover.hold()
        now = rover.follow_skill(now)
    outputs["text"] = now.text
    return now.outcome


def skill_state(skill: SkillName, fields: Mapping[str, Any] | None = None) -> ExecutionState:
    """A state that carries out a skill, with fields of its own or those of its input port."""
    state = ExecutionState(skill)
    for number in [number for number in state.outcomes if number >= 0]:
        state.remove_outcome(number, destroy=True)
    for number, outcome in enumerate(ENDS):
        state.add_outcome(outcome, number)
    state.add_input_data_port("fields", dict, dict(fields or {}))
    state.add_output_data_port("text", str)
    state.script_text = SCRIPT.format(skill=skill)
    return state


def machine(name: str, steps: Iterable[tuple[SkillName, Mapping[str, Any]]]) -> StateMachine:
    """Skills one after the other; the machine's outcome is `success`, or `ended` where one does not reach its end."""
    root = HierarchyState(name)
    root.add_outcome("ended", 1)
    before = None
    for skill, fields in steps:
        state = skill_state(skill, fields)
        root.add_state(state)
        if before is None:
            root.set_start_state(state)
        else:
            root.add_transition(before.state_id, 0, state.state_id, None)
        for number in range(1, len(ENDS)):
            root.add_transition(state.state_id, number, root.state_id, 1)
        before = state
    if before is not None:
        root.add_transition(before.state_id, 0, root.state_id, 0)
    return StateMachine(root)


def write_library(folder: Path) -> list[Path]:
    """Writes each skill as a library state; the folders that RAFCON's `LIBRARY_PATHS` may name."""
    paths = [folder / skill for skill in get_args(SkillName)]
    for path in paths:
        storage.save_state_machine_to_path(StateMachine(skill_state(path.name)), str(path))
    return paths


if __name__ == "__main__":
    write_library(Path(sys.argv[1]))
