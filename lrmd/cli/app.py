"""`lrm`, the operator's command line: its arguments and the handler of each command."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias, get_args

from lrm_math.command_line import INTERRUPTED, OneLineParser
from lrm_math.errors import LrmError
from lrm_math.stdout import flush_or_discard, os_error_words
from lrmd.cli import motion, skill, status
from lrmd.cli.record import record
from lrmd.client import MotionInterrupted
from lrmd.messages.codec import field_named
from lrmd.messages.kinematics import IkRequest
from lrmd.messages.skills import SkillName

Handler: TypeAlias = Callable[[argparse.Namespace], int]
OptionGroup: TypeAlias = Callable[[argparse.ArgumentParser], None]
DESCRIPTION = """\
Drive a robot arm through lrmd, the daemon that owns it. Usual commands:

  lrm state --watch                    show the state (always allowed)
  lrm arm --q 0,-60,0,0,0,0            switch the servos on; the angles say
                                       where the arm stands NOW
  lrm move --joint 2 30 --joint 3 -10  move two joints; Ctrl-C stops and holds
  lrm move --q 0,-60,0,0,0,0           move all joints, ending together
  lrm disarm                           switch the servos off: the arm falls
  lrm estop                            emergency stop: off at once, whoever is
                                       in command

RC servos jump to the first pulse they get. So state where the arm stands when
you arm it: --q gives its angles; --stored says that nobody touched the arm
since the daemon left it; --board takes over a board that still sends pulses.
Write angles as 30, 30deg or 0.5rad.
"""


def main(argv: list[str] | None = None) -> int:
    """Runs one command. Exit code 0; 1 if a motion did not reach its goal or nobody reads on; 130 after Ctrl-C
    that ends no motion; 2 on any other error."""
    try:
        options = parser().options_of(argv)
        with field_named():
            code = int(options.run(options))
        sys.stdout.flush()
        return code
    except BrokenPipeError:  # the reader has gone, as `head` does
        flush_or_discard()
        return 1
    except OSError as error:  # such as a full disk behind `>`
        print(f"lrm: {os_error_words(error)}", file=sys.stderr)
        return 2
    except LrmError as error:
        print(f"lrm: {error}", file=sys.stderr)
        return 1 if isinstance(error, MotionInterrupted) else 2
    except KeyboardInterrupt:
        print("lrm: interrupted", file=sys.stderr)
        return INTERRUPTED


class LrmArgumentParser(OneLineParser):
    """Parses `-10deg` and `-10,0,20` as angles, not as options."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._negative_number_matcher = re.compile(r"-\.?\d")

    def options_of(self, argv: list[str] | None) -> argparse.Namespace:
        """Options of a command line; words that a command does not know are reported with that command's help."""
        options, unknown = self.parse_known_args(argv)
        if unknown:
            options.parser.error(f"unrecognized arguments: {' '.join(unknown)}")
        return options


def parser() -> LrmArgumentParser:
    """The command line."""
    p = LrmArgumentParser("lrm", description=DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--robot", default="rover", help="name of the robot whose daemon to use (default: %(default)s)")
    p.add_argument("--connect", metavar="ENDPOINT", help="zenoh endpoint (default: LRM_CONNECT, or tcp/127.0.0.1:7447)")
    p.add_argument("--zenoh-config", metavar="FILE", help="password or certificates (default: LRM_ZENOH_CONFIG)")
    p.add_argument("--take", action="store_true", help="take command even if another client has it")
    commands = p.add_subparsers(title="commands", required=True, metavar="COMMAND")

    def command(name: str, run: Handler, text: str, *groups: OptionGroup) -> argparse.ArgumentParser:
        """Adds a command with its help text and its groups of options."""
        sub = commands.add_parser(name, help=text, description=text)
        sub.set_defaults(run=run, parser=sub)
        for add_options in groups:
            add_options(sub)
        return sub

    command("state", status.state, "show mode, servos, temperatures and faults", _state)
    command("info", status.info, "show names, limits and rates")
    command("arm", motion.arm, "switch the servos on; state where they stand", _arm)
    command("move", motion.move, "move servos, and wait until they arrive", _move)
    command("gripper", motion.gripper, "turn the gripper's servo", _motion).add_argument("angle", metavar="ANGLE")
    command("pan-tilt", motion.pan_tilt, "turn the camera", _motion, _pan_tilt)
    command("ik", motion.ik, "compute commands that bring the tool to a place (mm)", _goal)
    command("goto", motion.goto, "move the tool to a place (mm) on a collision-free path", _goal, _motion).add_argument(
        "--line",
        action="store_true",
        help="in a straight line, within 0.5 mm; the tool keeps the orientation it has, or takes yours",
    )
    command("skill", skill.skill, "carry out a step of a fetch: go above something, down, grasp it, bring it", _skill)
    command("plan", motion.plan, "plan a collision-free path to joint angles; with --go, move", _plan, _motion)
    command("fk", motion.fk, "predict where the tool is for joint angles (mm)", _fk, _payload)
    command("hold", motion.hold, "stop and hold, with pulses on (always allowed)")
    relax = command("relax", motion.relax, "stop the pulses of servos: what they carry falls")
    relax.add_argument("servo", nargs="*", metavar="SERVO", help="which (default: all)")
    command("reload", status.reload, "load the model file again; nothing moves")
    command(
        "deploy",
        status.deploy,
        "send a model to the daemon, which checks it and uses it at once; nothing moves",
        _deploy,
    )
    command("disarm", motion.disarm, "stop all pulses of an arm that stands still")
    command("reset", motion.reset, "leave the modes fault and estop; nothing moves")
    estop = command("estop", motion.estop, "emergency stop: all pulses off at the next tick (always allowed)")
    estop.add_argument("--why", default="", help="reason, for the log")
    logs = command("logs", status.logs, "print the last events")
    logs.add_argument("--follow", action="store_true", help="also print new events, until Ctrl-C")
    written = "write the commands with their times into a file, for lrm-ident motion; nothing moves"
    command("record", record, written, _record)
    text = "calibrate one servo with a protractor and write its table into an arm file; or measure the board's clock"
    command("level1", motion.level1, text, _level1)
    return p


def _state(c: argparse.ArgumentParser) -> None:
    c.add_argument("--watch", action="store_true", help="repeat until Ctrl-C")
    c.add_argument("--metrics", action="store_true", help="also show how punctual the real-time process is")


def _record(c: argparse.ArgumentParser) -> None:
    c.add_argument("-o", "--output", required=True, metavar="CSV", help="file to write, with NAME.toml beside it")
    c.add_argument("--seconds", type=float, metavar="S", help="how long (default: until Ctrl-C)")


def _arm(c: argparse.ArgumentParser) -> None:
    where = c.add_mutually_exclusive_group()
    where.add_argument("--q", metavar="Q1,Q2,...", help="the joints stand at these angles")
    where.add_argument("--at", action="append", nargs=2, metavar=("SERVO", "ANGLE"), help="this servo stands here")
    where.add_argument("--stored", action="store_true", help="nobody touched the arm since the daemon left it")
    where.add_argument("--board", action="store_true", help="take over a board that is still sending pulses (default)")
    c.add_argument("--servo", action="append", metavar="NAME", help="with --stored: only these")


def _move(c: argparse.ArgumentParser) -> None:
    pair: dict[str, Any] = {"action": "append", "nargs": 2, "default": []}
    c.add_argument("--joint", **pair, metavar=("N", "ANGLE"), help="joint number and angle")
    c.add_argument("--servo", **pair, metavar=("NAME", "ANGLE"), help="any servo")
    c.add_argument("--q", metavar="Q1,Q2,...", help="all joints")
    _motion(c)
    c.add_argument("--payload-g", type=float, metavar="G", help="load that the gripper carries from now on")


def _pan_tilt(c: argparse.ArgumentParser) -> None:
    c.add_argument("pan", metavar="PAN")
    c.add_argument("tilt", metavar="TILT")


def _plan(c: argparse.ArgumentParser) -> None:
    c.add_argument("--q", required=True, metavar="Q1,Q2,...", help="angles of the goal")
    c.add_argument("--seed", type=int, default=0, help="seed of the search: another one finds another path")
    c.add_argument("--go", action="store_true", help="also move there")


def _skill(c: argparse.ArgumentParser) -> None:
    c.add_argument("name", choices=get_args(SkillName), metavar="SKILL", help=", ".join(get_args(SkillName)))
    c.add_argument("--goal", nargs=3, type=float, metavar=("X", "Y", "Z"), help="place of the tool (mm)")
    turn = c.add_mutually_exclusive_group()
    turn.add_argument("--rpy", metavar="R,P,Y", help="orientation there: turns about the fixed x, then y, then z axis")
    turn.add_argument("--approach", metavar="X,Y,Z", help="direction that the tool points along there")
    c.add_argument("--height-mm", type=float, metavar="MM", help="above the goal, or up from here")
    c.add_argument("--q", metavar="Q1,Q2,...", help="pose to stow in")
    c.add_argument("--gripper", metavar="ANGLE", help="where the gripper's servo turns to")
    c.add_argument("--payload-g", type=float, metavar="G", help="load that is grasped")
    c.add_argument(
        "--payload-centre-mm", nargs=3, type=float, metavar=("X", "Y", "Z"),
        help="where its centre is from where the arm file takes it, along the tool's axes",
    )  # fmt: skip
    c.add_argument("--listen", type=float, metavar="S", help="time after closing to tell that nothing is there")
    c.add_argument(
        "--touch",
        nargs=3,
        action="append",
        default=[],
        metavar=("SHAPE", "OTHER", "MM"),
        help="let these two shapes touch near the goal and overlap by so much (below zero: a gap)",
    )
    c.add_argument("--speed", type=float, default=1.0, help="share of the full rate (default: %(default)s)")


def _fk(c: argparse.ArgumentParser) -> None:
    c.add_argument("--q", metavar="Q1,Q2,...", help="joint angles (default: the last commanded ones)")


def _deploy(c: argparse.ArgumentParser) -> None:
    c.add_argument("model", nargs="?", type=Path, metavar="MODEL", help="a model file of lrm-ident, of poses or motion")
    undo = "return to the model before the last one; with 'motion' to the motion model before"
    c.add_argument("--undo", nargs="?", const="model", choices=["model", "motion"], help=undo)
    accept = "accept a model that moves the tip by more than a fifth of the reach, or loses much when deployed"
    c.add_argument("--accept", action="store_true", help=accept)


def _level1(c: argparse.ArgumentParser) -> None:
    c.add_argument("servo", metavar="SERVO", help="joint1 ... or another servo")
    clock = "measure the board's clock with this servo, by a logic probe or two angles, before the first arming"
    c.add_argument("--clock", action="store_true", help=clock)
    c.add_argument("--arm", metavar="ARM", help="the arm file to start from, or a shipped arm")
    c.add_argument("-o", "--output", type=Path, metavar="FILE", help="the new arm file")
    text = "angles to measure at (default: %(default)s)"
    c.add_argument("--angles", default="-100,0,100", metavar="A1,A2,...", help=text)


def _goal(c: argparse.ArgumentParser) -> None:
    for name in ("x", "y", "z"):
        c.add_argument(name, type=float, metavar=name.upper(), help="mm")
    turn = c.add_mutually_exclusive_group()
    turn.add_argument("--rpy", metavar="R,P,Y", help="orientation: turns about the fixed x, then y, then z axis")
    turn.add_argument("--approach", metavar="X,Y,Z", help="direction that the tool points along")
    method = IkRequest.model_fields["method"]
    c.add_argument(
        "--method",
        choices=get_args(method.annotation),
        default=method.default,
        help="method of the inverse (docs/ik.md; default: %(default)s)",
    )
    c.add_argument(
        "--round",
        choices=["each", "best"],
        default="best",
        help="round each joint alone, or the best combination (default)",
    )
    _payload(c)


def _payload(c: argparse.ArgumentParser) -> None:
    c.add_argument("--payload-g", type=float, metavar="G", help="load that the gripper carries (default: as before)")


def _motion(c: argparse.ArgumentParser) -> None:
    c.add_argument("--each", action="store_true", help="each servo at its own full rate; else all end together")
    c.add_argument("--speed", type=float, default=1.0, help="share of the full rate (default: %(default)s)")
