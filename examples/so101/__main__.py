"""`python -m examples.so101 LINK EFFECT SEED [SPEED [KIND]]`: the simulated SO-101 at a device, until it is ended.

Its servos are of the kind `feetech` or `dynamixel`.

Its true tip is answered at the control socket beside the device, as the simulated board's is.
"""

from __future__ import annotations

import os
import selectors
import signal
import sys
import time
from contextlib import ExitStack, closing
from pathlib import Path

from examples.so101.hidden_arm import ARM_FILE, BUSES, HIDDEN, HiddenSo101, hidden_truth
from lrm_math.errors import LrmError, UnknownName
from lrmd.ramp.process import MonotonicClock
from lrmd.sim.control_socket import ControlServer, QueryReply
from lrmd.sim.pty_port import PtyPort
from lrmd.sim.simulation import SECOND
from validation.synthetic import load_arm

QUESTIONS = ("tip", "tool", "joints")


def run(link: Path, effect: str, seed: int, speed: float = 1.0, kind: str = "feetech") -> None:
    """Serves until a signal, or until the parent process ends. Raises `LrmError`."""
    if effect not in HIDDEN:
        raise UnknownName("hidden effect", effect, HIDDEN)
    if kind not in BUSES:
        raise UnknownName("kind of servos", kind, BUSES)
    arm = HiddenSo101(hidden_truth(load_arm(ARM_FILE), effect, seed), kind=kind)
    clock, parent = MonotonicClock(speed, time.monotonic_ns()), os.getppid()

    def reply(question: str) -> QueryReply:
        arm.bus.advance(clock.now() / SECOND)
        if question not in QUESTIONS:
            raise UnknownName("question", question, QUESTIONS)
        if question == "tip":
            return {"tip_m": arm.tip().tolist()}
        if question == "tool":
            return {"tool": arm.tool().tolist()}
        moving = any(servo.moving for servo in arm.servos)
        return {
            "q_rad": arm.q.tolist(), "moving": moving, "goals": arm.bus.goals,
            "temperature_c": [s.rise + 25.0 for s in arm.servos],
        }  # fmt: skip

    with ExitStack() as things, selectors.DefaultSelector() as waiting:
        control = things.enter_context(closing(ControlServer(link)))
        port = things.enter_context(closing(PtyPort(link)))
        port.open()
        waiting.register(control.socket, selectors.EVENT_READ)
        waiting.register(port, selectors.EVENT_READ)
        print(f"simulated SO-101 at {link} ({port.node})", flush=True)
        while os.getppid() == parent:
            for key, _ in waiting.select(1.0):
                if key.fileobj is control.socket:
                    control.serve(reply)
                else:
                    port.write(arm.bus.feed(port.read(), clock.now() / SECOND))


def main() -> None:
    """Entry point: bad input is one line on stderr and exit code 2."""
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: sys.exit(0))
    try:
        link, effect, seed, *rest = sys.argv[1:]
        speed, kind = (*rest, *("1", "feetech")[len(rest) :])
        run(Path(link), effect, int(seed), float(speed), kind)
    except (LrmError, ValueError) as error:
        what = (
            error
            if isinstance(error, LrmError)
            else "should be: python -m examples.so101 LINK EFFECT SEED [SPEED [KIND]]"
        )
        print(f"error: {what}", file=sys.stderr)
        sys.exit(2)


if __name__ == "__main__":
    main()
