"""A simulated rover: board on a pty, daemon, an arm with hidden errors, and what it is calibrated by."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from examples.demo.simulated_tracker import BoardState, true_tip
from examples.fetch.places import ARM, HOME, MASSES_G
from lrm_ident.study import api
from lrm_math.arrays import Array
from lrmd.client import RequestRefused, Rover
from lrmd.client.model_text import text_to_deploy
from lrmd.config import load_config
from lrmd.demo import START_TIMEOUT, connected, daemon, free_port
from lrmd.messages.kinematics import FkRequest
from lrmd.sim.control_socket import query_board
from lrmd.sim.launch import simulated_board
from validation import synthetic

ARM_FILE = Path(__file__).resolve().parents[2] / "config" / "arms" / f"{ARM}.toml"
POSES, NOISE_M = 150, 0.0005
"""Measured positions of the calibration, and the spread of each coordinate (m)."""
CONFIG = """\
schema = "lrm/daemon/1"
robot = "fetch"
arm = "{arm}"
link = {{ port = "simulated", pwm_hz = 330.0, silence_ms = 10000, reply_ms = 4900 }}
ramp = {{ step_us = 10.0 }}
safety = {{ stagger_ms = 50, lease_ms = 500 }}
state = {{ directory = "{state}" }}
zenoh = {{ listen = ["tcp/127.0.0.1:{port}"] }}
{servos}
servo.gripper.channel = 6
"""


@dataclass(frozen=True)
class FetchWorld:
    """A simulated rover: the link of its `board`, a client, and the true arm."""

    board: Path
    rover: Rover
    arm: synthetic.ArmDescription
    truth: synthetic.GroundTruth

    def tip(self) -> Array:
        """(3,), where the tip really is (m)."""
        return true_tip(self.arm, self.truth, BoardState.of(self.board, len(HOME)))

    def load(self, mass: float) -> None:
        """Puts a mass (kg) into the gripper, or takes it out."""
        query_board(self.board, f"payload {mass * 1e3:g}")


def hidden_truth(seed: int) -> tuple[synthetic.ArmDescription, synthetic.GroundTruth]:
    """The true arm of a seed: errors of its geometry, springs in joints and base."""
    arm = synthetic.load_arm(ARM_FILE)
    return arm, synthetic.base_displacement_to_deviations(arm, synthetic.GroundTruth.random(arm, seed))


def calibration(folder: Path, seed: int) -> str:
    """Text of a model that is fitted to measurements of the true arm. Raises `LrmError`."""
    arm, truth = hidden_truth(seed)
    q = synthetic.random_poses(arm, POSES, seed, floor_m=0.1)
    loads = np.random.default_rng(seed).choice([0.0, max(MASSES_G) * 1e-3], size=POSES)
    table, *_ = synthetic.write(folder / "measured", synthetic.simulate(arm, truth, q, loads, NOISE_M, seed), "fetch")
    data = api.load(table, ARM)
    fitted = folder / "calibrated.toml"
    api.save(api.fit(data), data, fitted)
    return text_to_deploy(fitted)


@contextmanager
def simulated_rover(folder: Path, seed: int) -> Iterator[FetchWorld]:
    """Starts everything, and arms the arm. Raises `LrmError`."""
    path = folder / "lrmd.toml"
    servos = "\n".join(f"servo.joint{i + 1}.channel = {i}" for i in range(len(HOME)))
    values = {"arm": ARM, "state": folder / "state", "port": free_port(), "servos": servos}
    path.write_text(CONFIG.format(**values), encoding="utf-8")
    config, start = load_config(path), ",".join(f"{np.degrees(q):.6f}" for q in HOME)
    with (
        simulated_board(config, 1.0, "--dead-band-us", "0", f"--start-deg={start}") as simulated,
        daemon(simulated, 1.0),
        connected(simulated) as rover,
    ):
        _await_kinematics(rover)
        with rover.control("fetch"):
            rover.arm("given", {**{f"joint{i}": q for i, q in enumerate(HOME, start=1)}, "gripper": 0.0})
            yield FetchWorld(Path(simulated.link.port), rover, *hidden_truth(seed))


def _await_kinematics(rover: Rover) -> None:
    """Returns when the ik process answers. Raises `RequestRefused` if it does not in time."""
    end = time.monotonic() + START_TIMEOUT
    while True:
        try:
            rover.fk(FkRequest(q_rad=[list(HOME)]))
            return
        except RequestRefused as refused:
            if not refused.retryable or time.monotonic() > end:
                raise
        time.sleep(0.1)
