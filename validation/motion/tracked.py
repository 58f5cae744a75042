"""A log of commands and a tracker's recording of the simulated rover's arm, which may swing: by two clocks.

The arm is `lrmd.sim`'s, behind the daemon's ramp and the board; the tracker stands anywhere, and its body is not at the
tip. `python -m validation.motion.tracked FOLDER [--pwm 330] [--seconds 150]` writes log.csv and tip.csv.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from lrm_math.arrays import Array
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.forward import chain_geometry
from lrm_math.model.model import model_of
from lrmd.sim.arm import SimulatedArm
from lrmd.sim.swing import JointSpring
from validation.options import asked
from validation.swinging_arm.rig import FRAME_TICKS, SPRINGS, SwingingRover

LOG_TICKS = 3
CLOCK_S = 1234.567
"""s that the tracker's clock is before the daemon's."""
BODY_M = np.array([0.012, -0.02, 0.03])
SHIFT_M = np.array([0.8, -0.3, 0.2])
REST_S = (0.6, 1.6)
NOISE_M = 0.0003


def tracked(
    seconds: float, pwm_hz: float, seed: int, springs: Mapping[str, JointSpring] = SPRINGS, noise: float = NOISE_M
) -> tuple[Array, Array, float]:
    """Rows t_s, q1 … qn (rad) of the log, rows t_s, x, y, z (m) of the tracker, and a count of the board (s)."""
    rover, rng = SwingingRover(pwm_hz), np.random.default_rng(seed)
    channels = {s.name: s.channel for s in rover.config.servos if s.name in rover.arm.joint_names}
    rover.links = SimulatedArm(model_of(rover.arm, ()), channels, springs=springs)
    rover.pass_ticks(2000)
    log, stands, times = [], [], []

    def pass_ticks(count: int) -> None:
        daemon = rover.daemon
        for _ in range(count):
            SwingingRover.pass_ticks(rover, 1)
            if daemon.ticks % LOG_TICKS == 0:
                log.append((rover.now(), *daemon.core.angles(daemon.ramp.position)[: rover.arm.dof]))
            if daemon.ticks % FRAME_TICKS == 0:
                times.append(rover.now())
                stands.append(rover.links.link_angles)

    rover.pass_ticks = pass_ticks  # type: ignore[method-assign]
    begun, q = rover.now(), np.zeros(rover.arm.dof)
    while rover.now() - begun < seconds:
        near = np.clip(q + rng.uniform(-0.6, 0.6, rover.arm.dof), -1.0, 1.0)
        q = np.where(rng.random(rover.arm.dof) < 0.3, q, near)
        rover.move(q)
        pass_ticks(round(rng.uniform(*REST_S) / rover.tick_s))
    return np.array(log), _seen(rover, np.array(times), np.array(stands), rng, noise), rover.config.clock.count_s


def _seen(rover: SwingingRover, t: Array, q: Array, rng: np.random.Generator, noise: float) -> Array:
    chain = chain_of(rover.arm)
    tool = chain_geometry(chain, chain.values(list(q.T)), len(q)).tool
    at = tool[3].T + np.einsum("ikn,i->nk", tool[:3], BODY_M)
    a, b = 0.7, -0.4
    turn = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]]) @ np.array(
        [[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]]
    )
    return np.column_stack([t + CLOCK_S, at @ turn.T + SHIFT_M + rng.normal(scale=noise, size=at.shape)])


def write(folder: Path, log: Array, tip: Array, count_s: float) -> tuple[Path, Path]:
    """log.csv with its log.toml, and tip.csv, as `lrm record` and `lrm-ident motion track` write them."""
    folder.mkdir(parents=True, exist_ok=True)
    n = log.shape[1] - 1
    logged, seen = folder / "log.csv", folder / "tip.csv"
    rows = np.column_stack([log[:, 0], np.degrees(log[:, 1:])])
    head = ",".join(["t_s", *(f"q{k + 1}_deg" for k in range(n))])
    np.savetxt(logged, rows, "%.5f", ",", header=head, comments="")
    (folder / "log.toml").write_text(
        f'schema = "lrm/command-log/1"\narm = "lrm-rover"\ncount_us = {1e6 * count_s:.6f}\n'
    )
    np.savetxt(seen, tip * [1.0, 1e3, 1e3, 1e3], "%.4f", ",", header="t_s,x_mm,y_mm,z_mm", comments="")
    return logged, seen


def main() -> None:
    """Writes one recording."""
    given = asked(__doc__, "folder", pwm=330.0, seconds=150.0, seed=0)
    for path in write(given.folder, *tracked(given.seconds, given.pwm, given.seed)):
        print(path)


if __name__ == "__main__":
    main()
