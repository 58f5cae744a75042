"""Messages of skills: sequences of motions that the daemon carries out for a state machine, and what is sensed by the
way."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from lrmd.messages.codec import Header, Message
from lrmd.messages.control import LoadCentre, MotionRequest
from lrmd.messages.kinematics import GoalEntry, JointAngle, JointAngles, Payload
from lrmd.messages.surroundings import ContactEntry

SkillName = Literal["approach", "touch_down", "grasp", "retreat", "carry", "drop", "stow"]
Outcome = Literal["none", "running", "reached", "touched_early", "nothing_there", "refused", "stopped", "replaced"]
NEEDED: dict[str, tuple[str, ...]] = {
    "approach": ("goal", "height_m"),
    "touch_down": ("goal",),
    "grasp": ("gripper_rad", "payload_kg"),
    "retreat": ("height_m",),
    "carry": ("goal",),
    "drop": ("gripper_rad",),
    "stow": ("q_rad",),
}
"""Fields that a skill needs."""
ALLOWED: dict[str, tuple[str, ...]] = {
    "approach": ("gripper_rad", "may_touch"),
    "touch_down": ("may_touch",),
    "grasp": ("payload_centre_m", "listen_s"),
    "retreat": ("may_touch",),
    "carry": ("near_rad",),
}
"""Fields that a skill may have beside these."""
CHOSEN = (
    "goal", "height_m", "q_rad", "near_rad", "gripper_rad", "payload_kg", "payload_centre_m", "may_touch", "listen_s",
)  # fmt: skip
"""Fields that only some skills have."""


class SkillRequest(MotionRequest):
    """`rpc/skill`: a sequence of motions, each checked and permitted like one of `rpc/move`.

    `goal`: where the tool grasps, or lets go; `height_m`: along the frame's z axis, above it or from where the tool is;
    `q_rad`: pose to stow in; `near_rad`: branches near it come first; `gripper_rad`: where the gripper turns to, before
    an approach; `payload_kg`, `payload_centre_m`: what it grasps, as in `PayloadRequest`; `may_touch`: contacts of the
    straight line down or up; `listen_s`: how long after closing somebody may say that nothing is there.
    """

    skill: SkillName
    goal: GoalEntry | None = None
    height_m: Annotated[float, Field(gt=0, le=1)] | None = None
    q_rad: JointAngles | None = None
    near_rad: JointAngles | None = None
    gripper_rad: JointAngle | None = None
    payload_kg: Payload | None = None
    payload_centre_m: LoadCentre | None = None
    may_touch: Annotated[list[ContactEntry], Field(max_length=8)] = []
    listen_s: Annotated[float, Field(ge=0, le=10)] = 0.0
    speed: Annotated[float, Field(gt=0, le=1)] = 1.0

    @model_validator(mode="after")
    def _fields_of_the_skill(self) -> Self:
        needed = NEEDED[self.skill]
        allowed = (*needed, *ALLOWED.get(self.skill, ()))
        wrong = [f"{name} is missing" for name in needed if getattr(self, name) is None]
        given = [name for name in CHOSEN if getattr(self, name) not in (None, [], 0.0)]
        wrong += [f"{name} is none of them" for name in given if name not in allowed]
        if wrong:
            raise ValueError(f"{self.skill} has the fields {', '.join(allowed)}; {wrong[0]}")
        return self


class SenseCommand(Message):
    """`cmd/sense`: what somebody senses, since servos give no feedback. Needs no lease; it can only end a skill.

    "touch": the tool touches something; an approach or touch down stops. "empty": nothing is between the fingers.
    """

    what: Literal["touch", "empty"]


class SkillState(Header):
    """`state/skill`, when it changes and every second: the last skill that was begun.

    `number`: as in the reply to `rpc/skill`, 0 before the first; `step`: what it does, or did last; `stops`: as in
    `state/mode`.
    """

    number: int
    skill: str
    outcome: Outcome
    step: str
    text: str
    stops: int


REQUESTS: dict[str, type[Message]] = {"rpc/skill": SkillRequest}
COMMANDS: dict[str, type[Message]] = {"cmd/sense": SenseCommand}
