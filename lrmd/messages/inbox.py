"""The messages that wait between zenoh's threads and the thread that works on them: bounded in number and bytes.

zenoh itself keeps any number of messages for a callback that is busy (200 of 1 MB: 200 MB).
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable

from lrmd.errors import RequestError

PLACES, BYTES = 256, 8_000_000
"""Messages of one key that wait or are worked on, and their bytes together."""
Send = Callable[[], None]
"""Sends what was computed; the message's place is free by then, so that its sender may send the next one."""


class Inbox:
    """Work on messages, one after the other in a thread of its own; `places` and `size` (bytes) bound what waits.

    `came`: when the message came that is worked on (monotonic ns), for that work to ask.
    """

    def __init__(self, places: int = PLACES, size: int = BYTES) -> None:
        self._places, self._room = places, size
        self._waiting: deque[tuple[int, int, Callable[[], Send]]] = deque()
        self.came = 0
        self._taken = 0
        self._changed = threading.Condition()
        self._thread: threading.Thread | None = None

    def put(self, size: int, work: Callable[[], Send]) -> None:
        """Takes the work on a message of so many bytes; does not wait. Raises `RequestError` if there is no room."""
        with self._changed:
            if self._taken >= self._places or size > self._room:
                raise RequestError("busy", "earlier requests are still worked on; ask again", retryable=True)
            self._take(size, work)

    def after(self, work: Callable[[], Send]) -> None:
        """Takes work of the daemon's own, which is done after what waits, whether there is room or not."""
        with self._changed:
            self._take(0, work)

    def _take(self, size: int, work: Callable[[], Send]) -> None:
        self._taken, self._room = self._taken + 1, self._room - size
        self._waiting.append((size, time.monotonic_ns(), work))
        self._changed.notify()
        if self._thread is None:
            self._thread = threading.Thread(target=self._work, daemon=True)
            self._thread.start()

    def _work(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting)
                size, self.came, work = self._waiting.popleft()
            send = work()
            del work
            with self._changed:
                self._taken, self._room = self._taken - 1, self._room + size
            send()
            del send
