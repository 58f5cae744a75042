"""A day of the daemon's life: `python -m tests.soak.endurance [--hours 24] [--seed 0]`.

The real core, ramp and board live on a simulated clock, tick by tick, with a client that moves the arm at random and
with everything that happens to cables, boards and processes now and then. Every tick is checked as in the tests: no
pulse outside its limits, no step above 1 us, nothing switched on unasked. A frame is bad if the ramp could not read it,
or if the board refused it though there was no trouble lately.
"""

from __future__ import annotations

import argparse
import gc
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from lrm_math.errors import LrmError
from lrmd.control.state_machine import STANDING, Mode
from lrmd.messages.control import ArmRequest, JogRequest, LeaseRequest, Message, MoveRequest, RelaxRequest, ResetRequest
from tests.support.in_memory_daemon import World, config_at

SECOND = 1_000_000_000
RENEW = 20
"""Ticks between two signs of life of the client, 130 ms."""
DECIDE = 200
"""Ticks between two decisions of the client, 1.3 s."""
TROUBLE = 1000
"""Decisions between two troubles, on average: one in 20 minutes."""
CALM = 8
"""Decisions after a trouble until the board may refuse nothing any more."""
JOINTS = tuple(f"joint{i}" for i in range(1, 7))


@dataclass
class Soak:
    """The world, its client and what was counted. `lived`: ticks; `calm`: decisions since the last trouble."""

    world: World
    random: Random
    token: str = "none"
    lived: int = 0
    calm: int = 0
    grown_kb: int = 0
    refused: int = 0
    refused_in_calm: int = 0
    trouble: Counter[str] = field(default_factory=Counter)
    asked: Counter[str] = field(default_factory=Counter)
    happened: Counter[str] = field(default_factory=Counter)

    def run(self, ticks: int) -> None:
        """Lives on for so many ticks. Raises `AssertionError` if a law is broken."""
        for _ in range(ticks):
            if self.lived % RENEW == 0:
                self._renew()
            if self.lived % DECIDE == 0:
                self._decide()
            self.world.tick()
            self.lived += 1

    @property
    def bad_frames(self) -> int:
        """Frames that no trouble excuses."""
        return self.world.ramp.bad_frames + self.refused_in_calm

    def _ask(self, request: Message) -> None:
        name = type(request).__name__.removesuffix("Request").lower()
        try:
            self.world.core.handle(request, self.world.now)
            self.asked[name] += 1
        except LrmError:
            self.asked[f"{name} refused"] += 1

    def _renew(self) -> None:
        with suppress(LrmError):
            self.world.core.handle(LeaseRequest(action="renew", lease=self.token), self.world.now)

    def _decide(self) -> None:
        self._listen()
        self._count_refused()
        core, now = self.world.core, self.world.now
        if core.lease is None:
            done = core.handle(LeaseRequest(action="acquire", holder="soak", take=True), now)
            self.token = done.lease.token if done.lease else "none"
        match core.mode:
            case Mode.DISARMED:
                self._ask(ArmRequest(lease=self.token, where="given", q_rad=dict.fromkeys(JOINTS, 0.0)))
            case Mode.FAULT | Mode.ESTOP:
                self._ask(ResetRequest(lease=self.token))
            case mode if mode in STANDING:
                self._ask(self._motion())
        if self.random.random() < 1 / TROUBLE:
            self._disturb()

    def _count_refused(self) -> None:
        before, self.refused = self.refused, self.world.ramp.board_errors
        self.calm += 1
        if self.calm > CALM:
            self.refused_in_calm += self.refused - before

    def _listen(self) -> None:
        self.happened.update(h.code for h in self.world.core.happenings)
        self.world.core.happenings.clear()

    def _motion(self) -> Message:
        r = self.random
        if r.random() < 0.05:
            return JogRequest(lease=self.token, rate_rad_per_s={r.choice(JOINTS): r.uniform(-0.25, 0.25)})
        if r.random() < 0.01:
            return RelaxRequest(lease=self.token)
        way = [{j: r.uniform(-1.2, 1.2) for j in JOINTS if r.random() < 0.7} or {"joint1": 0.0} for _ in range(2)]
        pace = r.choice(("together", "each"))
        return MoveRequest(lease=self.token, waypoints=way, pace=pace, speed=r.choice((0.3, 1.0, 1.0)))

    def _disturb(self) -> None:
        name = self.random.choice(tuple(TROUBLES))
        self.trouble[name] += 1
        self.calm = 0
        TROUBLES[name](self.world, self.random)


def _estop(world: World, _: Random) -> None:
    world.rung = True
    world.core.estop(world.now, "soak")


def _brown_out(world: World, _: Random) -> None:
    world.board.power_cycle(world.now)


def _set(name: str, most: int) -> Callable[[World, Random], None]:
    return lambda world, random: setattr(world, name, random.randint(1, most))


TROUBLES: dict[str, Callable[[World, Random], None]] = {
    "frames lost on the way to the board": _set("lost_in", 20),
    "frames lost on the way back": _set("lost_out", 20),
    "line stalled": _set("stall", 40),
    "unplugged": _set("unplugged", 300),
    "brown-out": _brown_out,
    "ramp killed": lambda world, _: world.restart_ramp(),
    "ramp stopped": lambda world, random: world.stop_ramp(random.randint(1, 2 * SECOND)),
    "emergency stop": _estop,
}


def resident_kb() -> int:
    """Memory (kB) that this process has in RAM, after all garbage is gone."""
    gc.collect()
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * 4


def soak(hours: float, seed: int, say: Callable[[str], None]) -> Soak:
    """Lives for so many simulated hours and says how it goes. Raises `AssertionError` if a law is broken."""
    with tempfile.TemporaryDirectory() as folder:
        life = Soak(World(config_at(330.0, Path(folder)), seed=seed), Random(seed))
    tick = life.world.config.tick
    life.world.torque = (0.0, 0.3, 0.2, 0.1, 0.1, 0.0)
    total = round(hours * 3600 * SECOND / tick)
    part = max(1, total // 24)
    life.run(min(DECIDE, total))
    start, first = time.perf_counter(), resident_kb()
    while life.lived < total:
        life.run(min(part, total - life.lived))
        now = resident_kb()
        rate = life.lived / (time.perf_counter() - start)
        say(
            f"{life.lived * tick / SECOND / 3600:6.2f} h  {life.lived:>9} ticks  {rate:,.0f} ticks/s  "
            f"{life.refused} refused, {life.bad_frames} bad  largest step {life.world.largest_step * 1e6:.2f} us  "
            f"{now / 1024:.1f} MB ({(now - first) / 1024:+.2f})"
        )
    life.grown_kb = resident_kb() - first
    return life


def main() -> int:
    """Prints the figures; exit code 1 if a law was broken or a frame was bad."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--hours", type=float, default=24.0, help="simulated (default: %(default)s)")
    p.add_argument("--seed", type=int, default=0)
    options = p.parse_args()
    try:
        life = soak(options.hours, options.seed, lambda line: print(line, flush=True))
    except AssertionError as error:
        print(f"a law was broken: {error}", file=sys.stderr)
        return 1
    for title, counts in (("asked", life.asked), ("troubles", life.trouble), ("told", life.happened)):
        print(f"{title}: " + ", ".join(f"{name} {n}" for name, n in counts.most_common()))
    growth = life.grown_kb / 1024
    print(f"{life.lived} ticks, {life.bad_frames} bad frames, {growth:+.2f} MB (goal: 13.3 million, 0, at most 2 MB)")
    return 1 if life.bad_frames else 0


if __name__ == "__main__":
    sys.exit(main())
