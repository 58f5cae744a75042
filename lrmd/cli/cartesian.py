"""The commands of `lrm` that know where the tool is: places to commands and back, and ways there."""

from __future__ import annotations

import argparse

from lrm_math.errors import LrmError
from lrmd.cli import text
from lrmd.cli.angles import angles_of
from lrmd.cli.motion import through
from lrmd.cli.parsing import joints, numbers, rover_of, three
from lrmd.client.rover import Rover
from lrmd.messages.kinematics import FkRequest, GoalEntry, IkAnswer, IkRequest, PlanRequest


def ik(o: argparse.Namespace) -> int:
    """`lrm ik`."""
    with rover_of(o) as rover:
        print(text.answer_text(_asked(o, rover), rover.info().names))
    return 0


def _asked(o: argparse.Namespace, rover: Rover) -> IkAnswer:
    """The answer to the goal of the command line. Raises `LrmError` if it cannot be taken."""
    goal = GoalEntry(
        position_m=[v / 1000 for v in (o.x, o.y, o.z)],
        rpy_rad=three("--rpy", angles_of(o.rpy)) if o.rpy else None,
        approach=three("--approach", numbers("--approach", o.approach)) if o.approach else None,
    )
    request = IkRequest(
        goals=[goal], near_rad=rover.standing(), method=o.method, round=o.round, payload_kg=o.payload_g / 1000,
        deadline_ms=5000.0,
    )  # fmt: skip
    answer = rover.ik(request).answers[0]
    if answer.q_rad is None:
        raise LrmError(f"{answer.verdict}: {answer.text}")
    return answer


def goto(o: argparse.Namespace) -> int:
    """`lrm goto`."""
    with rover_of(o) as rover:
        answer = _asked(o, rover)
        print(text.answer_text(answer, rover.info().names))
        waypoints = _way(rover, answer.rounded_q_rad or answer.q_rad or [], o.payload_g / 1000, 0)
        return through(o, rover, waypoints, o.payload_g / 1000)


def plan(o: argparse.Namespace) -> int:
    """`lrm plan`."""
    with rover_of(o) as rover:
        waypoints = _way(rover, list(joints(rover, o.q).values()), 0.0, o.seed)
        return through(o, rover, waypoints) if o.go else 0


def _way(rover: Rover, q: list[float], payload: float, seed: int) -> list[dict[str, float]]:
    """Plans a way to joint angles (rad) and prints it. Raises `LrmError` if there is none."""
    reply = rover.plan(PlanRequest(from_rad=rover.standing(), to_rad=q, payload_kg=payload, seed=seed))
    if not reply.found:
        raise LrmError(reply.text)
    print(text.way_text(reply.waypoints_rad))
    names = rover.info().names
    return [dict(zip(names, waypoint, strict=False)) for waypoint in reply.waypoints_rad[1:]]


def fk(o: argparse.Namespace) -> int:
    """`lrm fk`."""
    with rover_of(o) as rover:
        q = list(joints(rover, o.q).values()) if o.q else rover.standing()
        place = rover.fk(FkRequest(q_rad=[q], payload_kg=o.payload_g / 1000)).places[0]
        print(text.place_text(place))
    return 0
