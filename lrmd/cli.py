"""`lrm`: the operator's command line."""

from __future__ import annotations

import argparse
import getpass
import math
import re
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

from lrm_math.errors import LrmError, nearest
from lrmd import cli_text
from lrmd.angle import angle_of, angles_of
from lrmd.client import Interrupted, RequestRefused, Rover
from lrmd.ik_messages import FkRequest, GoalEntry, IkAnswer, IkRequest, PlanRequest
from lrmd.messages import Event, field_named

TEXT = """\
Speaks to lrmd, the daemon that owns a robot arm. The usual course:

  lrm state --watch                            look (anybody may, at any time)
  lrm arm --q 0,-60,0,0,0,0                    switch the servos on; the angles are where the arm stands NOW
  lrm move --joint 2 30deg --joint 3 -10deg    move; it ends by itself, Ctrl-C holds
  lrm move --q 0,-60,0,0,0,0                   all joints, ending together
  lrm disarm                                   switch the servos off: the arm falls
  lrm estop                                    the same, at once, whoever is in command

RC servos jump to the first pulse they get, whatever software does. So arming wants to know where the arm stands: --q
says it; --stored says that nobody touched the arm since the daemon left it; --board takes over a board that is still
pulsing. Angles: 30, 30deg or 0.5rad.
"""


def main(argv: list[str] | None = None) -> int:
    """Runs one command. Exit code 0, 1 if a motion did not reach its goal, 2 for anything refused."""
    options = parser().parse_args(argv)
    try:
        run: Callable[[argparse.Namespace], int] = options.run
        with field_named():
            return run(options)
    except Interrupted as error:
        print(f"lrm: {error}", file=sys.stderr)
        return 1
    except LrmError as error:
        print(f"lrm: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 1


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, and takes `-10deg` and `-10,0,20` for angles, not for options."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._negative_number_matcher = re.compile(r"-\.?\d")

    def error(self, message: str) -> NoReturn:
        """Ends the program."""
        self.exit(2, f"lrm: {message}; see {self.prog} --help\n")


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = Parser("lrm", description=TEXT, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--robot", default="rover", help="whose daemon (default: %(default)s)")
    p.add_argument("--connect", metavar="ENDPOINT", help="default: LRM_CONNECT, or tcp/127.0.0.1:7447")
    p.add_argument("--zenoh-config", metavar="FILE", help="password or certificates (default: LRM_ZENOH_CONFIG)")
    p.add_argument("--take", action="store_true", help="take the lease over if somebody else has it")
    commands = p.add_subparsers(title="commands", required=True, metavar="COMMAND")

    def command(name: str, run: Callable[[argparse.Namespace], int], text: str) -> argparse.ArgumentParser:
        sub = commands.add_parser(name, help=text, description=text)
        sub.set_defaults(run=run)
        return sub

    c = command("state", state, "mode, servos, temperatures and faults")
    c.add_argument("--watch", action="store_true", help="again and again, until Ctrl-C")
    c.add_argument("--metrics", action="store_true", help="and how well the ramp keeps its time")
    command("info", info, "names, limits and rates")
    c = command("arm", arm, "switch servos on where they stand")
    where = c.add_mutually_exclusive_group()
    where.add_argument("--q", metavar="Q1,Q2,...", help="the joints stand at these angles")
    where.add_argument("--at", action="append", nargs=2, metavar=("SERVO", "ANGLE"), help="this servo stands here")
    where.add_argument("--stored", action="store_true", help="nobody touched the arm since the daemon left it")
    where.add_argument("--board", action="store_true", help="take over what the board is still putting out (default)")
    c.add_argument("--servo", action="append", metavar="NAME", help="with --stored: only these")
    c = command("move", move, "move servos and wait until they are there")
    c.add_argument(
        "--joint", action="append", nargs=2, metavar=("N", "ANGLE"), default=[], help="joint number and angle"
    )
    c.add_argument("--servo", action="append", nargs=2, metavar=("NAME", "ANGLE"), default=[], help="any servo")
    c.add_argument("--q", metavar="Q1,Q2,...", help="all joints")
    _motion(c)
    c.add_argument("--payload-g", type=float, metavar="G", help="what the gripper carries from now on")
    c = command("gripper", gripper, "turn the gripper's servo")
    c.add_argument("angle", metavar="ANGLE")
    _motion(c)
    c = command("pan-tilt", pan_tilt, "turn the camera")
    c.add_argument("pan", metavar="PAN")
    c.add_argument("tilt", metavar="TILT")
    _motion(c)
    c = command("ik", ik, "commands that bring the bent arm's tool to a place (mm)")
    _goal(c)
    c = command("goto", goto, "bring the tool to a place (mm): plan a way, and go")
    _goal(c)
    _motion(c)
    c = command("plan", plan, "a way to joint angles, round what is between; with --go, take it")
    c.add_argument("--q", required=True, metavar="Q1,Q2,...", help="where to")
    c.add_argument("--seed", type=int, default=0, help="another seed finds another way")
    c.add_argument("--go", action="store_true", help="and move there")
    _motion(c)
    c = command("fk", fk, "where the bent arm's tool is for joint angles (mm)")
    c.add_argument("--q", metavar="Q1,Q2,...", help="default: where the arm was told to be")
    c.add_argument("--payload-g", type=float, default=0.0, metavar="G", help="what the gripper carries")
    command("hold", hold, "stop where it is, with pulses on; anybody may")
    c = command("relax", relax, "stop the pulses: what they carried falls")
    c.add_argument("servo", nargs="*", metavar="SERVO", help="which (default: all)")
    command("reload", reload, "take the model's file as it is now; nothing moves")
    command("disarm", disarm, "stop all pulses of an arm that stands still")
    command("reset", reset, "leave fault or estop; nothing moves")
    c = command("estop", estop, "stop all pulses at the next tick; anybody may")
    c.add_argument("--why", default="", help="for the log")
    c = command("logs", logs, "the last events")
    c.add_argument("--follow", action="store_true", help="and those to come, until Ctrl-C")
    c = command("level1", level1, "calibrate one servo with a protractor and write its table into an arm file")
    c.add_argument("servo", metavar="SERVO", help="joint1 ... or another servo")
    c.add_argument("--arm", required=True, metavar="ARM", help="the arm file to start from, or a shipped arm")
    c.add_argument("-o", "--output", required=True, type=Path, metavar="FILE", help="the new arm file")
    c.add_argument(
        "--angles", default="-100,0,100", metavar="A1,A2,...", help="where to measure (default: %(default)s)"
    )
    return p


def _goal(c: argparse.ArgumentParser) -> None:
    for name in ("x", "y", "z"):
        c.add_argument(name, type=float, metavar=name.upper(), help="mm")
    turn = c.add_mutually_exclusive_group()
    turn.add_argument("--rpy", metavar="R,P,Y", help="orientation: turns about the fixed x, then y, then z axis")
    turn.add_argument("--approach", metavar="X,Y,Z", help="direction that the tool points along")
    c.add_argument("--method", choices=["cube", "direct", "iterative"], default="cube", help="default: %(default)s")
    c.add_argument("--round", choices=["each", "best"], default="best", help="how angles become counts")
    c.add_argument("--payload-g", type=float, default=0.0, metavar="G", help="what the gripper carries")


def _motion(c: argparse.ArgumentParser) -> None:
    c.add_argument("--each", action="store_true", help="each servo at its own full rate; else all end together")
    c.add_argument("--speed", type=float, default=1.0, help="share of the full rate (default: %(default)s)")


def rover_of(o: argparse.Namespace) -> Rover:
    """The session that the options ask for."""
    return Rover(o.robot, o.connect.split(",") if o.connect else None, o.zenoh_config)


def holder() -> str:
    """What the lease says of who commands."""
    return f"lrm ({getpass.getuser()})"


def state(o: argparse.Namespace) -> int:
    """`lrm state`."""
    with rover_of(o) as rover:
        pause = threading.Event()
        while True:
            joints, mode = rover.joints(), rover.mode()
            parts = [cli_text.mode_line(mode, joints), cli_text.joints_table(joints, rover.thermal())]
            faults = rover.faults()
            parts += [cli_text.faults_text(faults)] if faults.faults else []
            if o.metrics:
                metrics = rover.metrics()
                parts += [cli_text.metrics_line(metrics), cli_text.lateness_chart(metrics)]
            clear = "\033[H\033[J" if o.watch and sys.stdout.isatty() else ""
            print(clear + "\n".join(parts), flush=True)
            if not o.watch:
                return 0
            pause.wait(0.2)


def info(o: argparse.Namespace) -> int:
    """`lrm info`."""
    with rover_of(o) as rover:
        print(cli_text.info_text(rover.info()))
    return 0


def arm(o: argparse.Namespace) -> int:
    """`lrm arm`."""
    with rover_of(o) as rover, rover.control(holder(), o.take):
        try:
            if o.q or o.at:
                rover.arm("given", _joints(rover, o.q) if o.q else _named(rover, o.at), o.servo)
            else:
                rover.arm("stored" if o.stored else "board", servos=o.servo)
        except RequestRefused as error:
            if error.code != "pose_needed":
                raise
            raise LrmError(f"{error}{_stored_hint(error.detail)}") from None
        on = [n for n, is_on in zip(rover.joints().names, rover.joints().on, strict=True) if is_on]
        print(f"armed: {', '.join(on)}")
    return 0


def _stored_hint(detail: Mapping[str, object]) -> str:
    stored = detail.get("stored_rad")
    if not isinstance(stored, dict) or not stored:
        return " (no pose is stored)"
    pose = ", ".join(f"{n} {math.degrees(q):.1f}" for n, q in stored.items())
    return f". Stored (deg): {pose}" + ("" if detail.get("stored_still") else "; but it was moving then")


def move(o: argparse.Namespace) -> int:
    """`lrm move`."""
    with rover_of(o) as rover:
        targets = _joints(rover, o.q) if o.q else {}
        targets |= _named(rover, [(f"joint{n.removeprefix('joint')}", a) for n, a in o.joint] + o.servo)
        if not targets:
            raise LrmError("move: nothing to move; give --joint N ANGLE, --servo NAME ANGLE or --q")
        return _go(o, rover, targets, None if o.payload_g is None else o.payload_g / 1000)


def gripper(o: argparse.Namespace) -> int:
    """`lrm gripper`."""
    with rover_of(o) as rover:
        return _go(o, rover, _named(rover, [("gripper", o.angle)]))


def pan_tilt(o: argparse.Namespace) -> int:
    """`lrm pan-tilt`."""
    with rover_of(o) as rover:
        return _go(o, rover, _named(rover, [("pan", o.pan), ("tilt", o.tilt)]))


def _go(o: argparse.Namespace, rover: Rover, targets: Mapping[str, float], payload: float | None = None) -> int:
    return _through(o, rover, [targets], payload)


def _through(
    o: argparse.Namespace, rover: Rover, waypoints: Sequence[Mapping[str, float]], payload: float | None
) -> int:
    if not 0 < o.speed <= 1:
        raise LrmError(f"--speed {o.speed:g}: should be more than 0, at most 1")
    with rover.control(holder(), o.take):
        try:
            seconds = rover.move(*waypoints, pace="each" if o.each else "together", speed=o.speed, payload_kg=payload)
        except KeyboardInterrupt:
            rover.hold()
            print("held", file=sys.stderr)
            return 1
    print(f"there, after {seconds:.1f} s")
    return 0


def ik(o: argparse.Namespace) -> int:
    """`lrm ik`."""
    with rover_of(o) as rover:
        print(cli_text.answer_text(_asked(o, rover), rover.info().names))
    return 0


def _asked(o: argparse.Namespace, rover: Rover) -> IkAnswer:
    """The answer to the goal of the command line. Raises `LrmError` if it cannot be taken."""
    goal = GoalEntry(
        position_m=[v / 1000 for v in (o.x, o.y, o.z)],
        rpy_rad=_three("--rpy", angles_of(o.rpy)) if o.rpy else None,
        approach=_three("--approach", _numbers("--approach", o.approach)) if o.approach else None,
    )
    request = IkRequest(
        goals=[goal], near_rad=rover.standing(), method=o.method, round=o.round, payload_kg=o.payload_g / 1000,
        deadline_ms=5000.0,
    )  # fmt: skip
    answer = rover.ik(request).answers[0]
    if answer.q_rad is None:
        raise LrmError(f"{answer.verdict}: {answer.text}")
    return answer


def _numbers(name: str, text: str) -> list[float]:
    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        raise LrmError(f"{name} {text}: should be numbers with commas between them") from None


def _three(name: str, values: list[float]) -> list[float]:
    if len(values) != 3:
        raise LrmError(f"{name} has {len(values)} numbers; should be three with commas between them")
    return values


def goto(o: argparse.Namespace) -> int:
    """`lrm goto`."""
    with rover_of(o) as rover:
        answer = _asked(o, rover)
        print(cli_text.answer_text(answer, rover.info().names))
        waypoints = _way(rover, answer.rounded_q_rad or answer.q_rad or [], o.payload_g / 1000, 0)
        return _through(o, rover, waypoints, o.payload_g / 1000)


def plan(o: argparse.Namespace) -> int:
    """`lrm plan`."""
    with rover_of(o) as rover:
        waypoints = _way(rover, list(_joints(rover, o.q).values()), 0.0, o.seed)
        return _through(o, rover, waypoints, None) if o.go else 0


def _way(rover: Rover, q: list[float], payload: float, seed: int) -> list[dict[str, float]]:
    """Plans a way to joint angles (rad) and prints it. Raises `LrmError` if there is none."""
    reply = rover.plan(PlanRequest(from_rad=rover.standing(), to_rad=q, payload_kg=payload, seed=seed))
    if not reply.found:
        raise LrmError(reply.text)
    print(cli_text.way_text(reply.waypoints_rad))
    names = rover.info().names
    return [dict(zip(names, waypoint, strict=False)) for waypoint in reply.waypoints_rad[1:]]


def fk(o: argparse.Namespace) -> int:
    """`lrm fk`."""
    with rover_of(o) as rover:
        q = list(_joints(rover, o.q).values()) if o.q else rover.standing()
        place = rover.fk(FkRequest(q_rad=[q], payload_kg=o.payload_g / 1000)).places[0]
        print(cli_text.place_text(place))
    return 0


def hold(o: argparse.Namespace) -> int:
    """`lrm hold`."""
    with rover_of(o) as rover:
        rover.hold()
    print("holding")
    return 0


def relax(o: argparse.Namespace) -> int:
    """`lrm relax`."""
    with rover_of(o) as rover, rover.control(holder(), o.take):
        rover.relax(o.servo or None)
    print("relaxed")
    return 0


def disarm(o: argparse.Namespace) -> int:
    """`lrm disarm`."""
    with rover_of(o) as rover, rover.control(holder(), o.take):
        rover.disarm()
    print("disarmed")
    return 0


def reset(o: argparse.Namespace) -> int:
    """`lrm reset`."""
    with rover_of(o) as rover, rover.control(holder(), o.take):
        rover.reset_fault()
        print(rover.mode().mode)
    return 0


def reload(o: argparse.Namespace) -> int:
    """`lrm reload`."""
    with rover_of(o) as rover:
        print(cli_text.model_text((reply := rover.reload()).model, reply.model_sha256))
    return 0


def estop(o: argparse.Namespace) -> int:
    """`lrm estop`."""
    with rover_of(o) as rover:
        rover.estop(o.why or f"lrm estop ({getpass.getuser()})")
    print("stopped: the pulses are off")
    return 0


def logs(o: argparse.Namespace) -> int:
    """`lrm logs`."""
    with rover_of(o) as rover:
        for event in rover.events():
            print(cli_text.event_line(event))
        if o.follow:
            rover.watch(Event, "event/**", lambda event: print(cli_text.event_line(event), flush=True))
            threading.Event().wait()
    return 0


def level1(o: argparse.Namespace) -> int:
    """`lrm level1`."""
    from lrmd.level1 import walk_through

    with rover_of(o) as rover, rover.control(holder(), o.take):
        walk_through(rover, o.servo, o.arm, o.output, angles_of(o.angles))
    return 0


def _joints(rover: Rover, text: str) -> dict[str, float]:
    angles, who = angles_of(text), rover.info()
    if len(angles) != who.joints:
        raise LrmError(f"--q has {len(angles)} angles; {who.arm} has {who.joints} joints")
    return dict(zip(who.names, angles, strict=False))


def _named(rover: Rover, pairs: list[tuple[str, str]]) -> dict[str, float]:
    names = rover.info().names
    for name, _ in pairs:
        if name not in names:
            raise LrmError(f"unknown servo '{name}'; {nearest(name, names)}")
    return {name: angle_of(text) for name, text in pairs}
