"""The commands of `lrm` that switch servos on and off, move them or the tool, or ask where that would lead."""

from __future__ import annotations

import argparse
import getpass
import math
import sys
from collections.abc import Iterator, Mapping, Sequence

from lrm_math.errors import LrmError
from lrm_math.number_list import parse_numbers
from lrmd.cli import text
from lrmd.cli.parsing import joint_angles, lease_holder, open_rover, parse_angles, payload_kg, place_m, servo_angles
from lrmd.client import RequestRefused, Rover
from lrmd.messages.control import JointsState
from lrmd.messages.kinematics import FkRequest, GoalEntry, IkAnswer, IkRequest, PlanReply, PlanRequest

ELSEWHERE = math.radians(1.0)


def arm(o: argparse.Namespace) -> int:
    """`lrm arm`: switches servos on."""
    with open_rover(o) as rover, rover.control(lease_holder(), o.take):
        before, given = rover.joints(), dict[str, float]()
        try:
            if o.q or o.at:
                given = joint_angles(rover, o.q) if o.q else servo_angles(rover, o.at)
                rover.arm("given", given, o.servo)
            else:
                rover.arm("stored" if o.stored else "board", servos=o.servo)
        except RequestRefused as error:
            if error.code != "pose_needed":
                raise
            raise LrmError(f"{error}{_stored_hint(error.detail)}") from None
        on = [n for n, is_on in zip(rover.joints().names, rover.joints().on, strict=True) if is_on]
        print(f"armed: {', '.join(on)}")
        for line in _not_used(before, given):
            print(line)
    return 0


def _not_used(before: JointsState, given: Mapping[str, float]) -> Iterator[str]:
    """A line for each angle (rad) that was given of a servo which had pulses already, and stood at another."""
    for name, was_on, q in zip(before.names, before.on, before.q_rad, strict=True):
        if was_on and name in given and abs(given[name] - q) > ELSEWHERE:
            yield f"{name} had pulses already, for {math.degrees(q):.1f} deg: it stays there"


def _stored_hint(detail: Mapping[str, object]) -> str:
    if "stored_rad" not in detail:
        return ""
    stored = detail["stored_rad"]
    if not isinstance(stored, dict) or not stored:
        return " (no pose is stored)"
    pose = ", ".join(f"{n} {math.degrees(q):.1f}" for n, q in stored.items())
    return f". Stored (deg): {pose}" + ("" if detail.get("stored_still") else "; but it moved then, or fell")


def move(o: argparse.Namespace) -> int:
    """`lrm move`: moves servos by name or number."""
    if not (o.q or o.joint or o.servo):
        raise LrmError("move: nothing to move; give --joint N ANGLE, --servo NAME ANGLE or --q")
    with open_rover(o) as rover:
        joints = joint_angles(rover, o.q) if o.q else {}
        others = servo_angles(rover, [(f"joint{n.removeprefix('joint')}", a) for n, a in o.joint] + o.servo)
        for name in (name for name in others if name in joints):
            raise LrmError(f"{name} is given twice, in --q too: which angle is meant?")
        return run_motion(o, rover, [joints | others], payload_kg(o))


def gripper(o: argparse.Namespace) -> int:
    """`lrm gripper`: moves the gripper."""
    with open_rover(o) as rover:
        return run_motion(o, rover, [servo_angles(rover, [("gripper", o.angle)])])


def pan_tilt(o: argparse.Namespace) -> int:
    """`lrm pan-tilt`: moves the camera."""
    with open_rover(o) as rover:
        return run_motion(o, rover, [servo_angles(rover, [("pan", o.pan), ("tilt", o.tilt)])])


def run_motion(
    o: argparse.Namespace, rover: Rover, waypoints: Sequence[Mapping[str, float]], payload: float | None = None,
    stops: int | None = None,
) -> int:  # fmt: skip
    """Moves through `waypoints` (rad) with the motion options and waits; Ctrl-C holds. Returns the exit code.

    `stops`: of the mode when the person asked, if that was before now: a stop since then stops this, too.
    """
    if not 0 < o.speed <= 1:
        raise LrmError(f"--speed {o.speed:g}: should be more than 0, at most 1")
    with rover.control(lease_holder(), o.take):
        try:
            seconds = rover.move(
                *waypoints, pace="each" if o.each else "together", speed=o.speed, payload_kg=payload, stops=stops
            )
        except KeyboardInterrupt:
            rover.hold()
            print("held", file=sys.stderr)
            return 1
    unchecked = f"; not checked for collisions: {rover.unchecked}" if rover.unchecked else ""
    print(f"there, after {seconds:.1f} s{unchecked}")
    return 0


def hold(o: argparse.Namespace) -> int:
    """`lrm hold`: stops the motion, pulses on."""
    with open_rover(o) as rover:
        rover.hold()
    print("holding")
    return 0


def relax(o: argparse.Namespace) -> int:
    """`lrm relax`: switches servos off."""
    with open_rover(o) as rover, rover.control(lease_holder(), o.take):
        rover.relax(o.servo or None)
    print("relaxed")
    return 0


def disarm(o: argparse.Namespace) -> int:
    """`lrm disarm`: switches all servos off."""
    with open_rover(o) as rover, rover.control(lease_holder(), o.take):
        rover.disarm()
    print("disarmed")
    return 0


def reset(o: argparse.Namespace) -> int:
    """`lrm reset`: leaves fault or estop."""
    with open_rover(o) as rover, rover.control(lease_holder(), o.take):
        rover.reset_fault()
        print(rover.mode().mode)
    return 0


def estop(o: argparse.Namespace) -> int:
    """`lrm estop`: emergency stop."""
    with open_rover(o) as rover:
        rover.estop(o.why or f"lrm estop ({getpass.getuser()})")
    print("stopped: the pulses are off")
    return 0


def level1(o: argparse.Namespace) -> int:
    """`lrm level1`: servo calibration with a protractor, or the board's clock."""
    from lrmd.cli.clock_calibration import calibrate_clock
    from lrmd.cli.servo_calibration import calibrate_servo

    if o.clock == bool(o.arm or o.output):
        raise LrmError("level1: give --arm ARM and -o FILE, or --clock alone")
    if o.clock:
        with open_rover(o) as rover, rover.control(lease_holder(), o.take):
            calibrate_clock(rover, o.servo)
        return 0
    if not (o.arm and o.output):
        raise LrmError(f"level1: {'-o FILE' if o.arm else '--arm ARM'} is missing")
    with open_rover(o) as rover, rover.control(lease_holder(), o.take):
        calibrate_servo(rover, o.servo, o.arm, o.output, parse_angles(o.angles))
    return 0


def ik(o: argparse.Namespace) -> int:
    """`lrm ik`: prints the commanded angles for a TCP goal."""
    with open_rover(o) as rover:
        print(text.ik_text(_solve_goal(o, rover), rover.info().names))
    return 0


def _solve_goal(o: argparse.Namespace, rover: Rover) -> IkAnswer:
    """Solves the inverse kinematics of the goal in the options. Raises `LrmError` without a solution."""
    request = IkRequest(
        goals=[_goal(o)], near_rad=rover.commanded_q(), method=o.method, round=o.round, payload_kg=payload_kg(o),
        deadline_ms=5000.0,
    )  # fmt: skip
    answer = rover.ik(request).answers[0]
    if answer.q_rad is None:
        raise LrmError(f"{answer.verdict}: {answer.text}")
    return answer


def _goal(o: argparse.Namespace) -> GoalEntry:
    """The goal in the options."""
    return GoalEntry(
        position_m=place_m("X Y Z", (o.x, o.y, o.z)),
        rpy_rad=three_angles(o.rpy) if o.rpy else None,
        approach=parse_numbers("--approach", o.approach, "three numbers by commas", 3) if o.approach else None,
    )


def three_angles(text: str) -> list[float]:
    """Three angles (rad) of a text. Raises `LrmError`."""
    angles = parse_angles(text)
    if len(angles) != 3:
        raise LrmError(f"--rpy has {len(angles)} numbers; should be three with commas between them")
    return angles


def goto(o: argparse.Namespace) -> int:
    """`lrm goto`: solves, plans and moves."""
    with open_rover(o) as rover:
        stops = rover.mode().stops
        if o.line:
            return run_motion(o, rover, _plan_line(o, rover), payload_kg(o), stops)
        answer = _solve_goal(o, rover)
        print(text.ik_text(answer, rover.info().names))
        waypoints = _plan_path(rover, answer.rounded_q_rad or answer.q_rad or [], payload_kg(o), 0)
        return run_motion(o, rover, waypoints, payload_kg(o), stops)


def plan(o: argparse.Namespace) -> int:
    """`lrm plan`: plans a path to joint angles, and moves with `--go`."""
    with open_rover(o) as rover:
        stops = rover.mode().stops
        waypoints = _plan_path(rover, list(joint_angles(rover, o.q).values()), None, o.seed)
        return run_motion(o, rover, waypoints, stops=stops) if o.go else 0


def _plan_path(rover: Rover, q: list[float], payload: float | None, seed: int) -> list[dict[str, float]]:
    """Plans a path to joint angles (rad), prints it and returns its waypoints. Raises `LrmError` if there is none."""
    return _waypoints(
        rover, rover.plan(PlanRequest(from_rad=rover.commanded_q(), to_rad=q, payload_kg=payload, seed=seed))
    )


def _plan_line(o: argparse.Namespace, rover: Rover) -> list[dict[str, float]]:
    """The same of a straight line of the tip to the goal in the options."""
    request = PlanRequest(from_rad=rover.commanded_q(), goal=_goal(o), payload_kg=payload_kg(o), line=True)
    return _waypoints(rover, rover.plan(request))


def _waypoints(rover: Rover, reply: PlanReply) -> list[dict[str, float]]:
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
