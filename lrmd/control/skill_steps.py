"""Skills as sequences of steps: what each asks of the kinematics, and which motions it makes of the answers.

Sans-io: a skill is a generator. It yields a question, a motion, a load or a pause, gets the answer to a question, and
returns what it did in words. Who runs it (`skill_run`) may end it after any step.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

from lrm_math.arrays import ORIGIN
from lrm_math.errors import LrmError
from lrmd.messages.kinematics import FkReply, FkRequest, GoalEntry, IkReply, IkRequest, PlanReply, PlanRequest
from lrmd.messages.skills import SkillRequest
from lrmd.messages.surroundings import ContactEntry

PLAN_MS, SOLVE_MS = 30_000.0, 5000.0
"""Time limits of a plan round what is between, and of an inverse."""


class SkillRefused(LrmError):
    """A skill that cannot be carried on, and why."""


@dataclass(frozen=True)
class SkillMotion:
    """A motion: `waypoints` (rad) by numbers of servos from 0; `sensed_by_touch`: a touch ends the skill."""

    step: str
    waypoints: tuple[dict[int, float], ...]
    may_touch: tuple[ContactEntry, ...] = ()
    sensed_by_touch: bool = False


@dataclass(frozen=True)
class SkillLoad:
    """What the gripper carries from now on (kg), and its centre (m), see `PayloadRequest`."""

    payload_kg: float
    payload_centre_m: Sequence[float] = ORIGIN


@dataclass(frozen=True)
class SensingPause:
    """A pause in which somebody may say that nothing is between the fingers."""

    seconds: float


Question: TypeAlias = IkRequest | FkRequest | PlanRequest
Step: TypeAlias = Question | SkillMotion | SkillLoad | SensingPause
Steps: TypeAlias = Generator[Step, Any, str]


@dataclass(frozen=True)
class SkillContext:
    """What a skill knows of the arm: commanded angles (rad) of the joints `here`, number of the `gripper`'s servo."""

    here: Callable[[], list[float]]
    gripper: int | None

    def gripping(self, step: str, angle: float | None) -> SkillMotion:
        """The gripper's motion to an angle (rad). Raises `SkillRefused`."""
        if self.gripper is None or angle is None:
            raise SkillRefused("the arm has no servo named gripper")
        return SkillMotion(step, ({self.gripper: angle},))


def approach(r: SkillRequest, arm: SkillContext) -> Steps:
    """To a place above the goal, in a pose from which a straight line leads down to it."""
    assert r.goal is not None
    assert r.height_m is not None
    if r.gripper_rad is not None:
        yield arm.gripping("opening the gripper", r.gripper_rad)
    reasons = []
    for q in (yield from _branches(raised(r.goal, r.height_m), arm.here())):
        line: PlanReply = yield PlanRequest(from_rad=q, goal=r.goal, line=True, may_touch=r.may_touch)
        if line.found:
            yield from _go(q, arm, "going above the goal", sensed_by_touch=True)
            return "above the goal"
        reasons.append(line.text)
    raise SkillRefused(f"no straight line leads down from above the goal: {reasons[0]}")


def touch_down(r: SkillRequest, arm: SkillContext) -> Steps:
    """Straight down to the goal."""
    assert r.goal is not None
    yield from _straight(r.goal, r.may_touch, arm, "going straight down", sensed_by_touch=True)
    return "at the goal"


def grasp(r: SkillRequest, arm: SkillContext) -> Steps:
    """Closes the gripper, which then carries the load."""
    assert r.payload_kg is not None
    yield arm.gripping("closing the gripper", r.gripper_rad)
    yield SensingPause(r.listen_s)
    yield SkillLoad(r.payload_kg, r.payload_centre_m or ORIGIN)
    return f"carries {r.payload_kg * 1e3:.0f} g"


def retreat(r: SkillRequest, arm: SkillContext) -> Steps:
    """Straight up from where the tool is."""
    assert r.height_m is not None
    there: FkReply = yield FkRequest(q_rad=[arm.here()])
    goal = raised(GoalEntry(position_m=there.places[0].tcp_m), r.height_m)
    yield from _straight(goal, r.may_touch, arm, "going straight up")
    return f"{r.height_m * 1e3:.0f} mm above"


def carry(r: SkillRequest, arm: SkillContext) -> Steps:
    """Round what is between to where it lets go."""
    assert r.goal is not None
    branches = yield from _branches(r.goal, r.near_rad or arm.here())
    yield from _go(branches[0], arm, "carrying")
    return "where it is to be dropped"


def drop(r: SkillRequest, arm: SkillContext) -> Steps:
    """Opens the gripper, which then carries nothing."""
    yield arm.gripping("opening the gripper", r.gripper_rad)
    yield SkillLoad(0.0)
    return "carries nothing"


def stow(r: SkillRequest, arm: SkillContext) -> Steps:
    """Round what is between to a pose."""
    assert r.q_rad is not None
    yield from _go(r.q_rad, arm, "stowing")
    return "stowed"


SKILLS: dict[str, Callable[[SkillRequest, SkillContext], Steps]] = {
    "approach": approach, "touch_down": touch_down, "grasp": grasp, "retreat": retreat, "carry": carry, "drop": drop,
    "stow": stow,
}  # fmt: skip


def raised(goal: GoalEntry, height: float) -> GoalEntry:
    """A goal that is higher by so much (m)."""
    x, y, z = goal.position_m
    return goal.model_copy(update={"position_m": [x, y, z + height]})


def _branches(goal: GoalEntry, near: list[float]) -> Generator[Step, Any, list[list[float]]]:
    """Commands (rad) that reach a goal, nearest first. Raises `SkillRefused` if there are none."""
    reply: IkReply = yield IkRequest(goals=[goal], near_rad=near, deadline_ms=SOLVE_MS)
    answer = reply.answers[0]
    if answer.q_rad is None:
        raise SkillRefused(answer.text)
    return answer.branches_rad or [answer.q_rad]


def _go(q: list[float], arm: SkillContext, step: str, sensed_by_touch: bool = False) -> Generator[Step, Any, None]:
    """Round what is between to commands (rad)."""
    plan: PlanReply = yield PlanRequest(from_rad=arm.here(), to_rad=q, deadline_ms=PLAN_MS)
    yield _motion(plan, step, (), sensed_by_touch)


def _straight(
    goal: GoalEntry, may_touch: Sequence[ContactEntry], arm: SkillContext, step: str, sensed_by_touch: bool = False
) -> Generator[Step, Any, None]:
    """Along a straight line of the tip to a goal, with contacts that are permitted."""
    plan: PlanReply = yield PlanRequest(from_rad=arm.here(), goal=goal, line=True, may_touch=list(may_touch))
    yield _motion(plan, step, tuple(may_touch), sensed_by_touch)


def _motion(plan: PlanReply, step: str, may_touch: tuple[ContactEntry, ...], sensed_by_touch: bool) -> SkillMotion:
    """The motion of a plan. Raises `SkillRefused` if none was found."""
    if not plan.found:
        raise SkillRefused(plan.text)
    waypoints = tuple(dict(enumerate(q)) for q in plan.waypoints_rad[1:])
    return SkillMotion(step, waypoints, may_touch, sensed_by_touch)
