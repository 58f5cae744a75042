"""A clock for a program that moves an arm and waits in between, driven step by step from a test beside it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from lrm_math.errors import LrmError

PATIENCE_S = 20.0


class Lockstep:
    """Time of a simulated arm, and of one program at a time that sleeps by it; only one of both ever runs.

    `on_time`: called with each new time (s). `failed`: errors of programs, in words.
    """

    def __init__(self, on_time: Callable[[float], None]) -> None:
        self._on_time = on_time
        self._t = 0.0
        self._wake = 0.0
        self._program: threading.Thread | None = None
        self._go, self._back = threading.Semaphore(0), threading.Semaphore(0)
        self._interrupted = False
        self.failed: list[str] = []

    def now(self) -> float:
        return self._t

    def sleep(self, seconds: float) -> None:
        """See `Clock`: the program waits until the test has let so much time pass; others let it pass."""
        if threading.current_thread() is not self._program:
            self.passes(seconds)
            return
        self._wake = self._t + max(0.0, seconds)
        self._back.release()
        self._go.acquire()
        if self._interrupted:
            raise KeyboardInterrupt

    def starts(self, program: Callable[[], object]) -> None:
        """Starts a program, until it sleeps or ends."""
        self._interrupted = False
        self._program = threading.Thread(target=self._run, args=(program,), daemon=True)
        self._program.start()
        assert self._back.acquire(timeout=PATIENCE_S)

    def interrupts(self) -> None:
        """Interrupts the program where it sleeps, as Ctrl-C does, and comes back when it has ended."""
        if self.running:
            self._interrupted = True
            self._resume()
            assert not self.running

    def passes(self, seconds: float) -> None:
        """Lets time pass (s)."""
        end = self._t + seconds
        while self._t < end or (self.running and self._wake <= end):
            self._t = min(end, max(self._t, self._wake)) if self.running else end
            self._on_time(self._t)
            if self.running and self._wake <= self._t:
                self._resume()

    def abandons(self) -> None:
        """Never wakes the program again, as if it had been killed."""
        self._done = True

    @property
    def running(self) -> bool:
        """Whether there is a program that sleeps."""
        return self._program is not None and self._program.is_alive() and not self._done

    @contextmanager
    def ended(self) -> Iterator[None]:
        """Ends the program at last."""
        try:
            yield
        finally:
            self.interrupts()

    _done = True

    def _resume(self) -> None:
        self._go.release()
        assert self._back.acquire(timeout=PATIENCE_S)

    def _run(self, program: Callable[[], object]) -> None:
        self._done = False
        try:
            program()
        except KeyboardInterrupt:
            pass
        except LrmError as error:
            self.failed.append(str(error))
        finally:
            self._done = True
            self._back.release()
