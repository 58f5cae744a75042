"""Memory of the daemon over many foreign clients: `python -m tests.soak.hostile.client_memory [CLIENTS]`.

Every client is a process of its own with zenoh's default settings (shared memory on), and sends larger messages.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from tests.support.daemon.daemon_process import DaemonSetup, children, running_daemon

CLIENTS, CLIENTS_AT_ONCE = 100, 4
GROWTH_MB = 30.0
"""Allowed for all clients together; with zenoh's shared memory one alone leaves about 20 MB."""
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


@dataclass(frozen=True)
class DaemonMemory:
    """MB of resident memory of each of the daemon's processes, the main one first, and of zenoh's files in /dev/shm."""

    processes: tuple[float, ...]
    shared: float

    @classmethod
    def now(cls, pid: int) -> DaemonMemory:
        """Memory of the daemon with this process number."""
        return cls(tuple(map(resident, [pid, *sorted(children(pid))])), sum(_sizes(Path("/dev/shm"))) / 1e6)

    def growth(self, before: DaemonMemory) -> float:
        """MB more than before, altogether."""
        return sum(self.processes) - sum(before.processes) + self.shared - before.shared


def resident(pid: int) -> float:
    """Resident set (MB); 0 for a process that has ended."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return 0.0
    return sum(float(line.split()[1]) for line in lines if line.startswith("VmRSS")) / 1e3


def _sizes(folder: Path) -> Iterator[int]:
    for path in folder.glob("*.zenoh"):
        try:
            yield path.stat().st_blocks * 512
        except OSError:
            continue


def visit(setup: DaemonSetup, clients: int) -> None:
    """Lets so many clients come and go, a few at once."""
    command = [sys.executable, "-c", CLIENT, setup.endpoint, setup.key("rpc/move")]
    for first in range(0, clients, CLIENTS_AT_ONCE):
        here = [subprocess.Popen(command) for _ in range(min(CLIENTS_AT_ONCE, clients - first))]
        assert [client.wait(60) for client in here] == [0] * len(here)


def measure(clients: int) -> tuple[DaemonMemory, DaemonMemory]:
    """Memory of a daemon after its first clients, and after so many more."""
    with tempfile.TemporaryDirectory() as folder:
        setup = DaemonSetup.make(Path(folder))
        with running_daemon(setup) as (_, daemon):
            visit(setup, CLIENTS_AT_ONCE)
            before = DaemonMemory.now(daemon.pid)
            visit(setup, clients)
            return before, DaemonMemory.now(daemon.pid)


def main(clients: int = CLIENTS) -> int:
    """Prints the memory; 1 if it grew too much."""
    before, after = measure(clients)
    growth = after.growth(before)
    shared = f"/dev/shm {before.shared:.1f} -> {after.shared:.1f} MB"
    print(f"{clients} clients: processes {before.processes} -> {after.processes} MB, {shared}")
    print(f"{growth:.1f} MB more, {GROWTH_MB:.0f} allowed")
    return growth > GROWTH_MB


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
