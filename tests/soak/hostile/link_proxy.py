"""A man in the middle of the servo link: a pty of its own towards the daemon, the board's on the other side."""

from __future__ import annotations

import heapq
import os
import random
import select
import threading
import time
import tty
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Protocol, Self

MS = 1e-3
Delayed = Iterable[tuple[float, bytes]]
"""Bytes to pass on, each after a delay (s)."""


class LinkAttack(Protocol):
    """Action of the man in the middle on each frame (with its 0x00)."""

    def to_board(self, wire: bytes, rng: random.Random) -> Delayed: ...
    def to_daemon(self, wire: bytes, rng: random.Random) -> Delayed: ...


class Direction:
    """One direction: cuts the stream at each 0x00, and keeps the order of what is delayed."""

    def __init__(self) -> None:
        self._rest = b""
        self._queue: list[tuple[float, int, bytes]] = []
        self._count, self._latest = 0, 0.0

    def frames(self, data: bytes) -> list[bytes]:
        """Frames completed by these bytes."""
        *whole, self._rest = (self._rest + data).split(b"\0")
        return [part + b"\0" for part in whole]

    def push(self, now: float, delayed: Delayed) -> None:
        """Queues bytes behind all that are there."""
        for delay, data in delayed:
            self._latest = max(self._latest, now + delay)
            self._count += 1
            heapq.heappush(self._queue, (self._latest, self._count, data))

    def due(self, now: float) -> bytes:
        """Bytes to be passed on now."""
        out = b""
        while self._queue and self._queue[0][0] <= now:
            out += heapq.heappop(self._queue)[2]
        return out


class LinkProxy:
    """Runs in a thread from `with` to its end. `attack`: may be changed at any time, None passes everything on."""

    def __init__(self, daemon_side: Path, board_side: Path, seed: int = 0) -> None:
        self._path, self._board_path = daemon_side, board_side
        self._rng = random.Random(seed)
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self.attack: LinkAttack | None = None
        self.unplugged = threading.Event()

    def __enter__(self) -> Self:
        self._plug()
        self._board = os.open(self._board_path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        self._thread.join()
        self._unplug()
        os.close(self._board)

    def _plug(self) -> None:
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self._path.symlink_to(os.ttyname(self._slave))

    def _unplug(self) -> None:
        self._path.unlink(missing_ok=True)
        os.close(self._master)
        os.close(self._slave)

    def _run(self) -> None:
        to_board, to_daemon, plugged = Direction(), Direction(), True
        while not self._ending.is_set():
            if plugged is self.unplugged.is_set():
                plugged = not plugged
                self._plug() if plugged else self._unplug()
            ends = [self._master, self._board] if plugged else [self._board]
            readable, _, _ = select.select(ends, [], [], 1 * MS)
            now, attack, rng = time.monotonic(), self.attack, self._rng
            for end in readable:
                with suppress(BlockingIOError):
                    data = os.read(end, 4096)
                    direction = to_board if end == self._master and plugged else to_daemon
                    for wire in direction.frames(data):
                        if attack is None:
                            direction.push(now, [(0.0, wire)])
                        else:
                            act = attack.to_board if direction is to_board else attack.to_daemon
                            direction.push(now, act(wire, rng))
            self._pass_on(self._board, to_board.due(now))
            if plugged:
                self._pass_on(self._master, to_daemon.due(now))

    def _pass_on(self, end: int, data: bytes) -> None:
        """Passes on; the rest beyond the line's buffer is lost, as on a line."""
        if data:
            with suppress(BlockingIOError):
                os.write(end, data)
