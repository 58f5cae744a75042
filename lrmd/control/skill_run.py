"""The skill under way: carries out its steps, one after the other, for the client that asked for it.

Theory of operation: a skill moves nothing by itself. Each of its motions is a request of its client: with the client's
lease, and with the number of stops that the client knew of when it asked. So after a hold, an emergency stop, a fault
or the end of the lease the controller refuses it like any other request that was made before, and the skill ends at
once. It also ends where anything else moves the arm. Nothing of an ended skill is ever taken up again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, assert_never

from lrm_math.errors import LrmError
from lrmd.config import MS, SECOND
from lrmd.control import thermal_protection
from lrmd.control.skill_steps import SKILLS, Question, SensingPause, SkillContext, SkillLoad, SkillMotion, Step
from lrmd.control.state import ControllerState, Level
from lrmd.control.state_machine import STATIONARY, Mode, Trigger, next_mode
from lrmd.errors import RequestError
from lrmd.messages.codec import Header, Message, field_named
from lrmd.messages.control import LEASE_LOST, MoveRequest, PayloadRequest
from lrmd.messages.kinematics import FkRequest, IkRequest, PlanRequest
from lrmd.messages.skills import Outcome, SenseCommand, SkillRequest

GRIPPER = "gripper"
EMPTY_HANDED, LOADED = ("approach", "grasp"), ("carry", "drop")
"""Skills that need a gripper that carries nothing, or something."""
QUESTIONS = 10_000
"""More than a skill asks: no two questions have one number."""
PATIENCE = 5 * SECOND
"""ns beyond a question's own deadline until its answer is given up."""
CarryOut = Callable[[Message, int], object]
"""Carries out a request of the skill's client at a time (ns). Raises `LrmError`."""


@dataclass(frozen=True)
class SkillReport:
    """What is known of the last skill; `number`: 0 before the first."""

    number: int = 0
    skill: str = ""
    outcome: Outcome = "none"
    step: str = ""
    text: str = ""


class SkillRun:
    """One skill: its `request` and `report`, the step that it is at, and what ended it.

    `question`: what it waits for the answer to, with its number; None: nothing.
    """

    def __init__(self, s: ControllerState, request: SkillRequest, number: int) -> None:
        config = s.config
        gripper = config.names.index(GRIPPER) if GRIPPER in config.names else None
        arm = SkillContext(lambda: s.angles(s.position)[: config.dof], gripper)
        self.request, self.report = request, SkillReport(number, request.skill, "running")
        self.stops, self.motions = s.stops, s.orders.motions
        self.question: tuple[int, Question] | None = None
        self._steps = SKILLS[request.skill](request, arm)
        self._step: Step | None = None
        self._next_question, self._until, self._moving = QUESTIONS * number, 0, False
        self._empty = False

    @property
    def running(self) -> bool:
        """Whether it is not over."""
        return self.report.outcome == "running"

    def advance(self, s: ControllerState, now: int, carry_out: CarryOut) -> None:
        """Goes on as far as it can."""
        while self.running:
            if ended := self._interrupted(s):
                self._end(s, *ended)
            elif self._step is None:
                self._resume(s, None, now)
            elif not self._done(s, self._step, now, carry_out):
                return

    def answer(self, s: ControllerState, number: int, reply: Header | LrmError, now: int) -> None:
        """Takes the answer to a question; one that it no longer asks is ignored."""
        if self.running and self.question is not None and self.question[0] == number:
            self.question = None
            if isinstance(reply, LrmError):
                self._end(s, "refused", str(reply))
            else:
                self._resume(s, reply, now)

    def sense(self, s: ControllerState, command: SenseCommand, now: int) -> None:
        """Takes what somebody senses."""
        if not self.running:
            return
        self._empty |= command.what == "empty"
        feels = isinstance(self._step, SkillMotion) and self._step.sensed_by_touch and self._moving
        if command.what == "touch" and feels and s.mode is Mode.MOVING and not self._interrupted(s):
            s.hold(now, "something is touched")
            s.held_at = now  # a hot arm waits, as after anybody's hold
            self._end(s, "touched_early", f"something was touched while {self.report.step}; the arm holds there")

    def _interrupted(self, s: ControllerState) -> tuple[Outcome, str] | None:
        """What ends it from outside."""
        if s.stops != self.stops or s.mode not in (*STATIONARY, Mode.MOVING):
            return "stopped", f"the arm was stopped: {s.mode} ({s.why})"
        if not s.leasehold.held or s.leasehold.token != self.request.lease:
            return "stopped", LEASE_LOST
        if s.orders.motions != self.motions:
            return "replaced", f"another motion took its place: {s.why}"
        return None

    def _done(self, s: ControllerState, step: Step, now: int, carry_out: CarryOut) -> bool:
        """Whether it went on, or ended."""
        match step:
            case SkillMotion():
                return self._moved(s, step, now, carry_out)
            case SkillLoad():
                kg, centre = step.payload_kg, list(step.payload_centre_m)
                request = PayloadRequest(lease=self.request.lease, payload_kg=kg, payload_centre_m=centre)
                if self._tried(s, lambda: carry_out(request, now)):
                    self._resume(s, None, now)
                return True
            case SensingPause():
                if self._empty:
                    self._end(s, "nothing_there", "nothing is between the fingers")
                elif now >= self._until:
                    self._resume(s, None, now)
                else:
                    return False
                return True
            case IkRequest() | FkRequest() | PlanRequest():
                if now >= self._until:
                    self._end(s, "refused", "the ik process gave no answer in time")
                return not self.running
        assert_never(step)

    def _moved(self, s: ControllerState, motion: SkillMotion, now: int, carry_out: CarryOut) -> bool:
        if not self._moving:
            if not s.settled:
                return False
            if not motion.waypoints:
                self._resume(s, None, now)
            elif self._tried(s, lambda: carry_out(self._move(s, motion), now)):
                self._moving, self.motions = True, s.orders.motions
            return True
        if s.mode is Mode.MOVING:
            return False
        if s.mode is Mode.ARMED:
            self._resume(s, None, now)
        else:
            self._end(s, "stopped", f"the arm was stopped: {s.mode} ({s.why})")
        return True

    def _move(self, s: ControllerState, motion: SkillMotion) -> MoveRequest:
        """The request of its client for a motion."""
        waypoints = [{s.config.names[i]: q for i, q in waypoint.items()} for waypoint in motion.waypoints]
        with field_named():
            return MoveRequest(
                lease=self.request.lease, stops=self.stops, waypoints=waypoints, speed=self.request.speed,
                may_touch=list(motion.may_touch),
            )  # fmt: skip

    def _tried(self, s: ControllerState, act: Callable[[], object]) -> bool:
        """Whether something was carried out; if not, the skill has ended."""
        try:
            act()
        except LrmError as error:
            self._end(s, "refused", str(error))
            return False
        return True

    def _resume(self, s: ControllerState, answer: Any, now: int) -> None:
        """On to the next step, or to the end."""
        self._moving = False
        try:
            with field_named():
                self._step = self._steps.send(answer)
        except StopIteration as finished:
            self._end(s, "reached", finished.value)
            return
        except LrmError as error:
            self._end(s, "refused", str(error))
            return
        match self._step:
            case SkillMotion(step=words):
                self._say(words)
            case SensingPause(seconds=seconds):
                self._until = now + round(seconds * SECOND)
                self._say("listening")
            case IkRequest() | FkRequest() | PlanRequest() as question:
                self.question = self._next_question, question
                self._next_question += 1
                self._until = now + round(question.deadline_ms * MS) + PATIENCE
                self._say("planning")

    def _say(self, step: str) -> None:
        self.report = replace(self.report, step=step)

    def _end(self, s: ControllerState, outcome: Outcome, text: str) -> None:
        self.question = None
        self._steps.close()
        self.report = replace(self.report, outcome=outcome, text=text)
        number, skill = self.report.number, self.report.skill
        level: Level = "info" if outcome == "reached" else "warning"
        s.emit("skill", level, f"{skill}: {outcome}: {text}", skill=skill, number=number, outcome=outcome)


def begun(s: ControllerState, before: SkillRun | None, request: SkillRequest) -> SkillRun:
    """A skill that begins. Raises `RequestError` if the arm moves, another one is under way, or its load is wrong."""
    next_mode(s.mode, Trigger.MOVE, s.why)
    if before is not None and before.running:
        raise RequestError("busy", f"{before.request.skill} is under way; rpc/hold ends it", retryable=True)
    if s.mode is Mode.MOVING:
        raise RequestError("busy", "the arm moves; a skill begins where it stands", retryable=True)
    thermal_protection.check_motion(s)
    if request.skill in EMPTY_HANDED and s.payload > 0.0:
        raise RequestError("skill", f"{request.skill}: the gripper carries {s.payload * 1e3:.0f} g already")
    if request.skill in LOADED and s.payload == 0.0:
        raise RequestError("skill", f"{request.skill}: the gripper carries nothing; grasp first, or tell rpc/payload")
    return SkillRun(s, request, 1 if before is None else before.report.number + 1)
