"""Writing of the state, in a thread of its own, so that a slow disk does not block the daemon.

It is saved on change, at least once a minute, and during a motion only at an interval.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

from lrm_math.errors import FileError
from lrmd.persistence.state_file import StoredState, save

INTERVAL = 60_000_000_000
"""ns after which it is saved without a change too."""


class SaveSchedule:
    """`moving_interval`: ns between two states that are saved during a motion."""

    def __init__(self, moving_interval: int) -> None:
        self._moving_interval = moving_interval
        self._at = 0
        self._state: tuple[object, ...] = ()
        self._moving = False

    def due(self, state: tuple[object, ...], moving: bool, now: int) -> bool:
        """Whether to save at `now` (ns); if so, it is the saved state from now on."""
        wait = self._moving_interval if moving and self._moving else 0
        changed = state != self._state and now - self._at >= wait
        if not changed and now - self._at <= INTERVAL:
            return False
        self._at, self._state, self._moving = now, state, moving
        return True


class BackgroundWriter:
    """`on_change` is called with the error when writing fails, and with None when it works again."""

    def __init__(self, folder: Path, on_change: Callable[[FileError | None], None]) -> None:
        self._folder, self._on_change = folder, on_change
        self._wake = threading.Condition()
        self._next: StoredState | None = None
        self._ending = False
        self._broken = False
        self._thread = threading.Thread(target=self._run, name="writer", daemon=True)
        self._thread.start()

    def put(self, state: StoredState) -> None:
        """Queues a state; it replaces one that is not written yet."""
        with self._wake:
            self._next = state
            self._wake.notify()

    def close(self) -> None:
        """Waits until the queued state is saved."""
        with self._wake:
            self._ending = True
            self._wake.notify()
        self._thread.join(5.0)

    def _run(self) -> None:
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._next is not None or self._ending)
                state, self._next = self._next, None
            if state is None:
                return
            self._save(state)

    def _save(self, state: StoredState) -> None:
        failure = None
        try:
            save(self._folder, state)
        except FileError as error:
            failure = error
        if self._broken is (failure is None):
            self._on_change(failure)
        self._broken = failure is not None
