"""A log of commands and a tracker's recording of the simulated rover, whose arm swings: by two clocks.

The tracker stands anywhere, and its body is not at the tip.
`python -m validation.motion.tracked FOLDER [--pwm 330] [--seconds 150]` writes log.csv and tip.csv.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lrm_ident.measuring.recordings.command_log import LOG_SCHEMA
from lrm_math.arrays import Array
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.forward import chain_geometry
from validation.options import asked
from validation.swinging_arm.rig import SwingingRover
from validation.synthetic.screws import rotation_matrix

LOG_TICKS, FRAME_TICKS = 3, 2
"""Ticks between rows of the log, and between frames of the tracker (13 ms at 77 frames a second)."""
CLOCK_S = 1234.567
"""s that the tracker's clock is before the daemon's."""
BODY_M, SHIFT_M = np.array([0.012, -0.02, 0.03]), np.array([0.8, -0.3, 0.2])
TURN = rotation_matrix([0.0, 0.0, 0.7]) @ rotation_matrix([-0.4, 0.0, 0.0])
REST_S, NOISE_M = (0.6, 1.6), 0.0003


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
    at = tool[3].T + np.einsum("ikn,i->nk", tool[:3], BODY_M)
    return np.column_stack([t + CLOCK_S, at @ TURN.T + SHIFT_M + rng.normal(scale=NOISE_M, size=at.shape)])


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
