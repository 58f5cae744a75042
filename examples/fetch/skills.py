"""A stone into the basket by the daemon's skills: approach, touch down, grasp, retreat, stow, carry, drop, stow."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from examples.fetch.places import HOME, HOVER, Stone, areas, basket_pose, quaternion
from examples.fetch.world import FetchWorld
from lrm_math.errors import LrmError
from lrmd.client import RequestRefused
from lrmd.messages.control import LEASE_LOST
from lrmd.messages.kinematics import GoalEntry
from lrmd.messages.skills import SkillName, SkillState

GRASP = 0.008
"""m: a stone that is further from the tip than this is not between the fingers."""
OPEN, CLOSED = 0.6, -0.2
"""rad, of the gripper."""
TRIES, PAUSE_S = 5, 1.0
BUSY = (LEASE_LOST, "no sign of life of the daemon")
"""Ends of a skill on a computer that is too busy to keep the lease, or the ramp, alive: the arm holds."""
LISTEN_S = 0.5
"""s after closing in which the switch in the fingers says whether something is there."""


@dataclass(frozen=True)
class Fetched:
    """Outcome for a stone, in words, and where the tip was when the gripper closed (3,), m; None: never there."""

    what: str
    tip: list[float] | None = None
    missed: float | None = None

    @property
    def in_basket(self) -> bool:
        """Whether the stone is where it should be."""
        return self.what == "in the basket"


class SkillEnded(LrmError):
    """A skill that did not reach what it should; carries its `outcome`."""

    def __init__(self, state: SkillState) -> None:
        self.outcome = state.outcome
        super().__init__(f"{state.skill}: {state.outcome}: {state.text}")


def fetch(world: FetchWorld, stone: Stone) -> Fetched:
    """Brings a stone into the basket."""
    there, goal = world.under(stone), goal_of(stone)
    contacts, tip, missed = stone.contacts(), None, None
    try:
        do(there, "stow", q_rad=list(HOME))
        do(there, "approach", goal=goal, height_m=HOVER, gripper_rad=OPEN, may_touch=contacts)
        with there.touching(stone):
            down = tried(there, "touch_down", goal=goal, may_touch=contacts)
            tip = there.tip()
            missed = float(np.linalg.norm(tip - stone.place))
            if down.outcome not in ("reached", "touched_early"):
                raise SkillEnded(down)
            closed = grasp(there, stone.mass, missed < GRASP)
            do(there, "retreat", height_m=HOVER, may_touch=contacts)
        if closed.outcome != "reached":
            return Fetched(f"{down.outcome}, {closed.outcome}", tip.tolist(), missed)
        do(there, "stow", q_rad=list(HOME))
        middle, direction, near = basket_pose()
        above = GoalEntry(position_m=middle.tolist(), approach=direction.tolist())
        do(there, "carry", goal=above, near_rad=near.tolist())
        return Fetched("in the basket" if drop(there) else "beside the basket", tip.tolist(), missed)
    except LrmError as error:
        return Fetched(f"refused: {error}", None if tip is None else tip.tolist(), missed)
    finally:
        there.put_down()


def do(world: FetchWorld, name: SkillName, **fields: Any) -> None:
    """Carries out a skill. Raises `SkillEnded` if it does not reach its end, `LrmError`."""
    state = tried(world, name, **fields)
    if state.outcome != "reached":
        raise SkillEnded(state)


def tried(world: FetchWorld, name: SkillName, **fields: Any) -> SkillState:
    """Carries out a skill, and asks for it again where only a busy computer ended it, not a person. Raises
    `LrmError`."""
    for _ in range(TRIES - 1):
        try:
            state = world.rover.skill(name, **fields)
        except RequestRefused as refused:
            if refused.code != "lease":
                raise
        else:
            world.note(f"{name}: {state.outcome}: {state.text}")
            if not any(words in state.text for words in BUSY):
                return state
        world.again.append(name)
        time.sleep(PAUSE_S)
    return world.rover.skill(name, **fields)


def grasp(world: FetchWorld, mass: float, between: bool) -> SkillState:
    """Closes the gripper on a stone (kg) that is `between` the fingers, or on nothing; the switch there tells."""
    closing = world.rover.skill("grasp", gripper_rad=CLOSED, payload_kg=mass, listen_s=LISTEN_S, wait=False)
    if not between:
        world.rover.tell_sensed("empty")
    closed = world.rover.await_skill(closing)
    if closed.outcome == "reached":
        world.load(mass)
    return closed


def drop(world: FetchWorld) -> bool:
    """Opens the gripper; whether the stone falls into the basket."""
    tip, basket = world.tip(), areas()["basket"]
    do(world, "drop", gripper_rad=OPEN)
    return bool((np.array(basket.low[:2]) < tip[:2]).all() and (tip[:2] < np.array(basket.high[:2])).all())


def goal_of(stone: Stone) -> GoalEntry:
    """Where the tool grasps a stone."""
    return GoalEntry(position_m=[float(x) for x in stone.place], quaternion_xyzw=quaternion(stone.tilt))
