"""Skills that a state machine calls to fetch a stone: approach, touch down, grasp, retreat, carry, drop, stow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from examples.fetch.places import HOME, Stone, above, areas, basket_pose, quaternion
from examples.fetch.world import FetchWorld
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrmd.messages.kinematics import GoalEntry, IkRequest, PlanRequest
from lrmd.messages.surroundings import ContactEntry

GRASP = 0.008
"""m: a stone that is further from the tip than this is not between the fingers."""
OPEN, CLOSED = 0.6, -0.2
"""rad, of the gripper."""


@dataclass(frozen=True)
class Fetched:
    """Outcome for a stone, in words, and how far the tip missed the place of its grasp (m); None: never there."""

    what: str
    missed: float | None = None

    @property
    def in_basket(self) -> bool:
        """Whether the stone is where it should be."""
        return self.what == "in the basket"


class Refused(LrmError):
    """A skill that cannot be carried out, and why."""


def fetch(world: FetchWorld, stone: Stone) -> Fetched:
    """Brings a stone into the basket."""
    missed = None
    try:
        approach(world, stone)
        touch_down(world, stone)
        missed = float(np.linalg.norm(world.tip() - stone.place))
        if missed > GRASP:
            retreat(world, stone)
            return Fetched("nothing between the fingers", missed)
        grasp(world, stone)
        retreat(world, stone)
        carry(world)
        return Fetched("in the basket" if drop(world) else "beside the basket", missed)
    except LrmError as error:
        return Fetched(f"refused: {error}", missed)
    finally:
        world.load(0.0)
        world.rover.carry(0.0)


def approach(world: FetchWorld, stone: Stone) -> None:
    """To a place above the stone, in a pose from which a straight line leads down to it. Raises `LrmError`."""
    stow(world)
    world.rover.move({"gripper": OPEN})
    here = world.rover.commanded_q()
    hover = entry(above(stone.place), stone.tilt)
    answer = world.rover.ik(IkRequest(goals=[hover], near_rad=here, deadline_ms=5000.0)).answers[0]
    if answer.q_rad is None:
        raise Refused(f"approach: {answer.text}")
    reasons = []
    for q in answer.branches_rad:
        down = PlanRequest(from_rad=q, goal=entry(stone.place, stone.tilt), line=True, may_touch=stone.contacts())
        line = world.rover.plan(down)
        if not line.found:
            reasons.append(f"approach: {line.text}")
            continue
        go(world, q)
        return
    raise Refused(reasons[0])


def touch_down(world: FetchWorld, stone: Stone) -> None:
    """Straight down to where it is grasped; fingers may touch the ground there. Raises `LrmError`."""
    straight(world, stone.place, stone.tilt, stone.contacts())


def grasp(world: FetchWorld, stone: Stone) -> None:
    """Closes the gripper, which from then on carries the stone. Raises `LrmError`."""
    world.rover.move({"gripper": CLOSED})
    world.load(stone.mass)
    world.rover.carry(stone.mass)


def retreat(world: FetchWorld, stone: Stone) -> None:
    """Straight up again. Raises `LrmError`."""
    straight(world, above(stone.place), stone.tilt, stone.contacts())


def carry(world: FetchWorld) -> None:
    """To a place above the basket. Raises `LrmError`."""
    stow(world)
    middle, direction, near = basket_pose()
    goal = GoalEntry(position_m=middle.tolist(), approach=direction.tolist())
    answer = world.rover.ik(IkRequest(goals=[goal], near_rad=near.tolist(), deadline_ms=5000.0)).answers[0]
    if answer.q_rad is None:
        raise Refused(f"carry: {answer.text}")
    go(world, answer.q_rad)


def stow(world: FetchWorld) -> None:
    """To where the arm has room on all sides. Raises `LrmError`."""
    go(world, list(HOME))


def drop(world: FetchWorld) -> bool:
    """Opens the gripper; whether the stone falls into the basket."""
    tip, basket = world.tip(), areas()["basket"]
    world.rover.move({"gripper": OPEN})
    return bool((np.array(basket.low[:2]) < tip[:2]).all() and (tip[:2] < np.array(basket.high[:2])).all())


def go(world: FetchWorld, q: list[float]) -> None:
    """Round what is between to commands (rad). Raises `LrmError`."""
    way = world.rover.plan(PlanRequest(from_rad=world.rover.commanded_q(), to_rad=q, deadline_ms=30_000.0))
    if not way.found:
        raise Refused(way.text)
    move(world, way.waypoints_rad)


def straight(world: FetchWorld, place: Array, tilt: Array, contacts: list[ContactEntry]) -> None:
    """Along a straight line to a place (m). Raises `LrmError`."""
    here = world.rover.commanded_q()
    line = world.rover.plan(PlanRequest(from_rad=here, goal=entry(place, tilt), line=True, may_touch=contacts))
    if not line.found:
        raise Refused(line.text)
    move(world, line.waypoints_rad, contacts)


def move(world: FetchWorld, path: Sequence[Sequence[float]], contacts: Sequence[ContactEntry] = ()) -> None:
    """Through commands (rad), but the first. Raises `LrmError`."""
    names = world.rover.info().names
    world.rover.move(*(dict(zip(names, q, strict=False)) for q in path[1:]), may_touch=contacts)


def entry(place: Array, tilt: Array) -> GoalEntry:
    """The goal of a tool at a place (m), with a rotation (3, 3)."""
    return GoalEntry(position_m=[float(x) for x in place], quaternion_xyzw=quaternion(tilt))
