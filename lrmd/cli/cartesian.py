"""The Cartesian commands of `lrm`: inverse and forward kinematics, path planning, and motion to a TCP goal."""

from __future__ import annotations

import argparse

from lrm_math.errors import LrmError
from lrm_math.number_list import parse_numbers
from lrmd.cli import text
from lrmd.cli.motion import run_motion
from lrmd.cli.parsing import joint_angles, open_rover, parse_angles, payload_kg
from lrmd.client import Rover
from lrmd.messages.kinematics import FkRequest, GoalEntry, IkAnswer, IkRequest, PlanRequest


def ik(o: argparse.Namespace) -> int:
    """`lrm ik`: prints the commanded angles for a TCP goal."""
    with open_rover(o) as rover:
        print(text.ik_text(_solve_goal(o, rover), rover.info().names))
    return 0


def _solve_goal(o: argparse.Namespace, rover: Rover) -> IkAnswer:
    """Solves the inverse kinematics of the goal in the options. Raises `LrmError` without a solution."""
    goal = GoalEntry(
        position_m=[v / 1000 for v in (o.x, o.y, o.z)],
        rpy_rad=_three_angles(o.rpy) if o.rpy else None,
        approach=parse_numbers("--approach", o.approach, "three numbers by commas", 3) if o.approach else None,
    )
    request = IkRequest(
        goals=[goal], near_rad=rover.commanded_q(), method=o.method, round=o.round, payload_kg=payload_kg(o),
        deadline_ms=5000.0,
    )  # fmt: skip
    answer = rover.ik(request).answers[0]
    if answer.q_rad is None:
        raise LrmError(f"{answer.verdict}: {answer.text}")
    return answer


def _three_angles(text: str) -> list[float]:
    angles = parse_angles(text)
    if len(angles) != 3:
        raise LrmError(f"--rpy has {len(angles)} numbers; should be three with commas between them")
    return angles


def goto(o: argparse.Namespace) -> int:
    """`lrm goto`: solves, plans and moves."""
    with open_rover(o) as rover:
        answer = _solve_goal(o, rover)
        print(text.ik_text(answer, rover.info().names))
        waypoints = _plan_path(rover, answer.rounded_q_rad or answer.q_rad or [], payload_kg(o), 0)
        return run_motion(o, rover, waypoints, payload_kg(o))


def plan(o: argparse.Namespace) -> int:
    """`lrm plan`: plans a path to joint angles, and moves with `--go`."""
    with open_rover(o) as rover:
        waypoints = _plan_path(rover, list(joint_angles(rover, o.q).values()), None, o.seed)
        return run_motion(o, rover, waypoints) if o.go else 0


def _plan_path(rover: Rover, q: list[float], payload: float | None, seed: int) -> list[dict[str, float]]:
    """Plans a path to joint angles (rad), prints it and returns its waypoints. Raises `LrmError` if there is none."""
    reply = rover.plan(PlanRequest(from_rad=rover.commanded_q(), to_rad=q, payload_kg=payload, seed=seed))
    if not reply.found:
        raise LrmError(reply.text)
    print(text.path_text(reply.waypoints_rad))
    names = rover.info().names
    return [dict(zip(names, waypoint, strict=False)) for waypoint in reply.waypoints_rad[1:]]


def fk(o: argparse.Namespace) -> int:
    """`lrm fk`: prints the TCP pose of joint angles."""
    with open_rover(o) as rover:
        q = list(joint_angles(rover, o.q).values()) if o.q else rover.commanded_q()
        print(text.tcp_text(rover.fk(FkRequest(q_rad=[q], payload_kg=payload_kg(o))).places[0]))
    return 0
