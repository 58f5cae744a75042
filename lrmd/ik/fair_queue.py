"""Fair queueing (Nagle 1987): round robin between clients, then between the entries of a client."""

from __future__ import annotations

import threading
from collections import OrderedDict, deque
from collections.abc import Callable, Iterator
from typing import Generic, TypeVar

from lrmd.errors import RequestError

T = TypeVar("T")


class FairQueue(Generic[T]):
    """Entries that are worked on by turns until they are removed; safe between threads.

    `capacity`: entries altogether, `share`: of one client.
    """

    def __init__(self, capacity: int, share: int) -> None:
        self._capacity, self._share = capacity, share
        self._clients: OrderedDict[str, deque[T]] = OrderedDict()
        self._changed = threading.Condition()

    def __len__(self) -> int:
        with self._changed:
            return sum(map(len, self._clients.values()))

    def __iter__(self) -> Iterator[T]:
        with self._changed:
            return iter([entry for entries in self._clients.values() for entry in entries])

    def add(self, client: str, entry: T) -> None:
        """Appends an entry of a client. Raises `RequestError` if there is no room, or no room for this client."""
        with self._changed:
            if sum(map(len, self._clients.values())) >= self._capacity:
                raise RequestError("busy", f"{self._capacity} queries are waiting; ask again", retryable=True)
            entries = self._clients.get(client, deque())
            if len(entries) >= self._share:
                text = f"{self._share} queries of this client are waiting, its share; ask again"
                raise RequestError("busy", text, retryable=True)
            entries.append(entry)
            self._clients[client] = entries
            self._changed.notify()

    def next(self, wanted: Callable[[T], bool] = lambda _: True) -> T | None:
        """The entry whose turn it is among those that are wanted; it and its client go to the end. None: no such."""
        with self._changed:
            for client, entries in self._clients.items():
                for entry in entries:
                    if wanted(entry):
                        entries.remove(entry)
                        entries.append(entry)
                        self._clients.move_to_end(client)
                        return entry
        return None

    def remove(self, client: str, entry: T) -> bool:
        """Takes an entry out; returns whether it was there."""
        with self._changed:
            entries = self._clients.get(client, deque())
            if entry not in entries:
                return False
            entries.remove(entry)
            if not entries:
                del self._clients[client]
            return True

    def wait(self, seconds: float) -> bool:
        """Waits until there is an entry; whether there is."""
        with self._changed:
            return self._changed.wait_for(lambda: bool(self._clients), seconds)
