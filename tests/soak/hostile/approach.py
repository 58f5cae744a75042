"""A client without scruples: it drives the arm at obstacles by jogs and short moves, or dies while the arm moves.

What it brought about is read from the frames that reached the board, by a decoder of its own.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import msgpack
import numpy as np
import zenoh

from lrm_math.arrays import Array
from lrm_math.collision.scene import Scene
from lrm_math.collision.straight_move import check_path, rigid_bodies
from lrmd.config import Config, load_config
from tests.soak.hostile.estop_client import foreign
from tests.soak.hostile.trial import Trial
from tests.support.background import repeated
from tests.support.daemon.daemon_process import ROOT, wait_for
from tests.support.daemon.pulse_invariants import read_frames

ROUNDING = 2e-3
"""m: by which the board's counts, rounded, may bring a body nearer than the command does."""
MOVER = """
import sys, time, msgpack, zenoh
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", '["' + sys.argv[1] + '"]')
config.insert_json5("scouting/multicast/enabled", "false")
with zenoh.open(config) as session:
    def ask(tail, **fields):
        for reply in session.get("lrm/rover/" + tail, payload=msgpack.packb({"v": 1, **fields}), timeout=5.0):
            if reply.ok is None:
                sys.exit("refused: " + str(msgpack.unpackb(reply.err.payload.to_bytes())))
            return msgpack.unpackb(reply.ok.payload.to_bytes())
    lease = ask("rpc/lease", action="acquire", holder="dying", take=True)["lease"]
    ask("rpc/move", lease=lease, waypoints=[{"joint1": float(sys.argv[2])}])
    print("moving", flush=True)
    time.sleep(60)
"""


class Stranger:
    """A zenoh session that packs its own messages. `lease`: its token."""

    def __init__(self, trial: Trial, session: zenoh.Session) -> None:
        self._trial, self._session = trial, session
        self.config = load_config(trial.setup.config)
        self.scene, self.lease = Scene.of(self.config.arm), ""

    def ask(self, tail: str, **fields: Any) -> dict[str, Any] | None:
        """The reply's fields, None for an error reply."""
        data = msgpack.packb({"v": 1, **fields})
        for reply in self._session.get(self._trial.setup.key(tail), payload=data, timeout=5.0):
            if reply.ok is not None:
                return dict(msgpack.unpackb(reply.ok.payload.to_bytes()))
        return None

    def put(self, tail: str, **fields: Any) -> None:
        """A command, which has no reply."""
        self._session.put(self._trial.setup.key(tail), msgpack.packb({"v": 1, **fields}), express=True)

    def take(self) -> None:
        """Takes the lease over, or renews it."""
        if self.lease and self.ask("rpc/lease", action="renew", lease=self.lease):
            return
        taken = self.ask("rpc/lease", action="acquire", holder="stranger", take=True)
        self.lease = taken["lease"]

    def commanded(self) -> Array:
        """(n,), commanded angles (rad)."""
        state = self.ask("state/joints")
        return np.array(state["q_rad"][: self.config.dof])

    def named(self, q: Array) -> dict[str, float]:
        """Angles by joint."""
        return {name: float(angle) for name, angle in zip(self.config.names, q, strict=False)}

    def inward(self, q: Array) -> Array:
        """The direction of the joints in which the smallest distance falls fastest; largest component 1."""
        near = [self.distances(q + 1e-4 * np.outer([-1, 1], e)) for e in np.eye(len(q))]
        slope = np.array([float(b - a) for a, b in near])
        return -slope / max(float(np.abs(slope).max()), 1e-12)

    def distances(self, q: Array) -> Array:
        """(N,), smallest distance (m) of two bodies in poses (N, n)."""
        return np.asarray(self.scene.separations(self.scene.frames(q)).min(axis=1))

    def go_near(self) -> None:
        """Moves home, then to a pose with 5 to 15 mm more than the margin, and waits until it is there."""
        home, rng = np.zeros(self.config.dof), np.random.default_rng(1)
        some = rng.uniform(-0.9, 0.9, (4000, len(home)))
        spare = self.distances(some) - self.scene.margin
        near = some[(spare > 5e-3) & (spare < 15e-3)]
        bodies = rigid_bodies(self.scene)
        q = next(q for q in near if check_path(bodies, np.array([home, q]), self.scene.margin)[0].free)
        with self.renewed():  # on a busy machine the reply to a move, which predicts its swing, outlasts a lease
            moved = self.ask("rpc/move", lease=self.lease, waypoints=[self.named(home), self.named(q)])
            assert moved is not None, "the arm goes home and near the obstacle"

            def arrived() -> bool:
                return float(np.abs(self.commanded() - q).max()) < 1e-4

            wait_for(arrived, "the arm is near the obstacle", seconds=60.0, pause=0.1)

    @contextmanager
    def renewed(self) -> Iterator[None]:
        """Takes the lease, and renews it meanwhile."""
        self.take()
        with repeated(self.take, 0.1):
            yield


@contextmanager
def stranger(trial: Trial) -> Iterator[Stranger]:
    """A stranger at a daemon whose own client keeps still."""
    with trial.alone(), zenoh.open(foreign(trial.setup.endpoint)) as session:
        yield Stranger(trial, session)


def renewed_jog(trial: Trial, seconds: float) -> None:
    """A jog towards the nearest obstacle, every 100 ms without end: nothing comes within the margin."""
    with stranger(trial) as client:
        client.go_near()
        begun, end = _board_time(trial), time.monotonic() + max(seconds, 4.0)
        while time.monotonic() < end:
            client.take()
            rates = 0.28 * client.inward(client.commanded())
            client.put("cmd/jog", lease=client.lease, rate_rad_per_s=client.named(rates))
            time.sleep(0.1)
        _check_distance(trial, client, begun)


def short_moves(trial: Trial, seconds: float) -> None:
    """Many short moves towards the nearest obstacle: nothing comes within the margin."""
    with stranger(trial) as client:
        client.go_near()
        begun, end = _board_time(trial), time.monotonic() + max(seconds, 4.0)
        while time.monotonic() < end:
            client.take()
            here = client.commanded()
            goal = client.named(here + 2e-3 * client.inward(here))
            client.ask("rpc/move", lease=client.lease, waypoints=[goal])
            time.sleep(0.05)
        _check_distance(trial, client, begun)


def waiting_client(trial: Trial, seconds: float) -> None:
    """A client is killed while the arm moves, and another one waits for the lease: the motion stops, and it is said."""
    end, sign = time.monotonic() + seconds, 1.0
    while True:
        with stranger(trial) as waiting:
            lost = _ends_of(trial, "dying")
            command = [sys.executable, "-c", MOVER, trial.setup.endpoint, str(sign * 0.9)]
            with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as dying:
                assert dying.stdout.readline() == "moving\n", "the client that is to die moves the arm"
                time.sleep(0.3)
                dying.kill()
            while waiting.ask("rpc/lease", action="acquire", holder="waiting") is None:
                pass
            time.sleep(0.1)
            before = waiting.commanded()
            time.sleep(0.3)
            assert np.array_equal(before, waiting.commanded()), "the motion went on under the next client"
            mode = waiting.ask("state/mode")
            assert (mode["mode"], mode["why"]) == ("holding", "lease lost")
            assert _ends_of(trial, "dying") == lost + 1
        sign = -sign
        if time.monotonic() > end:
            return


def _ends_of(trial: Trial, holder: str) -> int:
    """How often the daemon has said that the lease of a holder was lost."""
    entries = (entry for entry in trial.daemon.log_entries() if entry["event"] == "lease_lost")
    return sum(str(entry["text"]).startswith(holder) for entry in entries)


def _board_time(trial: Trial) -> int:
    return time.monotonic_ns() - trial.board_started


def _check_distance(trial: Trial, client: Stranger, since: int) -> None:
    """Asserts the guard's law over all frames that the board got since a time (its ns)."""
    poses = [_angles(client.config, line.counts) for line in read_frames(trial.board.setup.log) if line.t >= since]
    poses = [q for q in poses if q is not None]
    assert poses, "the board got frames"
    visited = np.unique(np.array(poses), axis=0)
    least = min(float(client.distances(visited[i : i + 400]).min()) for i in range(0, len(visited), 400))
    assert least >= client.scene.margin - ROUNDING, f"bodies came to {least * 1e3:.1f} mm of each other"


def _angles(config: Config, counts: dict[int, int]) -> list[float] | None:
    """Angles (rad) of all joints by counts of the board, None if one of them is off."""
    servos = config.servos[: config.dof]
    if any(not counts.get(servo.channel) for servo in servos):
        return None
    return [servo.angle(round(counts[servo.channel] * config.clock.count_s * 1e9)) for servo in servos]
