"""Order of what arrives from ROS 2, and which orders a stop has overtaken.

Theory of operation. zenoh gives each topic and service a thread of its own. So of a trajectory and the stop that
follows it either may be first at the door, above all when the bridge was stalled and both wait. Therefore each message
gets a number in zenoh's receiving thread, where they are in order, and one thread works on them by number. An order is
overtaken if a stop has a later number, whenever either is worked on.
"""

from __future__ import annotations

import queue
import threading
import traceback
from collections.abc import Callable
from typing import Any, Self

from zenoh.handlers import Callback

Work = Callable[[Any, int], object]
"""Gets a message or query and its number."""


class Arrivals:
    """`with` works on what arrives, on one thread; nothing that is taken in may wait there."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._last = self._last_stop = 0
        self._waiting: queue.SimpleQueue[tuple[Work, Any, int] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="arrivals", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._waiting.put(None)
        self._thread.join()

    def taken_by(self, work: Work, stops: bool = False) -> Any:
        """A callback of zenoh that passes what comes to `work`. `stops`: whatever comes there is a stop."""

        def received(sample: Any) -> None:
            """Numbers one message, in zenoh's thread."""
            with self._lock:
                self._last += 1
                number = self._last
                self._last_stop = number if stops else self._last_stop
                self._waiting.put((work, sample, number))

        return Callback(received, indirect=False)

    def stopped(self, number: int) -> None:
        """The message of this number was a stop."""
        with self._lock:
            self._last_stop = max(self._last_stop, number)

    def overtaken(self, number: int) -> bool:
        """Whether a stop came after the order of this number."""
        with self._lock:
            return number < self._last_stop

    def _run(self) -> None:
        while (item := self._waiting.get()) is not None:
            work, sample, number = item
            try:
                work(sample, number)
            except Exception:  # what fails with one message must not make the door deaf
                traceback.print_exc()
