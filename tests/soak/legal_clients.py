"""Legal clients on two busy cores, with the shipped link times: `python -m tests.soak.legal_clients [MINUTES]`.

Three clients ask a thousand goals at a time, a fourth deploys models, and only the one that moves the arm has a lease.
Prints faults, gaps between the board's frames while the arm moves, and resident memory of each process in the second
minute and at the end.
"""

from __future__ import annotations

import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import msgpack
import zenoh

from lrmd.messages.zenoh_session import client
from tests.soak.hostile.flood import ROOT, hog
from tests.soak.hostile.memory import ROLES, memory
from tests.soak.hostile.trial import trial
from tests.support.daemon.daemon_process import COOL
from tests.support.daemon.pulse_invariants import read_frames

ASKERS, SECOND_MINUTE_S, ALLOWED = 3, 90.0, 1.05
FAULTS = ("link_lost", "board_silenced", "api_silent", "ramp_died", "router_died", "ik_died", "internal_error")
MODEL = 'schema = "lrm/model/1"\narm = "lrm-rover"\neffects = []\n# {}\n'


def work(endpoint: str, kind: str) -> None:
    """One client until it is killed."""
    rng = random.Random(kind)
    with zenoh.open(client([endpoint])) as session:
        while True:
            if kind == "deploy":
                text = msgpack.packb({"v": 1, "text": MODEL.format(rng.random())})
                list(session.get("lrm/rover/rpc/deploy", payload=text, timeout=20.0))
            else:
                hog(session, "rover", rng)


@contextmanager
def clients(endpoint: str) -> Iterator[None]:
    """All of them, as processes."""
    kinds = [*(f"ask {k}" for k in range(ASKERS)), "deploy"]
    command = [sys.executable, "-m", "tests.soak.legal_clients", endpoint]
    running = [subprocess.Popen([*command, kind], cwd=ROOT, stderr=subprocess.DEVNULL) for kind in kinds]
    try:
        yield
    finally:
        for process in running:
            process.kill()
            process.wait()


def main(minutes: float = 15.0) -> int:
    """Prints the figures; 1 after a fault, or if a process grew by more than a twentieth."""
    with tempfile.TemporaryDirectory() as folder, trial(Path(folder), COOL) as t, clients(t.setup.endpoint):
        begun = time.monotonic()
        early = min(SECOND_MINUTE_S, 30.0 * minutes)
        time.sleep(early)
        before = memory(t)
        time.sleep(max(0.0, 60.0 * minutes - (time.monotonic() - begun)))
        after, faults = memory(t), sorted(code for code in t.daemon.codes() if code in FAULTS)
        log = [line for line in read_frames(t.setup.log) if line.event == "arm"]
        gaps = sorted((b.t - a.t) / 1e6 for a, b in pairwise(log) if a.pulsing and b.pulsing)
        print(f"{t.moves} moves; {len(gaps)} frames, gaps (ms): median {gaps[len(gaps) // 2]:.1f}, "
              f"99.9 % {gaps[int(0.999 * len(gaps))]:.0f}, largest {[round(gap) for gap in gaps[-5:]]}")  # fmt: skip
    for name in ROLES[:-1]:
        print(f"{name:<8}{before[name]:>8.1f} MB{after[name]:>8.1f} MB{after[name] / before[name]:>8.3f}")
    print(f"faults: {', '.join(faults) or 'none'}")
    return bool(faults) or any(after[name] > ALLOWED * before[name] for name in ROLES[:-1])


if __name__ == "__main__":
    if sys.argv[2:]:
        work(*sys.argv[1:])
    sys.exit(main(*map(float, sys.argv[1:])))
