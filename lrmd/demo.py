"""Demo of the daemon without hardware: `python -m lrmd.demo [--speed 10]`.

Starts a simulated board and the daemon on an accelerated clock, arms the arm, moves it through a few poses, prints the
state that a client receives over zenoh and the true position of the simulated tool, and stops it during a move.
"""

from __future__ import annotations

import argparse
import math
import socket
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path

from lrm_math.command_line import INTERRUPTED, OneLineParser
from lrm_math.errors import LrmError
from lrmd import log
from lrmd.client import NoReply, Rover
from lrmd.config import Config, load_config
from lrmd.main import run as run_daemon
from lrmd.messages.control import Event, JointsState
from lrmd.sim.control_socket import query_board
from lrmd.sim.launch import simulated_board

ARM = "lrm-rover"
CONFIG = """\
schema = "lrm/daemon/1"
robot = "demo"
arm = "{arm}"
link = {{ port = "simulated", pwm_hz = 330.0, silence_ms = 10000, reply_ms = 4900 }}
safety = {{ stagger_ms = 50 }}
state = {{ directory = "{state}" }}
zenoh = {{ listen = ["tcp/127.0.0.1:{port}"] }}
{servos}
"""
POSES = ((0, 0, 0, 0, 0, 0), (30, -45, 20, 0, 0, 0), (30, -45, 20, 40, 0, 0), (-30, -60, 30, 20, -30, 45))
"""deg; the simulated arm starts at the first."""
TIMEOUT, START_TIMEOUT = 10.0, 60.0
"""s: for the daemon to end, and to come up on a busy machine."""
MAX_SPEED = 40.0
"""Ratio to real time: a tick then lasts 0.16 ms, about the computing time of ramp and board."""


def free_port() -> int:
    """A free TCP port on loopback."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def config_in(folder: Path) -> Config:
    """Configuration of a daemon whose files are all in a folder. Raises `LrmError`."""
    servos = "\n".join(f"servo.joint{i + 1}.channel = {i}" for i in range(6))
    path = folder / "lrmd.toml"
    path.write_text(CONFIG.format(arm=ARM, state=folder / "state", port=free_port(), servos=servos), encoding="utf-8")
    return load_config(path)


def _serve(config: Config, speed: float) -> None:
    log.set_up("error")
    sys.exit(run_daemon(config, speed))


@contextmanager
def daemon(config: Config, speed: float) -> Iterator[None]:
    """Runs the daemon in a process of its own; SIGTERM ends it, as with systemd."""
    process = get_context("spawn").Process(target=_serve, args=(config, speed))
    process.start()
    try:
        yield
    finally:
        process.terminate()
        process.join(TIMEOUT)
        if process.exitcode is None:
            process.kill()
            process.join()


@contextmanager
def connected(config: Config) -> Iterator[Rover]:
    """A client, as soon as there is a daemon with a board. Raises `NoReply`."""
    _await_board(config, time.monotonic() + START_TIMEOUT)
    with Rover(config.robot, config.zenoh.listen) as rover:
        yield rover


def _await_board(config: Config, end: float) -> None:
    """Returns when the board answers the daemon, or at a monotonic time (s). Raises `NoReply`: there is no daemon."""
    while True:
        try:
            with Rover(config.robot, config.zenoh.listen) as rover:
                while rover.mode().link != "ready" and time.monotonic() < end:
                    time.sleep(0.02)
                return
        except NoReply:
            if time.monotonic() > end:
                raise
            time.sleep(0.05)


def tool(config: Config) -> str:
    """True position (mm) of the simulated arm's tool."""
    reply = query_board(Path(config.link.port), "tcp")
    return " ".join(f"{float(str(reply[axis])):8.1f}" for axis in ("x_mm", "y_mm", "z_mm"))


def show(rover: Rover, config: Config) -> None:
    """Arms the arm and moves it through the poses; prints a line for each."""
    received: list[JointsState] = []
    rover.watch(JointsState, "state/joints", received.append)
    poses = [dict(zip(config.names, map(math.radians, pose), strict=True)) for pose in POSES]
    rover.arm("given", poses[0])
    print("armed at its present position: one servo after the other\n")
    print("state/joints, commanded angles (deg)             | true position of the tool (mm) | messages")
    print(" ".join(f"{name:>7}" for name in config.names) + "  |        x        y        z     | received")
    for pose in poses:
        rover.move(pose)
        angles = " ".join(f"{math.degrees(q):7.1f}" for q in rover.joints().q_rad)
        print(f"{angles}  | {tool(config)}    | {len(received):5d}", flush=True)


def stop(rover: Rover, config: Config) -> None:
    """An emergency stop during a move, by a client without the lease."""
    rover.move({"joint1": 1.0}, wait=False)
    time.sleep(0.2)
    with Rover(config.robot, config.zenoh.listen) as other:
        other.estop("another client")
    while any(rover.joints().on):
        time.sleep(0.01)
    q = math.degrees(rover.joints().q_rad[0])
    print(f"\nemergency stop by another client, joint 1 at {q:.1f} deg: {rover.mode().mode}, pulses off")
    rover.reset_fault()
    print(f"reset: {rover.mode().mode}; nothing moves until it is armed again")


def main(argv: list[str] | None = None) -> int:
    """Runs the demo. Exit code 0, or 2 with one line that says what failed."""
    p = OneLineParser("python -m lrmd.demo", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--speed", type=float, default=10.0, help="ratio to real time (default: %(default)g)")
    started = time.monotonic()
    try:
        speed = p.parse_args(argv).speed
        if not 1 <= speed <= MAX_SPEED:
            raise LrmError(f"--speed {speed:g}: should be from 1 to {MAX_SPEED:g}")
        with tempfile.TemporaryDirectory(prefix="lrm-demo-") as folder:
            run(config_in(Path(folder)), speed)
    except LrmError as error:
        print(f"lrmd.demo: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:  # all that runs ends with its context
        print("lrmd.demo: interrupted", file=sys.stderr)
        return INTERRUPTED
    print(f"all stopped, after {time.monotonic() - started:.1f} s")
    return 0


def run(config: Config, speed: float) -> None:
    """The demo on a simulated board. Raises `LrmError`."""
    with simulated_board(config, speed) as simulated, daemon(simulated, speed), connected(simulated) as rover:
        print(f"lrmd: {ARM} on a simulated board at {speed:g} times real time; {rover.mode().mode}, pulses off")
        events: list[Event] = []
        rover.watch(Event, "event/mode", events.append)
        with rover.control("demo"):
            show(rover, simulated)
            stop(rover, simulated)
        print("modes: " + ", ".join(str(event.detail["mode"]) for event in events))


if __name__ == "__main__":
    sys.exit(main())
