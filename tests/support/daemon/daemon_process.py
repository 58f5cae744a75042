"""The daemon and its simulated board as real processes, for tests and measurements; always ended.

The daemon is started as systemd does it, with a notification socket, and both with files and a zenoh port of their own.
"""

from __future__ import annotations

import itertools
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Self

from lrmd.client import Rover
from lrmd.messages.zenoh_session import key
from lrmd.sim.control_socket import QueryReply, query_board

ROOT = Path(__file__).resolve().parents[3]
TIMEOUT, START_TIMEOUT = 10.0, 60.0
"""s; only a failing wait takes this long."""
SECOND = 1_000_000_000
NICENESS = -5
FIRST_PORT, PORTS = 20_000, 12_000
"""Below those that the kernel gives to connections."""
_port_numbers = itertools.count(os.getpid() * 100)  # processes with neighbouring numbers begin a hundred apart


def free_port() -> int:
    """A TCP port on loopback that nobody listens on, and that no other test is given before it is listened on."""
    for number in itertools.islice(_port_numbers, PORTS):
        port = FIRST_PORT + number % PORTS
        with socket.socket() as probe, suppress(OSError):
            probe.bind(("127.0.0.1", port))
            return port
    raise AssertionError(f"no free port of {FIRST_PORT} to {FIRST_PORT + PORTS}")


SLOW_BOARD = {"silence_ms = 1000": "silence_ms = 10000", "reply_ms = 490": "reply_ms = 4900"}
"""Changes of the configuration where the test is not of the link, and takes long."""
LONGEST_LEASE = {"lease_ms = 400": "lease_ms = 500"}
"""A change where the test is not of the lease, and a busy machine may keep it from renewing one in time."""
COOL = {"time_constant_s = 900.0": "time_constant_s = 90000.0"}
"""Servos that hardly warm up, so that no arm goes to rest by itself."""


class WaitTimeout(AssertionError):
    """A condition did not hold in time."""


def wait_for(condition: Callable[[], bool], what: str, seconds: float = TIMEOUT, pause: float = 0.005) -> None:
    """Waits until a condition holds. Raises `WaitTimeout`."""
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            raise WaitTimeout(f"not within {seconds:g} s: {what}")
        time.sleep(pause)


@dataclass(frozen=True)
class DaemonSetup:
    """The files of one daemon and its board in a folder, and a port for zenoh on loopback."""

    folder: Path
    port: int

    @classmethod
    def make(cls, folder: Path, changes: Mapping[str, str] | None = None) -> DaemonSetup:
        """The shipped configuration with these files, 330 Hz (a count shorter than a step) and a short stagger.

        `changes`: more texts of the file to replace, each of which must be there.
        """
        setup = cls(folder, free_port())
        own = {
            '"/dev/lrm-arm"': f'"{setup.link}"',
            '"/var/lib/lrmd"': f'"{setup.state}"',
            "127.0.0.1:7447": f"127.0.0.1:{setup.port}",
            "pwm_hz = 50.0": "pwm_hz = 330.0",
            "stagger_ms = 200": "stagger_ms = 20",
        }
        text = (ROOT / "config" / "lrmd.toml").read_text(encoding="utf-8")
        for old, new in {**own, **(changes or {})}.items():
            assert old in text, f"lrmd.toml has no {old}"
            text = text.replace(old, new)
        setup.config.write_text(text, encoding="utf-8")
        return setup

    @property
    def link(self) -> Path:
        """The board's device."""
        return self.folder / "board"

    @property
    def log(self) -> Path:
        """The board's frame log."""
        return self.folder / "frames.csv"

    @property
    def config(self) -> Path:
        """The daemon's configuration."""
        return self.folder / "lrmd.toml"

    @property
    def state(self) -> Path:
        """The folder of the state file."""
        return self.folder / "state"

    @property
    def endpoint(self) -> str:
        """Endpoint on which zenoh listens."""
        return f"tcp/127.0.0.1:{self.port}"

    def rover(self, timeout: float = 5.0) -> Rover:
        """A client of this daemon."""
        return Rover("rover", [self.endpoint], timeout=timeout)

    def key(self, tail: str) -> str:
        """A key of this daemon."""
        return key("rover", tail)


class ProcessGroup:
    """A process with a group of its own, which ends with it, whatever state it is in."""

    def __init__(self, command: list[str], output: IO[Any] | int, **environment: str) -> None:
        self.process = subprocess.Popen(
            command, stdout=output, stderr=subprocess.STDOUT, env={**os.environ, **environment}, start_new_session=True
        )
        self.pid = self.process.pid

    def signal(self, number: int) -> None:
        """Sends a signal to the process itself, not to its children."""
        self.process.send_signal(number)

    def end(self) -> None:
        """Kills it and its children, if they are still there."""
        with suppress(ProcessLookupError):
            os.killpg(self.pid, signal.SIGKILL)
        self.process.wait(TIMEOUT)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()


class BoardProcess(ProcessGroup):
    """`lrmd-board`, writing its frame log."""

    def __init__(self, setup: DaemonSetup, *options: str) -> None:
        command = [sys.executable, "-m", "lrmd.sim.process", "--link", str(setup.link), "--log", str(setup.log)]
        super().__init__([*command, *options], subprocess.DEVNULL)
        self.setup = setup
        wait_for(lambda: setup.link.exists() or self.process.poll() is not None, "the board comes up", START_TIMEOUT)
        assert self.process.poll() is None, "the simulated board ended"

    def ask(self, query: str) -> QueryReply:
        """Sends a query or a fault to the board's control socket."""
        return query_board(self.setup.link, query)

    def pulses(self) -> list[float]:
        """Pulses that it puts out (us)."""
        pulses = self.ask("status")["pulse_us"]
        assert isinstance(pulses, list)
        return [pulse for pulse in pulses if pulse is not None]

    def started_at(self) -> int:
        """Monotonic ns at which the board's clock stood at 0, by the quickest of some queries."""
        best, quickest = 0, SECOND
        for _ in range(20):
            before = time.monotonic_ns()
            board = round(float(str(self.ask("status")["t_s"])) * SECOND)
            after = time.monotonic_ns()
            if after - before < quickest:
                best, quickest = (before + after) // 2 - board, after - before
        return best


class NotifySocket:
    """systemd's notification socket, read by a thread: the messages with the time they came (monotonic ns).

    `listening`: cleared, nobody reads, and the socket fills up.
    """

    def __init__(self, path: Path) -> None:
        path.unlink(missing_ok=True)
        self.path = path
        self.messages: list[tuple[int, str]] = []
        self.listening = threading.Event()
        self.listening.set()
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(str(path))
        self._closed = False
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def _listen(self) -> None:
        self._socket.settimeout(0.05)
        while not self._closed:
            if self.listening.wait(0.05):
                with suppress(TimeoutError):
                    message = self._socket.recv(4096).decode()
                    self.messages.append((time.monotonic_ns(), message))

    def times(self, word: str, since: int = 0) -> list[int]:
        """Monotonic ns at which messages with that word came."""
        return [t for t, message in self.messages if t >= since and word in message]

    def wait_for(self, word: str, seconds: float = TIMEOUT) -> int:
        """Monotonic ns at which the first message with that word came. Raises `WaitTimeout`."""
        wait_for(lambda: bool(self.times(word)), f"systemd gets {word}", seconds)
        return self.times(word)[0]

    def close(self) -> None:
        """Stops listening."""
        self._closed = True
        self._thread.join()
        self._socket.close()
        self.path.unlink(missing_ok=True)


class DaemonProcess(ProcessGroup):
    """`lrmd`. `started`: monotonic ns."""

    def __init__(self, setup: DaemonSetup, watchdog_s: float = 2.0) -> None:
        self.setup = setup
        self.notifications = NotifySocket(setup.folder / "notify")
        self._log_file = (setup.folder / "lrmd.log").open("ab")
        self._log_start = self._log_file.tell()
        command = [str(Path(sys.executable).with_name("lrmd")), "--config", str(setup.config)]
        usec = str(round(watchdog_s * 1e6))
        self.started = time.monotonic_ns()
        super().__init__(command, self._log_file, NOTIFY_SOCKET=str(self.notifications.path), WATCHDOG_USEC=usec)
        with suppress(PermissionError):  # as the unit's CPUWeight does: before other tests and attacking clients
            os.setpriority(os.PRIO_PROCESS, self.pid, NICENESS)

    def ready(self) -> Self:
        """Waits until systemd would have READY=1. Raises `AssertionError` if it ends before."""
        wait_for(lambda: self.is_ready() or self.process.poll() is not None, "systemd gets READY=1", START_TIMEOUT)
        assert self.is_ready(), f"the daemon ended: {self.log_entries()[-3:]}"
        return self

    def is_ready(self) -> bool:
        """Whether systemd would have READY=1."""
        return bool(self.notifications.times("READY=1"))

    def log_entries(self) -> list[dict[str, Any]]:
        """Entries of its log since its start."""
        with (self.setup.folder / "lrmd.log").open("rb") as file:
            file.seek(self._log_start)
            return [json.loads(line) for line in file.read().splitlines() if line.startswith(b"{")]

    def codes(self) -> list[str]:
        """The event codes of its log since its start."""
        return [str(entry["event"]) for entry in self.log_entries()]

    def child(self, name: str) -> int:
        """The number of its `ramp`, `ik` or `router` process, once that is at work."""
        found: list[int] = []

        def there() -> bool:
            found[:] = [pid for pid in children(self.pid) if name == role(pid)]
            return len(found) == 1

        wait_for(there, f"the {name} process is there", pause=0.02)
        return found[0]

    def end(self) -> None:
        """Kills it, and closes what was open for it."""
        super().end()
        self._log_file.close()
        self.notifications.close()


def children(pid: int) -> list[int]:
    """The child processes of a process."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            parent = stat.read_text(errors="replace").rpartition(")")[2].split()[1]
            if int(parent) == pid:
                found.append(int(stat.parent.name))
    return found


def role(pid: int) -> str:
    """Which of them a process with the shared memory is, by its libraries: ramp has no zenoh, router no numpy."""
    try:
        maps = Path(f"/proc/{pid}/maps").read_text()
    except OSError:
        return ""
    if "memfd:lrmd" not in maps:
        return ""
    if "zenoh" not in maps:
        return "ramp"
    return "ik" if "numpy" in maps else "router"


def is_alive(pid: int) -> bool:
    """Whether a process runs (a zombie does not)."""
    try:
        return Path(f"/proc/{pid}/stat").read_text(errors="replace").rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@contextmanager
def running_daemon(setup: DaemonSetup, *board_options: str) -> Iterator[tuple[BoardProcess, DaemonProcess]]:
    """A board and a daemon that is ready."""
    with BoardProcess(setup, *board_options) as board, DaemonProcess(setup) as daemon:
        yield board, daemon.ready()
