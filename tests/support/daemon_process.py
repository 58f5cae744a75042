"""The daemon and its simulated board as real processes, for tests and measurements: started, disturbed, always ended.

The daemon is started as systemd does it, with a notification socket, and both with files and a zenoh port of their own.
"""

from __future__ import annotations

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

from lrmd.client.rover import Rover
from lrmd.demo import free_port
from lrmd.messages.zenoh_session import key
from lrmd.sim.control_queries import Answer
from lrmd.sim.control_socket import ask

ROOT = Path(__file__).resolve().parents[2]
PATIENCE = 10.0
"""s: how long anything may take before a wait fails. Only what goes wrong waits this long."""
SECOND = 1_000_000_000


class TooLong(AssertionError):
    """Something did not happen in time."""


def wait_for(what: Callable[[], bool], why: str, seconds: float = PATIENCE, pause: float = 0.005) -> None:
    """Waits until something is true. Raises `TooLong`."""
    end = time.monotonic() + seconds
    while not what():
        if time.monotonic() > end:
            raise TooLong(f"waited {seconds:g} s in vain: {why}")
        time.sleep(pause)


@dataclass(frozen=True)
class Place:
    """Where one daemon and its board live: a folder, and a port for zenoh on loopback."""

    folder: Path
    port: int

    @classmethod
    def make(cls, folder: Path, changes: Mapping[str, str] | None = None) -> Place:
        """A place with the shipped configuration, 330 Hz (a count shorter than a step) and a short stagger.

        `changes`: more texts of the file to replace, each of which must be there.
        """
        place = cls(folder, free_port())
        own = {
            '"/dev/lrm-arm"': f'"{place.link}"',
            '"/var/lib/lrmd"': f'"{place.state}"',
            "127.0.0.1:7447": f"127.0.0.1:{place.port}",
            "pwm_hz = 50.0": "pwm_hz = 330.0",
            "stagger_ms = 200": "stagger_ms = 20",
        }
        text = (ROOT / "config" / "lrmd.toml").read_text(encoding="utf-8")
        for old, new in {**own, **(changes or {})}.items():
            assert old in text, f"lrmd.toml has no {old}"
            text = text.replace(old, new)
        place.config.write_text(text, encoding="utf-8")
        return place

    @property
    def link(self) -> Path:
        """The board's device."""
        return self.folder / "board"

    @property
    def log(self) -> Path:
        """What the board was told."""
        return self.folder / "frames.csv"

    @property
    def config(self) -> Path:
        """The daemon's configuration."""
        return self.folder / "lrmd.toml"

    @property
    def state(self) -> Path:
        """The folder of what survives."""
        return self.folder / "state"

    @property
    def endpoint(self) -> str:
        """Where zenoh listens."""
        return f"tcp/127.0.0.1:{self.port}"

    def rover(self, timeout: float = 5.0) -> Rover:
        """A client of this daemon."""
        return Rover("rover", [self.endpoint], timeout=timeout)

    def key(self, tail: str) -> str:
        """A key of this daemon."""
        return key("rover", tail)


class Running:
    """A process with a group of its own, which ends with it, whatever state it is in."""

    def __init__(self, command: list[str], output: IO[Any], **environment: str) -> None:
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
        self.process.wait(PATIENCE)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()


class BoardProcess(Running):
    """`lrmd-board` at a place, writing its frame log.

    A real board has a processor of its own and answers whatever else is going on; so this one goes before all but the
    ramp, where that is allowed.
    """

    def __init__(self, place: Place, *options: str) -> None:
        command = [sys.executable, "-m", "lrmd.sim.process", "--link", str(place.link), "--log", str(place.log)]
        super().__init__([*command, *options], subprocess.DEVNULL)
        self.place = place
        with suppress(PermissionError):
            os.sched_setscheduler(self.process.pid, os.SCHED_FIFO, os.sched_param(1))
        wait_for(lambda: place.link.exists() or self.process.poll() is not None, "the board comes up")
        assert self.process.poll() is None, "the simulated board ended"

    def ask(self, question: str) -> Answer:
        """Asks or disturbs the board."""
        return ask(self.place.link, question)

    def started_at(self) -> int:
        """Monotonic ns at which the board's clock stood at 0, as well as the quickest of some questions can tell."""
        best, quickest = 0, SECOND
        for _ in range(20):
            before = time.monotonic_ns()
            board = round(float(str(self.ask("status")["t_s"])) * SECOND)
            after = time.monotonic_ns()
            if after - before < quickest:
                best, quickest = (before + after) // 2 - board, after - before
        return best


class Notifications:
    """What systemd would be told: a socket that a thread reads, and the messages with the time they came (mono ns).

    `listening`: cleared, nobody reads, and the socket fills up.
    """

    def __init__(self, path: Path) -> None:
        path.unlink(missing_ok=True)
        self.path = path
        self.came: list[tuple[int, str]] = []
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
                    self.came.append((time.monotonic_ns(), message))

    def times(self, word: str, since: int = 0) -> list[int]:
        """Monotonic ns at which messages with that word came."""
        return [t for t, message in self.came if t >= since and word in message]

    def wait_for(self, word: str, seconds: float = PATIENCE) -> int:
        """Monotonic ns at which the first message with that word came. Raises `TooLong`."""
        wait_for(lambda: bool(self.times(word)), f"systemd is told {word}", seconds)
        return self.times(word)[0]

    def close(self) -> None:
        """Nobody listens any more."""
        self._closed = True
        self._thread.join()
        self._socket.close()
        self.path.unlink(missing_ok=True)


class DaemonProcess(Running):
    """`lrmd` at a place. `started`: monotonic ns."""

    def __init__(self, place: Place, watchdog_s: float = 2.0) -> None:
        self.place = place
        self.notifications = Notifications(place.folder / "notify")
        self._said = (place.folder / "lrmd.log").open("ab")
        self._begins = self._said.tell()
        command = [str(Path(sys.executable).with_name("lrmd")), "--config", str(place.config)]
        usec = str(round(watchdog_s * 1e6))
        self.started = time.monotonic_ns()
        super().__init__(command, self._said, NOTIFY_SOCKET=str(self.notifications.path), WATCHDOG_USEC=usec)

    def ready(self) -> Self:
        """Waits until it says that it is ready."""
        self.notifications.wait_for("READY=1")
        return self

    def said(self) -> list[dict[str, Any]]:
        """What it has logged since its start."""
        with (self.place.folder / "lrmd.log").open("rb") as file:
            file.seek(self._begins)
            return [json.loads(line) for line in file.read().splitlines() if line.startswith(b"{")]

    def codes(self) -> list[str]:
        """The codes of what it has logged since its start."""
        return [str(entry["event"]) for entry in self.said()]

    def child(self, name: str) -> int:
        """The number of its `ramp` or `ik` process, once that is at work: only the latter has zenoh loaded."""
        found: list[int] = []

        def there() -> bool:
            found[:] = [pid for pid in children(self.pid) if name == _role(pid)]
            return len(found) == 1

        wait_for(there, f"the {name} process is there", pause=0.02)
        return found[0]

    def end(self) -> None:
        """Kills it, and closes what was open for it."""
        super().end()
        self._said.close()
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


def _role(pid: int) -> str:
    """`ramp`, `ik` or neither: a process that multiprocessing made, with the shared memory mapped; zenoh is ik's."""
    try:
        maps = Path(f"/proc/{pid}/maps").read_text()
    except OSError:
        return ""
    if "memfd:lrmd" not in maps:
        return ""
    return "ik" if "zenoh" in maps else "ramp"


def is_alive(pid: int) -> bool:
    """Whether a process runs (a zombie does not)."""
    try:
        return Path(f"/proc/{pid}/stat").read_text(errors="replace").rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@contextmanager
def running(place: Place, *board_options: str) -> Iterator[tuple[BoardProcess, DaemonProcess]]:
    """A board and a daemon that is ready."""
    with BoardProcess(place, *board_options) as board, DaemonProcess(place) as daemon:
        yield board, daemon.ready()
