"""Logs of commands and recordings of a tracker, by two clocks: of the simulated rover, and of the independent world.

The tracker stands anywhere, and its body is not at the tip. The arm of the simulated rover swings.
`python -m validation.motion.tracked FOLDER [--pwm 330] [--seconds 150]` writes log.csv and tip.csv.
"""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from lrm_ident.measuring.recordings.command_log import LOG_SCHEMA, CommandLog
from lrm_ident.measuring.recordings.take import TipTrack
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.forward import chain_geometry
from validation.motion.world import ROVER, TrueJoints, followed, tour
from validation.options import asked
from validation.swinging_arm.rig import SwingingRover
from validation.synthetic.chain import forward_kinematics
from validation.synthetic.screws import rotation_matrix

LOG_TICKS, FRAME_TICKS = 3, 2
"""Ticks between rows of the log, and between frames of the tracker (13 ms at 77 frames a second)."""
CLOCK_S = 1234.567
"""s that the tracker's clock is before the daemon's."""
BODY_M, SHIFT_M = np.array([0.012, -0.02, 0.03]), np.array([0.8, -0.3, 0.2])
TURN = rotation_matrix([0.0, 0.0, 0.7]) @ rotation_matrix([-0.4, 0.0, 0.0])
REST_S, NOISE_M = (0.6, 1.6), 0.0003
RATE, TRACKER_HZ, STEPS, TOUR_S = 50.0, 77.0, 13, 96.0
"""Rows of a log and frames of a tracker in a second, steps of the world to a frame, and s of a recording."""
COUNT_US = 1e6 / (330.0 * 4096.0)
"""Of a board at 330 Hz."""


class TrackedRover(SwingingRover):
    """Its commands and the angles of its links, each with the daemon's time (s, rad), in the order of time."""

    def __post_init__(self) -> None:
        self.commands, self.angles = list[tuple[float, ...]](), list[tuple[float, ...]]()
        super().__post_init__()
        self.commands.clear()
        self.angles.clear()

    def pass_ticks(self, count: int) -> None:
        daemon = self.daemon
        for _ in range(count):
            super().pass_ticks(1)
            if daemon.ticks % LOG_TICKS == 0:
                self.commands.append((self.now(), *daemon.core.angles(daemon.ramp.position)[: self.arm.dof]))
            if daemon.ticks % FRAME_TICKS == 0:
                self.angles.append((self.now(), *self.links.link_angles))

    def now(self) -> float:
        """s, by the daemon's clock."""
        return self.daemon.now * 1e-9


def tracked(seconds: float, pwm_hz: float, rng: np.random.Generator) -> TrackedRover:
    """A rover that has moved for so long from posture to posture, with rests."""
    rover = TrackedRover(pwm_hz)
    begun, q = rover.now(), np.zeros(rover.arm.dof)
    while rover.now() - begun < seconds:
        near = np.clip(q + rng.uniform(-0.6, 0.6, rover.arm.dof), -1.0, 1.0)
        q = np.where(rng.random(rover.arm.dof) < 0.3, q, near)
        rover.move(q)
        rover.pass_ticks(round(rng.uniform(*REST_S) / rover.tick_s))
    return rover


def seen(rover: TrackedRover, rng: np.random.Generator) -> Array:
    """Rows t_s, x, y, z (m) of the tracker."""
    chain, (t, *q) = chain_of(rover.arm), np.array(rover.angles).T
    tool = chain_geometry(chain, chain.values(q), len(t)).tool
    return np.column_stack([t + CLOCK_S, _in_room(tool[3].T + np.einsum("ikn,i->nk", tool[:3], BODY_M), rng)])


def _in_room(at: Array, rng: np.random.Generator) -> Array:
    """(N, 3), m, as the tracker reads a body at points (N, 3) of the arm's frame."""
    return np.asarray(at @ TURN.T + SHIFT_M + rng.normal(scale=NOISE_M, size=at.shape))


def toured(arms: Sequence[TrueJoints], rng: np.random.Generator) -> list[tuple[CommandLog, TipTrack]]:
    """What is logged and tracked of each arm of the independent world: one tour from posture to posture."""
    n, h = len(ROVER.described.links), 1.0 / TRACKER_HZ / STEPS
    rows = [tour(rng, n, RATE, TOUR_S, REST_S) for _ in arms]
    t, steps = np.arange(len(rows[0])) / RATE, h * np.arange(int((len(rows[0]) - 1) / RATE / h))
    told = np.stack([_put_out(np.stack([np.interp(steps, t, column) for column in q.T], axis=1)) for q in rows])
    angle = followed(ROVER, arms, told, np.zeros((len(arms), 1)), STEPS, h)
    out = []
    for q, arm, reached in zip(rows, arms, angle, strict=True):
        posture = forward_kinematics(ROVER.chain, np.zeros(len(reached)), reached + arm.offset, {})
        tip = _in_room(posture.tcp + posture.tool_axes @ BODY_M, rng)
        log = CommandLog(Path("log.csv"), load_arm("lrm-rover"), t, q, 1e-6 * COUNT_US)
        out.append((log, TipTrack(Path("tip.csv"), CLOCK_S + np.arange(len(tip)) / TRACKER_HZ, tip)))
    return out


def _put_out(q: Array) -> Array:
    """Angles (N, n), rad, that servos are led to by pulses of whole counts."""
    file = Path(__file__).resolve().parents[2] / "config" / "arms" / "lrm-rover.toml"
    out = np.empty_like(q)
    for number, joint in enumerate(tomllib.loads(file.read_text(encoding="utf-8"))["joint"]):
        angle, pulse = np.radians(joint["servo"]["angle_deg"]), np.array(joint["servo"]["pulse_us"])
        counts = np.floor(np.interp(q[:, number], angle, pulse) / COUNT_US + 0.5)
        out[:, number] = np.interp(counts * COUNT_US, pulse, angle)
    return out


def write(folder: Path, rover: TrackedRover, tip: Array) -> None:
    """log.csv with its log.toml, and tip.csv, as `lrm record` and `lrm-ident motion track` write them."""
    folder.mkdir(parents=True, exist_ok=True)
    log = np.array(rover.commands) * [1.0, *[np.degrees(1.0)] * rover.arm.dof]
    head = ",".join(["t_s", *(f"q{k + 1}_deg" for k in range(rover.arm.dof))])
    np.savetxt(folder / "log.csv", log, "%.5f", ",", header=head, comments="")
    count_us = 1e6 * rover.config.clock.count_s
    (folder / "log.toml").write_text(f'schema = "{LOG_SCHEMA}"\narm = "lrm-rover"\ncount_us = {count_us:.6f}\n')
    np.savetxt(folder / "tip.csv", tip * [1.0, 1e3, 1e3, 1e3], "%.4f", ",", header="t_s,x_mm,y_mm,z_mm", comments="")


def main() -> None:
    """Writes one recording."""
    given = asked(__doc__, "folder", pwm=330.0, seconds=150.0, seed=0)
    rng = np.random.default_rng(given.seed)
    rover = tracked(given.seconds, given.pwm, rng)
    write(given.folder, rover, seen(rover, rng))


if __name__ == "__main__":
    main()
