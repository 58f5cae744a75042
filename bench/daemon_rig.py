"""What the measurements of the daemon share: a figure, a rig of real processes, and times on one clock."""

from __future__ import annotations

import time
from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

from lrmd.client.rover import Rover
from lrmd.config import load_config
from tests.support.daemon_process import BoardProcess, DaemonProcess, Place, wait_for
from tests.support.frame_laws import Line, laws, read_frames

SECOND, MS = 1_000_000_000, 1_000_000
HOME = {f"joint{i}": 0.0 for i in range(1, 7)}
FAR, NEAR = {"joint1": 1.5}, {"joint1": -1.5}


@dataclass(frozen=True)
class Figure:
    """Something measured: its values, and the most that they should be (None: told for comparison only)."""

    what: str
    values: tuple[float, ...]
    unit: str
    goal: float | None = None


@contextmanager
def place_with_board() -> Iterator[tuple[Place, BoardProcess]]:
    """A folder of its own, gone afterwards, and a board in it."""
    with TemporaryDirectory() as folder:
        place = Place.make(Path(folder))
        with BoardProcess(place) as board:
            yield place, board


def wait_for_link(rover: Rover) -> None:
    """Waits until the board answers."""
    wait_for(lambda: rover.mode().link == "ready", "the board answers")


def step(place: Place, board_started: int, armed_at: Sequence[int]) -> Figure:
    """The largest step in a frame log, for servos that were asked to be switched on at `armed_at` (monotonic ns).

    Raises `AssertionError` if any of the laws was broken.
    """
    found = laws(load_config(place.config), read_frames(place.log))
    found.check([at - board_started for at in armed_at])
    return Figure(f"- largest step in {found.frames} frames", (found.largest_step / 1e3,), "us", found.allowed / 1e3)


@dataclass
class Rig:
    """A board, a daemon that is ready, a client; `armed_at`: when servos were asked to be switched on."""

    place: Place
    board: BoardProcess
    daemon: DaemonProcess
    rover: Rover
    board_started: int
    armed_at: list[int] = field(default_factory=list)

    def arm(self) -> None:
        """Arms at home."""
        self.armed_at.append(time.monotonic_ns())
        self.rover.arm("given", HOME)

    def wait_for_mode(self, mode: str) -> None:
        """Waits until the daemon says so."""
        wait_for(lambda: self.rover.mode().mode == mode, f"the mode is {mode}")

    def frames(self) -> list[Line]:
        """The accepted ARM frames so far, on the monotonic clock (ns)."""
        lines = read_frames(self.place.log)
        return [Line(line.t + self.board_started, line.event, line.counts) for line in lines if line.event == "arm"]

    def step(self) -> Figure:
        """The largest step in the whole log. Raises `AssertionError` if any of the laws was broken."""
        return step(self.place, self.board_started, self.armed_at)


@contextmanager
def rig() -> Iterator[Rig]:
    """A rig, and all of it ended afterwards."""
    with place_with_board() as (place, board), DaemonProcess(place) as daemon:
        daemon.ready()
        with place.rover() as rover:
            wait_for_link(rover)
            yield Rig(place, board, daemon, rover, board.started_at())


def when(what: Callable[[], bool]) -> int:
    """Monotonic ns at which something became true, to a few tenths of a ms."""
    wait_for(what, "it happens", pause=0.0002)
    return time.monotonic_ns()


def delays(asked: Sequence[int], came: Sequence[int]) -> tuple[float, ...]:
    """ms from every moment to the first one after it (ns, both sorted)."""
    return tuple((came[bisect_left(came, at)] - at) / MS for at in asked)
