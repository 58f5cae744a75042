"""Delay of the emergency stop beside every flood, on a loaded machine, from the request to the frame without pulses: as
the ramp hands it to the serial port, and as the simulated board reads it, through a pseudo-terminal.

`python -m tests.soak.hostile.estop_beside_floods [--stops N] [--loops 2 8] [--only WORD]` prints the table of
docs/results-driving.md. The load is made by busy loops; the load average is said with each row.
"""

from __future__ import annotations

import argparse
import math
import os
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from tests.soak.hostile.estop_client import EstopClient
from tests.soak.hostile.flood import FLOODS, flooded
from tests.soak.hostile.trial import Trial, trial
from tests.support.daemon.daemon_process import WaitTimeout, wait_for
from tests.support.daemon.pulse_ends import PulseEnds, delays_until

NONE = "none"
HEAD = (
    "| flood | busy loops | load average | stops | sent: p50, p99, worst (ms) | on the board: p50, p99, worst (ms) |\n"
    "|---|---|---|---|---|---|"
)


@contextmanager
def busy_loops(count: int) -> Iterator[None]:
    """So many processes that compute for ever, while the block runs."""
    running = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for process in running:
            process.kill()
            process.wait()


class ArmingTimeout(AssertionError):
    """The arm was not armed again in time."""


def armed(t: Trial) -> None:
    """Waits until the arm has pulses. Raises `ArmingTimeout`."""
    try:
        wait_for(lambda: bool(t.board.pulses()), "the arm is armed again", seconds=20.0, pause=0.02)
    except WaitTimeout as error:
        raise ArmingTimeout from error


def stops_of(t: Trial, count: int, seconds: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Delays (ms), until sent and on the board, of up to `count` stops of the arm within a time; fewer where the flood
    keeps it from being armed.

    Raises `AssertionError` if a law is broken.
    """
    rng, end = random.Random(count), time.monotonic() + seconds
    with PulseEnds(t.daemon.pid) as watch:
        with suppress(ArmingTimeout), EstopClient(t.setup.endpoint, t.setup.key("cmd/estop")) as client:
            while len(t.estops_at) < count and time.monotonic() < end:
                armed(t)
                time.sleep(rng.uniform(0.0, 0.2))
                t.estop_by(client)
        return delays_until(watch.stop(), t.estops_at), t.result("").estops_ms


def percentile(values: Sequence[float], share: float) -> float:
    """The smallest of the values that at least this share of them does not exceed."""
    return sorted(values)[math.ceil(share * len(values)) - 1]


def row(name: str, loops: int, stops: int, seconds: float) -> str:
    """Measures one flood beside so many busy loops."""
    with tempfile.TemporaryDirectory() as folder, trial(Path(folder)) as t, busy_loops(loops), ExitStack() as flood:
        if name != NONE:
            flood.enter_context(flooded(t.setup.endpoint, FLOODS[name], seconds=2 * seconds + 60.0))
        delays = stops_of(t, stops, seconds)
    figures = " | ".join(
        ", ".join(f"{percentile(each, p):.1f}" for p in (0.5, 0.99, 1.0)) if each else "–" for each in delays
    )
    return f"| {name} | {loops} | {os.getloadavg()[0]:.1f} | {len(delays[1])} | {figures} |"


def main() -> int:
    """Prints one row per flood and load."""
    parser = argparse.ArgumentParser("tests.soak.hostile.estop_beside_floods", description=__doc__)
    parser.add_argument("--stops", type=int, default=200, help="of each row, at most")
    parser.add_argument("--seconds", type=float, default=600.0, help="for each row, at most")
    parser.add_argument("--loops", type=int, nargs="+", default=[2, 8], help="busy loops beside it")
    parser.add_argument("--only", default="", metavar="WORD", help="only floods with this word in their name")
    options = parser.parse_args()
    print(HEAD, flush=True)
    for loops in options.loops:
        for name in (NONE, *FLOODS):
            if options.only in name:
                print(row(name, loops, options.stops, options.seconds), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
