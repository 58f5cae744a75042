"""Watch over who sends orders: what an order is newer than, and whether its sender still runs.

Theory of operation. An order may wait anywhere: in its sender, a router, this bridge. Its receipt does not say for
how long, and no other computer's clock is trusted. But what one session sends stays in order on its way to here (same
priority, same links). So an order that comes after a session's answer to a question was sent after that question was
asked (causal order: Lamport 1978). Each sender's session is asked again and again, and at once when the daemon counts
another stop; a question remembers the count. A move tells the daemon this count, and is refused after a further stop.

The same answers say that a sender runs. A frozen process keeps its liveliness tokens until its router gives it up,
after 10 to 60 s. Its session answers queries of its admin space by itself, unless the process is stopped or out of
reach; `rmw_zenoh` has that enabled.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from functools import partial

from lrm_math.errors import LrmError
from lrm_ros2.trajectory import STALE_S
from lrmd.client import ModeState

PERIOD_S, SILENT_S = 0.15, 0.6
"""s between two questions; without an answer for so long a sender is lost."""
OVERTAKEN_S = 0.6
"""s by which the end of a token may overtake the last order of its sender: it has a higher priority in zenoh."""
SESSION_PART, KIND_PART, NAME_PART = 2, 5, 9
"""Places in a token of `rmw_zenoh`: `@ros2_lv/domain/session/node/entity/kind/enclave/namespace/node/name/…`."""


@dataclass(frozen=True)
class SenderEnd:
    """An end of ROS's graph that orders come from: its kind in a token (MP: publisher, SC: client), and its name."""

    kind: str
    name: str

    def has(self, token: str) -> bool:
        """Whether a liveliness token is of such an end."""
        parts, mangled = token.split("/"), self.name.replace("/", "%")
        return len(parts) > NAME_PART and (parts[KIND_PART], parts[NAME_PART]) == (self.kind, mangled)


@dataclass(frozen=True)
class StopsKnown:
    """Stops that one start of the daemon had counted, as known at a time (s, of this machine's monotonic clock)."""

    boot_id: str
    stops: int
    at: float

    @property
    def age(self) -> float:
        """s since then."""
        return time.monotonic() - self.at


def session_of(token: str) -> str:
    """The id of the zenoh session that declared a liveliness token."""
    return token.split("/")[SESSION_PART]


class SenderWatch:
    """`ask` sends a question to a session without waiting, and calls back on its answer in the order of arrivals.

    `ends`: where orders come from. Of their senders' tokens is known when each went, at infinity those that are there.
    """

    def __init__(self, ask: Callable[[str, Callable[[], None]], object], ends: Collection[SenderEnd]) -> None:
        self._ask, self._ends = ask, ends
        self._lock = threading.Lock()
        self._left: dict[str, float] = {}
        self._daemon: StopsKnown | None = None
        self._answered: dict[str, StopsKnown] = {}

    def token(self, token: str, there: bool) -> None:
        """A liveliness token of ROS has come, or gone. The first one of a session, whatever it is of, is a reason to
        ask it: its first order may follow soon. One that goes may overtake the last order of its sender."""
        if token.count("/") < NAME_PART - 1 or not session_of(token).isalnum():
            return
        session, now = session_of(token), time.monotonic()
        with self._lock:
            self._left = {one: left for one, left in self._left.items() if now - left < OVERTAKEN_S}
            kept = {session, *map(session_of, self._left)}
            self._answered = {one: known for one, known in self._answered.items() if one in kept or known.age < STALE_S}
            if sends := any(end.has(token) for end in self._ends):
                self._left[token] = math.inf if there else now
            known = session in self._answered
        if there and (sends or not known):
            self._ask_all([session])

    def of(self, end: SenderEnd) -> frozenset[str]:
        """Tokens of the senders that are there."""
        with self._lock:
            return frozenset(token for token, left in self._left.items() if left == math.inf and end.has(token))

    def counted(self, state: ModeState) -> None:
        """The daemon's state. All senders have been asked on return: what each sends then is newer than its stops."""
        with self._lock:
            before = self._daemon
            if before is None or before.boot_id != state.boot_id or state.stops > before.stops:
                self._daemon = StopsKnown(state.boot_id, state.stops, time.monotonic())
        self._ask_all(self._sessions())

    def newer_than(self, end: SenderEnd) -> StopsKnown:
        """What an order is newer than that has just come from an end, as read in the order of arrivals: from which of
        its senders, also of those that have just left, is not known.

        Raises `LrmError`: one of them has not answered yet, or not lately, or there is none.
        """
        now = time.monotonic()
        with self._lock:
            senders = [token for token, left in self._left.items() if end.has(token) and now - left < OVERTAKEN_S]
            found = [self._answered.get(session_of(token)) for token in senders]
        known = [one for one in found if one is not None]
        if not found:
            raise LrmError("its sender has no liveliness token: nothing is known of it")
        if len(known) < len(found):
            raise LrmError(
                "a sender's session has answered no question yet, so that its loss would not be seen: send it again "
                "if the sender has just begun; if not, is its admin space off?"
            )
        oldest = min(known, key=lambda one: one.at)
        if oldest.age > STALE_S:
            raise LrmError(f"it may have waited for {oldest.age:.1f} s; should be at most {STALE_S:g} s: send it again")
        return oldest

    def silent(self, senders: Iterable[str]) -> bool:
        """Whether a sender of some tokens is frozen, or out of reach."""
        with self._lock:
            found = [self._answered.get(session_of(token)) for token in senders]
        return any(one is None or one.age > SILENT_S for one in found)

    def run(self, ended: threading.Event) -> None:
        """Asks the senders until `ended`."""
        while not ended.wait(PERIOD_S):
            self._ask_all(self._sessions())

    def _sessions(self) -> set[str]:
        with self._lock:
            return {session_of(token) for token, left in self._left.items() if left == math.inf}

    def _ask_all(self, sessions: Iterable[str]) -> None:
        with self._lock:
            if self._daemon is None:
                return
            known = StopsKnown(self._daemon.boot_id, self._daemon.stops, time.monotonic())
        for session in sessions:
            self._ask(session, partial(self._note, session, known))

    def _note(self, session: str, known: StopsKnown) -> None:
        with self._lock:
            before = self._answered.get(session)
            if before is None or before.at < known.at:
                self._answered[session] = known
