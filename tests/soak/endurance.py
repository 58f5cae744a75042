"""Endurance test of the daemon: `python -m tests.soak.endurance [--hours 24] [--seed 0]`.

The real controller, ramp and board run on a simulated clock, tick by tick, with a client that moves the arm at random,
and with random faults of cables, boards and processes. Every tick is checked as in the tests: no pulse outside its
limits, no step above 1 us, nothing switched on without a request. A frame is bad if the ramp could not read it, or if
the board refused it with no fault shortly before.
"""

from __future__ import annotations

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
from lrmd.control.state_machine import STATIONARY, Mode
from lrmd.messages.codec import Message
from lrmd.messages.control import ArmRequest, JogRequest, LeaseRequest, MoveRequest, RelaxRequest, ResetRequest
from tests.support.daemon.in_memory_daemon import SimulatedDaemon, config_at
from validation.options import asked
from validation.runner import refuse

SECOND = 1_000_000_000
RENEW = 20
"""Ticks between two renewals of the lease, 130 ms."""
DECIDE = 200
"""Ticks between two actions of the client, 1.3 s."""
FAULT_INTERVAL = 1000
"""Actions between two faults, on average: one in 20 minutes."""
RECOVERY = 8
"""Actions after a fault until the board may refuse nothing any more."""
JOINTS = tuple(f"joint{i}" for i in range(1, 7))


@dataclass
class EnduranceRun:
    """The simulated daemon, its client and the counts. `actions_since_fault`: actions of the client."""

    sim: SimulatedDaemon
    random: Random
    token: str = "none"
    ticks: int = 0
    actions_since_fault: int = 0
    grown_kb: int = 0
    refused: int = 0
    unexcused_refusals: int = 0
    faults: Counter[str] = field(default_factory=Counter)
    requests: Counter[str] = field(default_factory=Counter)
    event_codes: Counter[str] = field(default_factory=Counter)

    def advance(self, ticks: int) -> None:
        """Runs so many ticks. Raises `AssertionError` if an invariant is broken."""
        for _ in range(ticks):
            if self.ticks % RENEW == 0:
                self._renew()
            if self.ticks % DECIDE == 0:
                self._act()
            self.sim.tick()
            self.ticks += 1

    @property
    def bad_frames(self) -> int:
        """Frames that no fault excuses."""
        return self.sim.ramp.bad_frames + self.unexcused_refusals

    def _ask(self, request: Message) -> None:
        name = type(request).__name__.removesuffix("Request").lower()
        try:
            self.sim.core.handle(request, self.sim.now)
            self.requests[name] += 1
        except LrmError:
            self.requests[f"{name} refused"] += 1

    def _renew(self) -> None:
        with suppress(LrmError):
            self.sim.core.handle(LeaseRequest(action="renew", lease=self.token), self.sim.now)

    def _act(self) -> None:
        self._count_events()
        self._count_refused()
        core, now = self.sim.core, self.sim.now
        if core.lease is None:
            done = core.handle(LeaseRequest(action="acquire", holder="soak", take=True), now)
            self.token = done.lease.token if done.lease else "none"
        match core.mode:
            case Mode.DISARMED:
                self._ask(ArmRequest(lease=self.token, where="given", q_rad=dict.fromkeys(JOINTS, 0.0)))
            case Mode.FAULT | Mode.ESTOP:
                self._ask(ResetRequest(lease=self.token))
            case mode if mode in STATIONARY:
                self._ask(self._motion())
        if self.random.random() < 1 / FAULT_INTERVAL:
            self._inject_fault()

    def _count_refused(self) -> None:
        before, self.refused = self.refused, self.sim.ramp.board_errors
        self.actions_since_fault += 1
        if self.actions_since_fault > RECOVERY:
            self.unexcused_refusals += self.refused - before

    def _count_events(self) -> None:
        self.event_codes.update(event.code for event in self.sim.core.events)
        self.sim.core.events.clear()

    def _motion(self) -> Message:
        r = self.random
        if r.random() < 0.05:
            return JogRequest(lease=self.token, rate_rad_per_s={r.choice(JOINTS): r.uniform(-0.25, 0.25)})
        if r.random() < 0.01:
            return RelaxRequest(lease=self.token)
        waypoints = [{j: r.uniform(-1.2, 1.2) for j in JOINTS if r.random() < 0.7} or {"joint1": 0.0} for _ in range(2)]
        pace = r.choice(("together", "each"))
        return MoveRequest(lease=self.token, waypoints=waypoints, pace=pace, speed=r.choice((0.3, 1.0, 1.0)))

    def _inject_fault(self) -> None:
        name = self.random.choice(tuple(FAULTS))
        self.faults[name] += 1
        self.actions_since_fault = 0
        FAULTS[name](self.sim, self.random)


def _estop(sim: SimulatedDaemon, _: Random) -> None:
    sim.estop_requested = True
    sim.core.estop(sim.now, "soak")


def _brown_out(sim: SimulatedDaemon, _: Random) -> None:
    sim.board.power_cycle(sim.now)


def _set(name: str, most: int) -> Callable[[SimulatedDaemon, Random], None]:
    return lambda sim, random: setattr(sim, name, random.randint(1, most))


FAULTS: dict[str, Callable[[SimulatedDaemon, Random], None]] = {
    "frames lost on the way to the board": _set("lost_in", 20),
    "frames lost on the way back": _set("lost_out", 20),
    "line stalled": _set("stall", 40),
    "unplugged": _set("unplugged", 300),
    "brown-out": _brown_out,
    "ramp killed": lambda sim, _: sim.restart_ramp(),
    "ramp stopped": lambda sim, random: sim.stop_ramp(random.randint(1, 2 * SECOND)),
    "emergency stop": _estop,
}


def resident_kb() -> int:
    """Resident memory of this process (kB) after garbage collection."""
    gc.collect()
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * 4


def run_endurance(hours: float, seed: int, report: Callable[[str], None]) -> EnduranceRun:
    """Runs for so many simulated hours with progress reports. Raises `AssertionError` if an invariant is broken."""
    with tempfile.TemporaryDirectory() as folder:
        run = EnduranceRun(SimulatedDaemon(config_at(330.0, Path(folder)), seed=seed), Random(seed))
    tick = run.sim.config.tick
    run.sim.torque = (0.0, 0.3, 0.2, 0.1, 0.1, 0.0)
    total = round(hours * 3600 * SECOND / tick)
    part = max(1, total // 24)
    run.advance(min(DECIDE, total))
    start, first = time.perf_counter(), resident_kb()
    while run.ticks < total:
        run.advance(min(part, total - run.ticks))
        now = resident_kb()
        rate = run.ticks / (time.perf_counter() - start)
        report(
            f"{run.ticks * tick / SECOND / 3600:6.2f} h  {run.ticks:>9} ticks  {rate:,.0f} ticks/s  "
            f"{run.refused} refused, {run.bad_frames} bad  largest step {run.sim.largest_step * 1e6:.2f} us  "
            f"{now / 1024:.1f} MB ({(now - first) / 1024:+.2f})"
        )
    run.grown_kb = resident_kb() - first
    return run


def main() -> int:
    """Prints the counts; exit code 1 if an invariant was broken or a frame was bad."""
    options = asked(__doc__, hours=(24.0, "simulated"), seed=0)
    if not options.hours > 0.0:
        refuse("--hours should be above 0")
    try:
        run = run_endurance(options.hours, options.seed, lambda line: print(line, flush=True))
    except AssertionError as error:
        print(f"an invariant was broken: {error}", file=sys.stderr)
        return 1
    for title, counts in (("requests", run.requests), ("faults", run.faults), ("events", run.event_codes)):
        print(f"{title}: " + ", ".join(f"{name} {n}" for name, n in counts.most_common()))
    growth = run.grown_kb / 1024
    print(f"{run.ticks} ticks, {run.bad_frames} bad frames, {growth:+.2f} MB (goal: 13.3 million, 0, at most 2 MB)")
    return 1 if run.bad_frames else 0


if __name__ == "__main__":
    sys.exit(main())
