"""Memory of a moving daemon's processes under what strangers send: `python -m tests.soak.hostile.process_memory`.

Nobody of them has a lease. Prints one line per attack: by how much each process grew at most, in MB.
"""

from __future__ import annotations

import sys
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from tests.soak.hostile.client_memory import resident
from tests.soak.hostile.flood import flooded
from tests.soak.hostile.trial import Trial, trial
from tests.support.daemon.daemon_process import children, role

ROLES = ("api", "ik", "router", "ramp", "trial")
"""`trial`: the process that tries a deployed model, whole, as it was not there before."""
ALLOWED_MB = {"trial": 180.0}
MOST_MB = 100.0
PAUSE_S = 0.02
ATTACKS = ("deploy", "stuff", "starve", "hog", "large")
BROKEN = ("api_silent", "ik_died", "ramp_died", "router_died", "internal_error")
"""Events that say that a process was kept from its work."""


class PeakMemory:
    """Largest resident memory (MB) of a daemon's processes by role, sampled by a thread while the block runs."""

    def __init__(self, pid: int) -> None:
        self._pid = pid
        self._roles = {pid: "api"}
        self.peak: defaultdict[str, float] = defaultdict(float)
        self._sample()
        self.before = dict(self.peak)

    def _sample(self) -> None:
        for pid in (self._pid, *children(self._pid)):
            name = self._roles.get(pid) or role(pid)
            if name:
                self._roles[pid] = name
            self.peak[name or "trial"] = max(self.peak[name or "trial"], resident(pid))

    @contextmanager
    def sampled(self) -> Iterator[None]:
        """Samples while the block runs."""
        ended = threading.Event()

        def run() -> None:
            while not ended.wait(PAUSE_S):
                self._sample()

        thread = threading.Thread(target=run, daemon=True)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()

    def growth(self) -> dict[str, float]:
        """MB by role; of a trial all that it takes."""
        return {name: self.peak[name] - (self.before.get(name, 0.0) if name != "trial" else 0.0) for name in ROLES}


def grown(t: Trial, attack: Callable[[], None]) -> dict[str, float]:
    """Growth of each process (MB) under an attack on a moving arm. Raises `AssertionError` if it stopped a process."""
    peak, known = PeakMemory(t.daemon.pid), len(t.daemon.codes())
    with peak.sampled():
        attack()
    t.wait_until_it_moves()
    since = t.daemon.codes()[known:]
    assert not set(since) & set(BROKEN), since
    return peak.growth()


def flood(t: Trial, kind: str, clients: int, seconds: float) -> None:
    """Several clients flood for some seconds."""
    with flooded(t.setup.endpoint, (kind,) * clients):
        time.sleep(seconds)


def too_much(growth: dict[str, float]) -> list[str]:
    """Roles that grew by more than they may."""
    return [name for name in ROLES if growth[name] > ALLOWED_MB.get(name, MOST_MB)]


def main(seconds: float = 15.0) -> int:
    """Prints the table; 1 if a process grew by too much."""
    print(f"{'attack':<20}" + "".join(f"{name:>9}" for name in ROLES))
    failed = 0
    for kind in ATTACKS:
        for clients in (1, 4):
            with tempfile.TemporaryDirectory() as folder, trial(Path(folder)) as t:
                growth = grown(t, partial(flood, t, kind, clients, seconds))
            failed += bool(too_much(growth))
            print(f"{f'{kind}, {clients} clients':<20}" + "".join(f"{growth[n]:>9.0f}" for n in ROLES), flush=True)
    return bool(failed)


if __name__ == "__main__":
    sys.exit(main(*map(float, sys.argv[1:])))
