"""A child process that is started anew when it dies or stops working."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable
from multiprocessing import get_context
from multiprocessing.process import BaseProcess
from typing import Any

from lrm_math.errors import LrmError

SECOND = 1_000_000_000
MOST_STARTS, WITHIN = 10, 10 * SECOND


class GivenUp(LrmError):
    """A process that dies faster than it makes sense to start it again."""


class Child:
    """A process made with `spawn`, and its restarts. `target` and its arguments must pickle."""

    def __init__(self, name: str, target: Callable[..., None], *arguments: Any) -> None:
        self.name, self.starts = name, 0
        self._target, self._arguments = target, arguments
        self._context = get_context("spawn")
        self._process: BaseProcess | None = None
        self._lately: deque[int] = deque(maxlen=MOST_STARTS)
        self.started_at = 0

    def start(self, now: int) -> None:
        """Starts the process. Raises `GivenUp` if that was done too often lately."""
        if len(self._lately) == MOST_STARTS and now - self._lately[0] < WITHIN:
            raise GivenUp(f"the {self.name} process died {MOST_STARTS} times within {WITHIN // SECOND} s")
        self._lately.append(now)
        process = self._context.Process(
            target=self._target, args=self._arguments, name=f"lrmd-{self.name}", daemon=True
        )
        process.start()
        self._process, self.started_at = process, now
        self.starts += 1

    @property
    def pid(self) -> int | None:
        """Its process number."""
        return None if self._process is None else self._process.pid

    def ended(self) -> str | None:
        """How it ended, in words, or None while it runs."""
        code = None if self._process is None else self._process.exitcode
        if code is None:
            return None
        return f"killed by signal {-code}" if code < 0 else f"exit code {code}"

    def signal(self, number: int) -> None:
        """Sends it a signal, if it runs."""
        if self._process is not None and self._process.pid is not None and self._process.is_alive():
            os.kill(self._process.pid, number)

    def kill(self) -> None:
        """Ends it at once, even if it is stopped."""
        if self._process is not None:
            self._process.kill()
            self._process.join(1.0)

    def stop(self) -> None:
        """Asks it to end, waits, and makes it end."""
        if self._process is not None and self._process.is_alive():
            self._process.terminate()
            self._process.join(1.0)
        self.kill()
