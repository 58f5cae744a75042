"""`python -m validation.swinging_arm.limits [--moves 8] [--pwm 50]`: what limits shaping where pulses are coarse.

The same random moves, with the shaper of the daemon and without: pulses exact or in counts of the board, put out at
every tick of the ramp or in frames of the PWM alone. Servos and swinging links are those of the simulator, without
daemon and board between.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise, product
from pathlib import Path
from tempfile import mkdtemp

import numpy as np

from lrm_math.arrays import Array
from lrm_math.model.model import model_of
from lrm_math.motion.modes import modes_at
from lrm_math.motion.shaping import Impulses, shaper
from lrmd.ramp.stepping import SHARES, Pace, move
from lrmd.sim.servo import LARGE_SERVO, SMALL_SERVO, remaining_travel
from lrmd.sim.swing import SwingingLinks
from tests.support.daemon.in_memory_daemon import config_at
from validation.options import asked
from validation.swinging_arm.rig import SPRINGS, known_model, tip_of

H, AFTER_S, REST = 0.002, 2.4, slice(100, 1100)
"""s of a step; s after a move; steps of it in which the swing counts, 0.2 to 2.2 s."""
MOST = 64


class Bench:
    """The simulated rover's arm at one PWM frequency.

    `off`: relative error of the frequencies that the shaper knows. `band`: dead band of the servos (s of pulse).
    """

    def __init__(self, pwm_hz: float, off: float = 0.0, band: float = 0.0) -> None:
        self.config = config_at(pwm_hz, Path(mkdtemp()))
        self.arm = self.config.arm
        self.servos = self.config.servos[: self.arm.dof]
        self.known = known_model(self.arm, off)
        turn = np.array(
            [abs(float(s.table.angle_of(1.5e-3 + band)) - float(s.table.angle_of(1.5e-3))) for s in self.servos]
        )
        self.bands = turn.tolist()
        self.tick, self.frame = self.config.tick * 1e-9, 1.0 / pwm_hz

    def pulses(self, q: Array) -> Array:
        """ns."""
        return np.array([servo.pulse_ns(angle) for servo, angle in zip(self.servos, q, strict=True)])

    def angles(self, pulses: Array) -> Array:
        """(M, n), rad, of pulses (M, n), ns."""
        return np.stack([np.asarray(s.table.angle_of(pulses[:, i] * 1e-9)) for i, s in enumerate(self.servos)], axis=1)

    def impulses(self, goal: Array, kind: str, grid: float) -> Impulses:
        """The daemon's shaper, its impulses on a grid (s) that is a multiple of the tick."""
        modes = modes_at(self.known, goal)
        if kind == "off" or modes is None:
            return ()
        many = max(1, round(grid / self.tick))
        found = shaper(kind, modes, many * self.tick, SHARES, MOST)  # type: ignore[arg-type]
        return tuple((many * delay, share) for delay, share in found)

    def ramp(self, start: Array, goal: Array, impulses: Impulses) -> Array:
        """(M, n), ns, after every tick."""
        a, b = (tuple(int(p) for p in self.pulses(q)) for q in (start, goal))
        way = move(a, b, (1000,) * len(a), Pace.TOGETHER, impulses)
        return np.array([way.at(k) for k in range(way.length + 1)], dtype=np.float64)

    def put_out(self, ramp: Array, counts: bool, frames: bool) -> Callable[[float], Array]:
        """Angles (rad) that the servos are sent to, by time (s)."""
        count = self.config.clock.count_s * 1e9
        pulses = np.floor(ramp / count + 0.5) * count if counts else ramp
        angles = self.angles(pulses)

        def at(t: float) -> Array:
            known = np.floor(t / self.frame) * self.frame if frames else t
            return np.asarray(angles[min(int(known / self.tick), len(angles) - 1)])

        return at

    def swing(self, start: Array, told: Callable[[float], Array], seconds: float) -> Array:
        """(M,), mm, of the tip from its rest after a command of so many seconds."""
        truth = model_of(self.arm, ())
        links = SwingingLinks(truth, SPRINGS)
        kinds = [LARGE_SERVO if i < 3 else SMALL_SERVO for i in range(self.arm.dof)]
        q, links_q, rows = told(0.0).copy(), [], []
        links.weigh(truth.chain, q, 0.0)
        for k in range(round((seconds + AFTER_S) / H)):
            goal = told(k * H)
            left = zip(goal, q, kinds, self.bands, strict=True)
            after = np.array([g - remaining_travel(g - x, H, kind, band) for g, x, kind, band in left])
            if k % 25 == 0:
                links.weigh(truth.chain, after, 0.0)
            links.follow(q, after, H)
            q = after
            rows.append(k * H >= seconds)
            links_q.append(q + links.deflection)
        tips = tip_of(self.arm, np.array(links_q))[np.array(rows)]
        return np.asarray(1e3 * np.linalg.norm(tips - tip_of(self.arm, q[None]), axis=1))


def main() -> None:
    """Prints one line for each way to put pulses out."""
    given = asked(__doc__, moves=8, pwm=50.0, seed=3)
    bench, rng = Bench(given.pwm), np.random.default_rng(given.seed)
    poses = [rng.uniform(-1.0, 1.0, bench.arm.dof) for _ in range(given.moves + 1)]
    ways = [("off", bench.tick), ("zv", bench.tick), ("zv", bench.frame), ("zvd", bench.frame)]
    for (counts, frames), (kind, grid) in product([(False, False), (True, False), (False, True), (True, True)], ways):
        found = []
        for a, b in pairwise(poses):
            ramp = bench.ramp(a, b, bench.impulses(b, kind, grid))
            away = bench.swing(a, bench.put_out(ramp, counts, frames), len(ramp) * bench.tick)
            found.append(float(np.sqrt(np.mean(away[REST] ** 2))))
        put_out = f"{'counts' if counts else 'exact'} at every {'frame' if frames else 'tick'}"
        shaped = f"{kind} on a grid of {1e3 * grid:.1f} ms: {np.mean(found):.3f} mm RMS"
        print(f"{given.pwm:.0f} Hz, {put_out}: {shaped}", flush=True)


if __name__ == "__main__":
    main()
