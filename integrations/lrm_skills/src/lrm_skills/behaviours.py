"""Skills as behaviours of py_trees (Colledanchise and Ögren 2018): one skill each, which a tree ticks until it ends.

A behaviour that the tree interrupts holds the arm. What the skill came to is in `outcome` and `feedback_message`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from py_trees.behaviour import Behaviour
from py_trees.common import Status
from py_trees.composites import Sequence

from lrm_math.errors import LrmError
from lrmd.client import RequestRefused, Rover
from lrmd.messages.skills import SkillName, SkillState


class SkillBehaviour(Behaviour):  # type: ignore[misc] # py_trees may be absent
    """One skill of a rover whose lease is held; `fields` are those of `SkillRequest`. Succeeds with the outcome
    `reached`, fails with any other; `outcome` is "refused" where the daemon did not begin it, and "stopped", too, where
    nothing is known of it any more: the arm was told to hold."""

    def __init__(self, rover: Rover, skill: SkillName, name: str = "", **fields: Any) -> None:
        super().__init__(name or skill)
        self.outcome = "none"
        self._rover, self._skill, self._fields = rover, skill, fields
        self._begun: SkillState | None = None

    def initialise(self) -> None:
        """Begins the skill."""
        self._begun = None
        try:
            self._begun = self._rover.skill(self._skill, wait=False, **self._fields)
        except LrmError as error:
            self.outcome = "refused" if isinstance(error, RequestRefused) else "stopped"
            self.feedback_message = str(error)

    def update(self) -> Status:
        """What came of it so far."""
        if self._begun is None:
            return Status.FAILURE
        try:
            state = self._rover.follow_skill(self._begun)
        except LrmError as lost:
            self.outcome, self.feedback_message = "stopped", str(lost)
            return Status.FAILURE
        self.outcome, self.feedback_message = state.outcome, state.text or state.step
        if state.outcome == "running":
            return Status.RUNNING
        return Status.SUCCESS if state.outcome == "reached" else Status.FAILURE

    def terminate(self, new_status: Status) -> None:
        """Holds the arm where the tree interrupts a skill that is under way."""
        if new_status is Status.INVALID and self.outcome == "running":
            self._rover.hold()
            self.outcome = "stopped"


def sequence(rover: Rover, name: str, steps: Iterable[tuple[SkillName, Mapping[str, Any]]]) -> Sequence:
    """Skills one after the other, as far as each reaches its end."""
    return Sequence(name, memory=True, children=[SkillBehaviour(rover, skill, **fields) for skill, fields in steps])
