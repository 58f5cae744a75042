"""`lrm`: the operator's command line."""

from __future__ import annotations

import argparse
import getpass
import math
import sys
import threading
from collections.abc import Callable, Mapping
from pathlib import Path

from lrm_math.errors import LrmError, nearest
from lrmd import cli_text
from lrmd.angle import angle_of, angles_of
from lrmd.client import Interrupted, RequestRefused, Rover
from lrmd.messages import Event

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
        return run(options)
    except Interrupted as error:
        print(f"lrm: {error}", file=sys.stderr)
        return 1
    except LrmError as error:
        print(f"lrm: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 1


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = argparse.ArgumentParser("lrm", description=TEXT, formatter_class=argparse.RawDescriptionHelpFormatter)
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
    command("hold", hold, "stop where it is, with pulses on; anybody may")
    c = command("relax", relax, "stop the pulses: what they carried falls")
    c.add_argument("servo", nargs="*", metavar="SERVO", help="which (default: all)")
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
            parts += [cli_text.metrics_line(rover.metrics())] if o.metrics else []
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
                rover.arm("given", _joints(rover, o.q) if o.q else _named(rover, o.at))
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
    if not 0 < o.speed <= 1:
        raise LrmError(f"--speed {o.speed:g}: should be more than 0, at most 1")
    with rover.control(holder(), o.take):
        try:
            seconds = rover.move(targets, pace="each" if o.each else "together", speed=o.speed, payload_kg=payload)
        except KeyboardInterrupt:
            rover.hold()
            print("held", file=sys.stderr)
            return 1
    print(f"there, after {seconds:.1f} s")
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
