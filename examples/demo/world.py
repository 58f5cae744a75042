"""A simulated rover with its tracker: board on a pty, daemon, and the tracker's datagrams, all ended with the block."""

from __future__ import annotations

import math
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from lrm_math.errors import LrmError
from lrmd.client import Rover
from lrmd.config import Config, load_config
from lrmd.demo import START_TIMEOUT, connected, daemon, free_port
from lrmd.sim.launch import simulated_board

ARM, ROBOT = "lrm-lab", "demo"
TRACKER = "examples.demo.simulated_tracker"
SPEED = 6.0
"""Of the simulated board's clock against the computer's."""
STEP_US = 10.0
"""Largest step of a pulse in a tick: ten times that of Conenna 2024, section 5.4, so that moves take a tenth."""
CONFIG = """\
schema = "lrm/daemon/1"
robot = "{robot}"
arm = "{arm}"
link = {{ port = "simulated", pwm_hz = 330.0, silence_ms = 10000, reply_ms = 4900 }}
ramp = {{ step_us = {step} }}
safety = {{ stagger_ms = 50 }}
state = {{ directory = "{state}" }}
zenoh = {{ listen = ["tcp/127.0.0.1:{port}"] }}
{servos}
"""
HOME = (0.0,) * 6


@dataclass(frozen=True)
class World:
    """Addresses of the simulated rover: its zenoh endpoint, the board's link, the tracker's UDP port."""

    endpoint: str
    board: Path
    tracker_port: int

    @property
    def daemon(self) -> tuple[str, ...]:
        """Words that name its daemon."""
        return "--robot", ROBOT, "--connect", self.endpoint

    @property
    def load_command(self) -> str:
        """Command that puts a load on the simulated tool; its last word are grams."""
        return f"{sys.executable} -m examples.demo.load {self.board}"


def config_in(folder: Path) -> Config:
    """Configuration of a daemon whose files are all in a folder. Raises `LrmError`."""
    servos = "\n".join(f"servo.joint{i + 1}.channel = {i}" for i in range(len(HOME)))
    path = folder / "lrmd.toml"
    values = {"robot": ROBOT, "arm": ARM, "step": STEP_US, "state": folder / "state", "port": free_port()}
    path.write_text(CONFIG.format(servos=servos, **values), encoding="utf-8")
    return load_config(path)


@contextmanager
def simulated_world(folder: Path, seed: int, tracker: str = TRACKER, speed: float = SPEED) -> Iterator[World]:
    """Starts everything, and arms the arm at its home pose. Raises `LrmError`.

    `tracker`: module that sees the tip of the arm of a seed, by `simulated_tracker.track`. `speed`: of its clock.
    A SIGTERM ends this process as an exception does, with all that it started.
    """
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    config = config_in(folder)
    # Servos without a dead band: with one, each would stop short of where it was sent, on the side it comes from.
    with (
        simulated_board(config, speed, "--dead-band-us", "0") as simulated,
        daemon(simulated, speed),
        connected(simulated) as rover,
    ):
        world = World(config.zenoh.listen[0], Path(simulated.link.port), free_port())
        sees = subprocess.Popen([sys.executable, "-m", tracker, str(world.board), str(world.tracker_port), str(seed)])
        try:
            _await_frame(world.tracker_port)  # it counts the time for which the servos have power
            _arm(rover)
            yield world
        finally:
            sees.terminate()
            sees.wait()


def _await_frame(port: int) -> None:
    """Returns when the tracker sends. Raises `LrmError`."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", port))
        receiver.settimeout(START_TIMEOUT)
        try:
            receiver.recv(1)
        except TimeoutError:
            raise LrmError(f"the simulated tracker sent nothing within {START_TIMEOUT:g} s") from None


def _arm(rover: Rover) -> None:
    names = rover.info().names
    with rover.control("demo"):
        rover.arm("given", {name: math.radians(q) for name, q in zip(names, HOME, strict=True)})
