"""Fair queueing (Nagle 1987) with push-out from the longest queue (Suter et al. 1998).

Clients take turns, then the entries of a client. When there is no room, whoever holds the most gives way to whoever
would hold less: its newest entry goes, never its last one. So a client without an entry gets in whatever others hold,
as long as fewer clients have entries than the capacity is times the largest load.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator
from functools import partial
from typing import Generic, TypeVar

from lrmd.errors import RequestError

T = TypeVar("T")


class FairQueue(Generic[T]):
    """Entries that are worked on by turns until they are removed; safe between threads.

    `capacity`: of the loads of all entries together; `load`: of one entry, positive.
    """

    def __init__(self, capacity: int, load: Callable[[T], int] = lambda _: 1) -> None:
        self._capacity, self._load = capacity, load
        self._clients: OrderedDict[str, list[T]] = OrderedDict()
        self._turns: dict[str, int] = {}
        self._changed = threading.Condition()

    def __len__(self) -> int:
        with self._changed:
            return sum(map(len, self._clients.values()))

    def __iter__(self) -> Iterator[T]:
        with self._changed:
            return iter([entry for entries in self._clients.values() for entry in entries])

    def held(self, client: str) -> int:
        """Load of all entries of a client."""
        with self._changed:
            return _total(self._loads(), client)

    def add(self, client: str, entry: T) -> list[T]:
        """Appends an entry of a client; returns those that had to give way. Raises `RequestError`: there is no room."""
        with self._changed:
            pushed_out = [self._clients[name].pop() for name in self._givers(client, self._load(entry))]
            self._clients.setdefault(client, []).append(entry)
            self._turns.setdefault(client, 0)
            self._changed.notify()
            return pushed_out

    def _loads(self) -> dict[str, list[int]]:
        return {client: list(map(self._load, entries)) for client, entries in self._clients.items()}

    def _givers(self, client: str, load: int) -> list[str]:
        """Clients whose newest entries make room, in order, for one of a client. Raises `RequestError`."""
        loads, givers = self._loads(), []
        would_hold = _total(loads, client) + load
        while sum(map(sum, loads.values())) + load > self._capacity:
            several = [name for name in loads if len(loads[name]) > 1]
            longest = max(several, key=partial(_total, loads), default="")
            if _total(loads, longest) <= would_hold:
                raise RequestError("busy", "the queue is full; ask again", retryable=True)
            givers.append(longest)
            loads[longest].pop()
        return givers

    def next(self, wanted: Callable[[T], bool] = lambda _: True) -> T | None:
        """The entry whose turn it is among those that are wanted; it and its client go to the end. None: no such."""
        with self._changed:
            for client, entries in self._clients.items():
                first = self._turns[client] % len(entries)
                for place in [*range(first, len(entries)), *range(first)]:
                    entry: T = entries[place]
                    if wanted(entry):
                        self._turns[client] = place + 1
                        self._clients.move_to_end(client)
                        return entry
        return None

    def remove(self, client: str, entry: T) -> bool:
        """Takes an entry out; returns whether it was there."""
        with self._changed:
            entries = self._clients.get(client, [])
            if entry not in entries:
                return False
            place = entries.index(entry)
            del entries[place]
            self._turns[client] -= place < self._turns[client]
            if not entries:
                del self._clients[client], self._turns[client]
            return True

    def wait(self, seconds: float) -> bool:
        """Waits until there is an entry; whether there is."""
        with self._changed:
            return self._changed.wait_for(lambda: bool(self._clients), seconds)


def _total(loads: dict[str, list[int]], client: str) -> int:
    return sum(loads.get(client, ()))
