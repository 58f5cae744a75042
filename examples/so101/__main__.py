"""`python -m examples.so101 LINK EFFECT SEED [SPEED [KIND]]`: the simulated SO-101 at a device, until it is ended.

Its true tip is answered at the control socket beside the device, as the simulated board's is.
"""

from __future__ import annotations

import argparse
import os
import selectors
import signal
import sys
import time
from contextlib import ExitStack, closing
from pathlib import Path

from examples.so101.follower_calibration import write_calibration
from examples.so101.hidden_arm import ARM_FILE, BUSES, HIDDEN, NAMED, HiddenSo101, hidden_truth
from lrm_math.command_line import OneLineParser
from lrm_math.errors import LrmError, UnknownName
from lrmd.ramp.process import MonotonicClock
from lrmd.sim.control_socket import ControlServer, QueryReply
from lrmd.sim.pty_port import PtyPort
from lrmd.sim.simulation import SECOND
from validation.synthetic import load_arm

LONGEST_DEAD_TIME = 1.0
"""s."""
QUESTIONS = ("tip", "tool", "joints")


def run(
    link: Path, effect: str, seed: int, speed: float, kind: str, dead_time: float, parent: int | None = None
) -> None:
    """Serves until a signal, or until a parent process ends that is given by its number. Raises `LrmError`."""
    if effect not in HIDDEN:
        raise UnknownName("hidden effect", effect, HIDDEN)
    if kind not in BUSES:
        raise UnknownName("kind of servos", kind, BUSES)
    if not 0.0 <= dead_time <= LONGEST_DEAD_TIME:
        raise LrmError(f"--dead-time is {dead_time:g} s; should be from 0 to {LONGEST_DEAD_TIME:g} s")
    arm = HiddenSo101(hidden_truth(load_arm(ARM_FILE), effect, seed), kind=kind, dead_time=dead_time)
    clock = MonotonicClock(speed, time.monotonic_ns())

    def reply(question: str) -> QueryReply:
        arm.bus.advance(clock.now() / SECOND)
        if question not in QUESTIONS:
            raise UnknownName("question", question, QUESTIONS)
        if question == "tip":
            return {"tip_m": arm.tip().tolist()}
        if question == "tool":
            return {"tool": arm.tool().tolist()}
        return {
            "q_rad": arm.q.tolist(), "moving": arm.bus.moving, "goals": arm.bus.goals,
            "temperature_c": [s.rise + 25.0 for s in arm.servos],
        }  # fmt: skip

    with ExitStack() as farewell, ExitStack() as things, selectors.DefaultSelector() as waiting:
        control = things.enter_context(closing(ControlServer(link)))
        port = things.enter_context(closing(PtyPort(link)))
        port.open()
        waiting.register(control.socket, selectors.EVENT_READ)
        waiting.register(port, selectors.EVENT_READ)
        print(f"simulated SO-101 at {link} ({port.node})", flush=True)
        if parent is None:
            farewell.callback(print, f"simulated SO-101 at {link} ended", flush=True)
        while parent is None or os.getppid() == parent:
            for key, _ in waiting.select(1.0):
                if key.fileobj is control.socket:
                    control.serve(reply)
                else:
                    port.write(arm.bus.feed(port.read(), clock.now() / SECOND))


def parser() -> argparse.ArgumentParser:
    """The command line."""
    found = OneLineParser(
        "python -m examples.so101",
        usage="python -m examples.so101 LINK EFFECT SEED [SPEED [KIND]] [--calibration FILE] [--dead-time S]",
        description="Simulates an SO-101 with hidden errors at a serial device, until Ctrl-C or a signal ends it.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog="\n".join(
            [
                "EFFECT hides, beside errors of the geometry and springs in the joints:",
                *(f"  {name:9} {words} ({named})" for name, (named, words) in NAMED.items()),
                "",
                "A tracker beside it: python -m examples.so101.tracker LINK PORT SEED, for --tracker dtrack:PORT",
            ]
        ),
    )
    found.add_argument("link", metavar="LINK", type=Path, help="path of the device, for instance /tmp/so101")
    found.add_argument("effect", metavar="EFFECT", help=f"what is wrong with it: {', '.join(HIDDEN)}")
    found.add_argument("seed", metavar="SEED", type=int, help="whole number that draws the sizes of the errors: 0, 1 …")
    found.add_argument("speed", metavar="SPEED", type=float, nargs="?", default=1.0, help="of its clock; default 1")
    found.add_argument(
        "kind", metavar="KIND", nargs="?", default="feetech", help=f"of its servos: {', '.join(BUSES)}; default feetech"
    )
    found.add_argument(
        "--calibration",
        metavar="FILE",
        type=Path,
        help="also write LeRobot's calibration file of this arm, such as cal/mine.json for "
        "--robot.calibration_dir=cal --robot.id=mine",
    )
    found.add_argument(
        "--dead-time", metavar="S", type=float, default=0.0, help="s until a servo acts on a goal; default 0"
    )
    found.add_argument("--end-with-parent", action="store_true", help="end when the process that started it has ended")
    return found


def main() -> None:
    """Entry point: bad input is one line on stderr and exit code 2."""
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: sys.exit(0))
    try:
        given = parser().parse_args()
        parent = os.getppid() if given.end_with_parent else None
        if given.calibration is not None:
            write_calibration(given.calibration)
        run(given.link, given.effect, given.seed, given.speed, given.kind, given.dead_time, parent)
    except LrmError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)


if __name__ == "__main__":
    main()
