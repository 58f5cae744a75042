"""A simulated rover: board on a pty, daemon, an arm with hidden errors, and what it is calibrated by."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from examples.demo.simulated_tracker import BoardState, true_tip
from examples.fetch.distance_check import DistanceResult, PermittedTime, check, ticks_of
from examples.fetch.places import ARM, HOME, MASSES_G, TOUCHING, Stone
from examples.fetch.recording import recorded, thinned, true_tips
from lrm_ident.study import api
from lrm_math.arrays import Array, Vector3
from lrmd.client import RequestRefused, Rover
from lrmd.client.model_text import text_to_deploy
from lrmd.config import Config, load_config
from lrmd.demo import START_TIMEOUT, connected, daemon, free_port
from lrmd.messages.kinematics import FkRequest
from lrmd.sim.control_socket import query_board
from lrmd.sim.launch import simulated_board
from validation import synthetic

ARM_FILE = Path(__file__).resolve().parents[2] / "config" / "arms" / f"{ARM}.toml"
ADOPTED_S, FEEL_S, AGAIN_S = 1.5, 0.1, 5.0
"""s until a direction of gravity is adopted, between two looks of the switch in the fingers, and for which a
lease that was lost may be taken anew."""
POSES, NOISE_M = 150, 0.0005
"""Measured positions of the calibration, and the spread of each coordinate (m)."""
CONFIG = """\
schema = "lrm/daemon/1"
robot = "fetch"
arm = "{arm}"
link = {{ port = "simulated", pwm_hz = 330.0, silence_ms = 10000, reply_ms = 4900 }}
ramp = {{ step_us = 10.0 }}
safety = {{ stagger_ms = 50, lease_ms = 500 }}
gravity = {{ max_age_s = 3600 }}
state = {{ directory = "{state}" }}
zenoh = {{ listen = ["tcp/127.0.0.1:{port}"] }}
{servos}
servo.gripper.channel = 6
"""


@dataclass(frozen=True)
class FetchWorld:
    """A simulated rover: the link of its `board`, a client, and the true arm. `log`: every frame of the board;
    `permitted`: when the fingers were permitted to touch the ground, and where. `again`: skills that were asked for
    again, as the computer was too busy. `notes`: what happened, `loads`: of the gripper (kg), `grounds`: gravity
    (m/s²) on each, all from a time (s)."""

    board: Path
    rover: Rover
    arm: synthetic.ArmDescription
    truth: synthetic.GroundTruth
    config: Config
    log: Path
    permitted: list[PermittedTime] = field(default_factory=list)
    again: list[str] = field(default_factory=list)
    notes: list[tuple[float, str]] = field(default_factory=list)
    loads: list[tuple[float, float]] = field(default_factory=list)
    grounds: list[tuple[float, Vector3]] = field(default_factory=list)

    def under(self, stone: Stone) -> FetchWorld:
        """The rover on the ground of a stone, whose slope its accelerometer tells."""
        self.rover.tell_gravity(stone.gravity)
        time.sleep(ADOPTED_S)
        x, y, z = stone.gravity
        self.grounds.append((self.time(), (x, y, z)))
        return replace(self, arm=replace(self.arm, gravity_m_per_s2=(x, y, z)))

    @contextmanager
    def touching(self, stone: Stone) -> Iterator[None]:
        """While it may touch the ground at a stone, a switch in the fingers tells of it."""
        start, ended = self.time(), threading.Event()
        switch = threading.Thread(target=self._feel, args=(ended,))
        switch.start()
        try:
            yield
        finally:
            ended.set()
            switch.join()
            contact = stone.contacts()[0]
            low, high = np.array(contact.low_m), np.array(contact.high_m)
            self.permitted.append(PermittedTime(start, self.time(), low, high, TOUCHING))

    def _feel(self, ended: threading.Event) -> None:
        while not ended.wait(FEEL_S):
            if self.tip()[2] < 0.0:
                self.rover.tell_sensed("touch")

    def put_down(self) -> None:
        """Nothing is in the gripper any more; asked again where a lease that was lost is just being taken anew."""
        self.load(0.0)
        end = time.monotonic() + AGAIN_S
        while True:
            try:
                self.rover.carry(0.0)
                return
            except RequestRefused as refused:
                if not refused.retryable or time.monotonic() > end:
                    raise
            time.sleep(FEEL_S)

    def time(self) -> float:
        """The board's clock (s)."""
        return float(str(query_board(self.board, "status")["t_s"]))

    def distances(self) -> DistanceResult:
        """How near bodies came, in every tick so far."""
        servo = self.config.servos[0].table
        count = self.config.clock.count_s * float(np.ptp(servo.angle) / np.ptp(servo.pulse))
        return check(ARM_FILE, *ticks_of(self.log, self.config), self.permitted, abs(count))

    def note(self, text: str) -> None:
        """Notes what happens now."""
        self.notes.append((self.time(), text))

    def recording(self, stones: Sequence[Stone]) -> bytes:
        """The run so far as an MCAP file. Raises `LrmError`: mcap is not installed."""
        t, q = ticks_of(self.log, self.config)
        some = thinned(t)
        tips = true_tips(self.arm, self.truth, t[some], q[some], self.loads, self.grounds)
        return recorded(ARM_FILE, t[some], q[some], tips, self.notes, stones)

    def tip(self) -> Array:
        """(3,), where the tip really is (m)."""
        return true_tip(self.arm, self.truth, BoardState.of(self.board, len(HOME)))

    def load(self, mass: float) -> None:
        """Puts a mass (kg) into the gripper, or takes it out."""
        self.loads.append((self.time(), mass))
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
    log = folder / "board.csv"
    config, start = load_config(path), ",".join(f"{np.degrees(q):.6f}" for q in HOME)
    with (
        simulated_board(config, 1.0, "--dead-band-us", "0", f"--start-deg={start}", "--log", str(log)) as simulated,
        daemon(simulated, 1.0),
        connected(simulated) as rover,
    ):
        _await_kinematics(rover)
        with rover.control("fetch"):
            rover.arm("given", {**{f"joint{i}": q for i, q in enumerate(HOME, start=1)}, "gripper": 0.0})
            yield FetchWorld(Path(simulated.link.port), rover, *hidden_truth(seed), simulated, log)


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
