"""Supervision of child processes: start, restart with a limit, stop."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from multiprocessing import get_context
from multiprocessing.process import BaseProcess
from typing import Any

from lrm_math.errors import LrmError
from lrmd.config import SECOND

MAX_STARTS, WITHIN = 10, 10 * SECOND


class RestartLimitExceeded(LrmError):
    """A process that died `MAX_STARTS` times `WITHIN` ns, or as often in a row before a sign of life."""


class ChildProcess:
    """A process made with `spawn`, and its restarts. `target` and its arguments must pickle."""

    def __init__(self, name: str, target: Callable[..., None], *arguments: Any) -> None:
        self.name, self.starts = name, 0
        self._target, self._arguments = target, arguments
        self._process: BaseProcess | None = None
        self._recent_starts: deque[int] = deque(maxlen=MAX_STARTS)
        self._failed_starts = 0
        self.started_at = 0

    def start(self, now: int) -> None:
        """Starts the process."""
        self._recent_starts.append(now)
        name = f"lrmd-{self.name}"
        spawn = get_context("spawn").Process
        self._process = spawn(target=self._target, args=self._arguments, name=name, daemon=True)
        self._process.start()
        self.started_at = now
        self.starts += 1

    def restart(self, now: int, began: bool) -> None:
        """Starts it again. `began`: whether it had given a sign of life. Raises `RestartLimitExceeded`.

        Failed starts count in a row, however long each takes: a slow computer does not fit ten of them `WITHIN`.
        """
        self._failed_starts = 0 if began else self._failed_starts + 1
        often = len(self._recent_starts) == MAX_STARTS and now - self._recent_starts[0] < WITHIN
        if often or self._failed_starts == MAX_STARTS:
            self._failed_starts = 0
            how = f"within {WITHIN // SECOND} s" if often else "in a row before it worked"
            raise RestartLimitExceeded(f"the {self.name} process died {MAX_STARTS} times {how}")
        self.start(now)

    def ended(self) -> str | None:
        """Cause of its end, as text, or None while it runs."""
        code = None if self._process is None else self._process.exitcode
        if code is None:
            return None
        return f"killed by signal {-code}" if code < 0 else f"exit code {code}"

    def kill(self) -> None:
        """Ends it with SIGKILL, which works on a stopped process, too."""
        if self._process is not None:
            self._process.kill()
            self._process.join(1.0)

    def stop(self) -> None:
        """Ends it with SIGTERM, after 1 s with SIGKILL."""
        if self._process is not None and self._process.is_alive():
            self._process.terminate()
            self._process.join(1.0)
        self.kill()


def silence(heartbeat: int, timeout: int, now: int) -> str | None:
    """Fault of a process whose last heartbeat (monotonic ns, 0: none yet) is older than `timeout` (ns)."""
    return f"no sign of life for {timeout // SECOND} s" if 0 < heartbeat < now - timeout else None
