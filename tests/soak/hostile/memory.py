"""Memory of a moving daemon's processes under what strangers send: `python -m tests.soak.hostile.memory`.

Nobody of them has a lease. First one line per attack: by how much each process grew at most, in MB. Then all floods at
once in equal rounds, each with a pause after it: for each process its resident memory (MB) at the start, after each
round, and at most. A process that keeps nothing of what was sent stays, after the later half of the rounds, within 5 %
of the most after the earlier half. One round is not enough to compare with: a heap goes back to the system down to the
last block in use, so the router stood at 41.9 MB after two rounds, and at 45.0 MB after each of the six that followed.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from tests.soak.hostile.flood import KINDS, flooded
from tests.soak.hostile.trial import Trial, trial
from tests.support.background import repeated
from tests.support.daemon.daemon_process import COOL, DaemonSetup, children, role, running_daemon
from validation.options import asked

ROLES = ("api", "ik", "router", "ramp", "trial")
"""`trial`: the process that tries a deployed model, whole, as it was not there before."""
ALLOWED_MB = {"trial": 180.0}
MOST_MB = 100.0
SAMPLE_S = 0.02
ATTACKS = ("deploy", "stuff", "starve", "hog", "large")
BROKEN = ("api_silent", "ik_died", "ramp_died", "router_died", "internal_error")
"""Events that say that a process was kept from its work."""
ROUNDS, PAUSE_S, ALLOWED = 3, 20.0, 1.05
"""Rounds of each half."""
CLIENTS_AT_ONCE = 4
CLIENT = """
import sys, zenoh
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", '["' + sys.argv[1] + '"]')
config.insert_json5("scouting/multicast/enabled", "false")
with zenoh.open(config) as session:
    for _ in range(5):
        list(session.get(sys.argv[2], payload=bytes(100_000), timeout=5.0))
"""
"""Asks with 100 kB, which is refused unparsed: no matter, it was sent."""


def resident(pid: int) -> float:
    """Resident set (MB); 0 for a process that has ended."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return 0.0
    return sum(float(line.split()[1]) for line in lines if line.startswith("VmRSS")) / 1e3


def memory(t: Trial) -> dict[str, float]:
    """Resident memory (MB) of each process by role."""
    return {"api": resident(t.daemon.pid)} | {role(pid): resident(pid) for pid in children(t.daemon.pid) if role(pid)}


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
        with repeated(self._sample, SAMPLE_S):
            yield

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


def flood(t: Trial, kinds: tuple[str, ...], seconds: float) -> None:
    """Clients of these kinds flood for some seconds."""
    with flooded(t.setup.endpoint, kinds, seconds + 120.0):
        time.sleep(seconds)


def too_much(growth: dict[str, float]) -> list[str]:
    """Roles that grew by more than they may."""
    return [name for name in ROLES if growth[name] > ALLOWED_MB.get(name, MOST_MB)]


def left_by_clients(clients: int) -> float:
    """MB that so many foreign clients leave in the daemon's processes and in zenoh's files in /dev/shm.

    Every client is a process of its own with zenoh's default settings (shared memory on); a few are there at once. The
    first ones, which load code, do not count.
    """
    with tempfile.TemporaryDirectory() as folder:
        setup = DaemonSetup.make(Path(folder))
        command = [sys.executable, "-c", CLIENT, setup.endpoint, setup.key("rpc/move")]
        with running_daemon(setup) as (_, daemon):
            found = []
            for count in (CLIENTS_AT_ONCE, clients):
                for first in range(0, count, CLIENTS_AT_ONCE):
                    here = [subprocess.Popen(command) for _ in range(min(CLIENTS_AT_ONCE, count - first))]
                    assert [client.wait(60) for client in here] == [0] * len(here)
                found.append(sum(map(resident, (daemon.pid, *children(daemon.pid)))) + sum(_zenoh_files()))
    return found[1] - found[0]


def _zenoh_files() -> Iterator[float]:
    for path in Path("/dev/shm").glob("*.zenoh"):
        try:
            yield path.stat().st_blocks * 512 / 1e6
        except OSError:
            continue


def growth_is_bounded(seconds: float) -> bool:
    """Prints the growth under each attack, by one client and by four."""
    print(f"{'attack':<20}" + "".join(f"{name:>9}" for name in ROLES))
    bounded = True
    for kind in ATTACKS:
        for clients in (1, 4):
            with tempfile.TemporaryDirectory() as folder, trial(Path(folder)) as t:
                growth = grown(t, partial(flood, t, (kind,) * clients, seconds))
            bounded = bounded and not too_much(growth)
            print(f"{f'{kind}, {clients} clients':<20}" + "".join(f"{growth[n]:>9.0f}" for n in ROLES), flush=True)
    return bounded


def after_all_floods(t: Trial, seconds: float) -> dict[str, float]:
    """The memory (MB) a pause after all kinds of floods at once."""
    flood(t, tuple(KINDS), seconds)
    time.sleep(PAUSE_S)
    t.wait_until_it_moves()
    return memory(t)


def memory_returns(seconds: float) -> bool:
    """Prints the memory of each process after each round of all floods at once; `seconds` of each half."""
    with tempfile.TemporaryDirectory() as folder, trial(Path(folder), COOL) as t:
        peak = PeakMemory(t.daemon.pid)
        with peak.sampled():
            rounds = [memory(t)] + [after_all_floods(t, seconds / ROUNDS) for _ in range(2 * ROUNDS)]
        broken = sorted(set(t.daemon.codes()) & set(BROKEN))
    columns = ("fresh", *(f"round {number}" for number in range(1, 2 * ROUNDS + 1)), "most", "ratio")
    print(f"{'MB':<8}" + "".join(f"{name:>9}" for name in columns))
    ratios = {name: _later_to_earlier([after[name] for after in rounds[1:]]) for name in ROLES[:-1]}
    for name, ratio in ratios.items():
        figures = *(after[name] for after in rounds), peak.peak[name]
        print(f"{name:<8}" + "".join(f"{figure:>9.1f}" for figure in figures) + f"{ratio:>9.3f}", flush=True)
    print(f"kept from their work: {', '.join(broken) or 'none'}")
    return not broken and max(ratios.values()) <= ALLOWED


def _later_to_earlier(figures: list[float]) -> float:
    """The most of the later half by the most of the earlier half."""
    return max(figures[len(figures) // 2 :]) / max(figures[: len(figures) // 2])


def main() -> int:
    """Prints both tables; 1 if a process grew by too much, kept it, or was kept from its work."""
    options = asked(__doc__, seconds=(15.0, "of each attack"), minutes=(10.0, "of each half of all floods at once"))
    kept = [growth_is_bounded(options.seconds), memory_returns(60.0 * options.minutes)]
    return int(not all(kept))


if __name__ == "__main__":
    sys.exit(main())
