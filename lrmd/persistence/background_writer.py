"""Saves the newest state in a thread of its own: a slow disk must not hold up the daemon."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

from lrm_math.errors import FileError
from lrmd.persistence.state_file import Saved, save


class Writer:
    """`put` replaces what is not written yet. `failed` is called with the error, or None when it works again."""

    def __init__(self, folder: Path, failed: Callable[[FileError | None], None]) -> None:
        self._folder, self._failed = folder, failed
        self._wake = threading.Condition()
        self._next: Saved | None = None
        self._ending = False
        self._broken = False
        self._thread = threading.Thread(target=self._run, name="writer", daemon=True)
        self._thread.start()

    def put(self, state: Saved) -> None:
        """Leaves a state to be saved."""
        with self._wake:
            self._next = state
            self._wake.notify()

    def close(self) -> None:
        """Waits until what was put is saved."""
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

    def _save(self, state: Saved) -> None:
        try:
            save(self._folder, state)
        except FileError as error:
            if not self._broken:
                self._failed(error)
            self._broken = True
        else:
            if self._broken:
                self._failed(None)
            self._broken = False
