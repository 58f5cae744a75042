"""The daemon without hardware, in a few seconds: `python -m lrmd.demo [--speed 10]`.

Starts a simulated board and the daemon on a clock that runs faster than time, arms the arm, moves it through a few
poses, shows what a client hears over zenoh and where the simulated tool truly is, stops it in the middle of a move, and
leaves nothing behind.
"""

from __future__ import annotations

import argparse
import math
import socket
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path

from lrm_math.errors import LrmError
from lrmd import log
from lrmd.api.process import Api
from lrmd.client.rover import NoAnswer, Rover
from lrmd.config import Config, load_config
from lrmd.messages.control import Event, JointsState
from lrmd.sim.control_socket import ask
from lrmd.sim.launch import simulated_board

ARM = "lrm-rover"
CONFIG = """\
schema = "lrm/daemon/1"
robot = "demo"
arm = "{arm}"
link = {{ port = "simulated", pwm_hz = 330.0, silence_ms = 10000, reply_ms = 2000 }}
safety = {{ stagger_ms = 50 }}
state = {{ directory = "{state}" }}
zenoh = {{ listen = ["tcp/127.0.0.1:{port}"] }}
{servos}
"""
POSES = ((0, 0, 0, 0, 0, 0), (30, -45, 20, 0, 0, 0), (30, -45, 20, 40, 0, 0), (-30, -60, 30, 20, -30, 45))
"""deg; the simulated arm stands at the first."""
PATIENCE = 10.0
FASTEST = 40.0
"""Times as fast as time: a tick then takes 0.16 ms, about what ramp and board need for it."""


def free_port() -> int:
    """A TCP port on loopback that nobody has now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def config_in(folder: Path) -> Config:
    """A configuration of a daemon that keeps everything in a folder. Raises `LrmError`."""
    servos = "\n".join(f"servo.joint{i + 1}.channel = {i}" for i in range(6))
    path = folder / "lrmd.toml"
    path.write_text(CONFIG.format(arm=ARM, state=folder / "state", port=free_port(), servos=servos), encoding="utf-8")
    return load_config(path)


def _serve(config: Config, speed: float) -> None:
    log.set_up("error")
    sys.exit(Api(config, speed).run())


@contextmanager
def daemon(config: Config, speed: float) -> Iterator[None]:
    """Runs the daemon in a process of its own, as systemd would: SIGTERM ends it."""
    process = get_context("spawn").Process(target=_serve, args=(config, speed))
    process.start()
    try:
        yield
    finally:
        process.terminate()
        process.join(PATIENCE)
        if process.exitcode is None:
            process.kill()
            process.join()


@contextmanager
def connected(config: Config) -> Iterator[Rover]:
    """A client, as soon as there is a daemon with a board. Raises `NoAnswer`."""
    end = time.monotonic() + PATIENCE
    while True:
        try:
            with Rover(config.robot, config.zenoh.listen) as rover:
                while rover.mode().link != "ready" and time.monotonic() < end:
                    time.sleep(0.02)
                yield rover
                return
        except NoAnswer:
            if time.monotonic() > end:
                raise
            time.sleep(0.05)


def degrees(angles: Sequence[float]) -> str:
    """Angles (rad) as one cell each."""
    return " ".join(f"{math.degrees(q):7.1f}" for q in angles)


def tool(config: Config) -> str:
    """Where the simulated arm's tool truly is."""
    found = ask(Path(config.link.port), "tcp")
    return " ".join(f"{float(str(found[axis])):8.1f}" for axis in ("x_mm", "y_mm", "z_mm"))


def show(rover: Rover, config: Config) -> None:
    """Arms the arm and moves it through the poses; a line for each."""
    heard: list[JointsState] = []
    rover.watch(JointsState, "state/joints", heard.append)
    poses = [dict(zip(config.names, map(math.radians, pose), strict=True)) for pose in POSES]
    rover.arm("given", poses[0])
    print("armed where it stands: one servo after the other\n")
    print("state/joints, as told to the servos (deg)        | where the tool truly is (mm)  | messages")
    print(" ".join(f"{name:>7}" for name in config.names) + "  |        x        y        z     | heard")
    for pose in poses:
        rover.move(pose)
        print(f"{degrees(rover.joints().q_rad)}  | {tool(config)}    | {len(heard):5d}", flush=True)


def stop(rover: Rover, config: Config) -> None:
    """An emergency stop in the middle of a move, by somebody without the lease."""
    rover.move({"joint1": 1.0}, wait=False)
    time.sleep(0.2)
    with Rover(config.robot, config.zenoh.listen) as stranger:
        stranger.estop("the demo's stranger")
    while any(rover.joints().on):
        time.sleep(0.01)
    q = math.degrees(rover.joints().q_rad[0])
    print(f"\nemergency stop by another client, joint 1 on its way at {q:.1f} deg: {rover.mode().mode}, pulses off")
    rover.reset_fault()
    print(f"reset: {rover.mode().mode}; nothing moves until it is armed again")


def main(argv: list[str] | None = None) -> int:
    """Runs the demo. Exit code 0, or 2 with one line if it does not work here."""
    p = argparse.ArgumentParser("lrmd.demo", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--speed", type=float, default=10.0, help="how much faster than time (default: %(default)g)")
    speed = p.parse_args(argv).speed
    started = time.monotonic()
    try:
        if not 1 <= speed <= FASTEST:
            raise LrmError(f"--speed {speed:g}: should be from 1 to {FASTEST:g}")
        with tempfile.TemporaryDirectory(prefix="lrm-demo-") as folder:
            run(config_in(Path(folder)), speed)
    except LrmError as error:
        print(f"lrmd.demo: {error}", file=sys.stderr)
        return 2
    print(f"all stopped, after {time.monotonic() - started:.1f} s")
    return 0


def run(config: Config, speed: float) -> None:
    """The whole course on a simulated board. Raises `LrmError`."""
    with simulated_board(config, speed) as simulated, daemon(simulated, speed), connected(simulated) as rover:
        print(f"lrmd: {ARM} on a simulated board, {speed:g} times as fast as time; {rover.mode().mode}, pulses off")
        events: list[Event] = []
        rover.watch(Event, "event/mode", events.append)
        with rover.control("demo"):
            show(rover, simulated)
            stop(rover, simulated)
        print("modes told: " + ", ".join(str(event.detail["mode"]) for event in events))


if __name__ == "__main__":
    sys.exit(main())
