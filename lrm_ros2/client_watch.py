"""Watch over clients of the action: each is asked, again and again, whether its zenoh session still runs.

A process that is frozen keeps its liveliness tokens until its router gives it up, after 10 to 60 s. Its session answers
queries of its admin space by itself, unless the process is stopped or out of reach; `rmw_zenoh` has that enabled.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from functools import partial

PERIOD_S, SILENT_S = 0.15, 0.6
"""s between two questions; without an answer for so long a client is lost."""
SESSION_PART = 2
"""Place of the session's id in a liveliness token of `rmw_zenoh`."""


def session_of(token: str) -> str:
    """The id of the zenoh session that declared a liveliness token."""
    return token.split("/")[SESSION_PART]


class ClientWatch:
    """`ask` sends a question to a session and calls back on its answer, from any thread, without waiting."""

    def __init__(self, ask: Callable[[str, Callable[[], None]], object]) -> None:
        self._ask = ask
        self._lock = threading.Lock()
        self._heard: dict[str, float] = {}

    def answers(self, sessions: frozenset[str], patience: float = SILENT_S) -> bool:
        """Whether all of some sessions answer within a time (s)."""
        begun = time.monotonic()
        while time.monotonic() < begun + patience:
            self._ask_all(sessions)
            time.sleep(0.05)
            with self._lock:
                if all(self._heard.get(session, 0.0) >= begun for session in sessions):
                    return True
        return False

    def run(self, sessions: frozenset[str], ended: threading.Event, lost: Callable[[str], object]) -> None:
        """Asks sessions until `ended`; calls `lost` with each that is silent, once."""
        begun, missing = time.monotonic(), set[str]()
        while not ended.wait(PERIOD_S):
            self._ask_all(sessions)
            limit = time.monotonic() - SILENT_S
            with self._lock:
                silent = {one for one in sessions if max(begun, self._heard.get(one, 0.0)) < limit}
            for session in silent - missing:
                lost(session)
            missing = silent

    def _ask_all(self, sessions: frozenset[str]) -> None:
        for session in sessions:
            self._ask(session, partial(self._note, session))

    def _note(self, session: str) -> None:
        with self._lock:
            self._heard[session] = time.monotonic()
