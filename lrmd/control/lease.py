"""Lease on the arm: one client at a time may command; the lease expires unless its holder renews it.

Theory of operation: a lease is free, held, or expired. It expires by time alone, which the controller looks at before
every request and in every cycle, so that nobody finds it held by a client that is gone. The holder of an expired lease
may acquire it anew with its old token as proof, as long as nobody else has had it, within `LATE`; it gets a new token,
so that commands under way with the old one stay refused. A computer that wakes up hours later, and a program on it that
goes on, have to ask as everybody does. What is not in the table is refused.
"""

from __future__ import annotations

import secrets
from dataclasses import dataclass, replace
from enum import StrEnum

from lrmd.config import SECOND
from lrmd.errors import RequestError

LATE = 10 * SECOND
"""ns after which a client is not late any more, but was away."""


class LeaseError(RequestError):
    """No lease, another client's lease, or an expired one."""

    def __init__(self, text: str) -> None:
        super().__init__("lease", text, retryable=True)


class LeaseState(StrEnum):
    """State of the right to command: free, the holder's, or nobody's since the holder gave no sign of life."""

    FREE = "free"
    HELD = "held"
    EXPIRED = "expired"


class LeaseEvent(StrEnum):
    """Input of the lease: requests, `PROVE` with the token of the lease, and the passing of its time."""

    ACQUIRE = "acquire"
    TAKE = "acquire with take"
    PROVE = "acquire with the expired lease"
    RENEW = "renew"
    RELEASE = "release"
    TIME_OUT = "time out"


TABLE: dict[tuple[LeaseState, LeaseEvent], LeaseState] = {
    (LeaseState.FREE, LeaseEvent.ACQUIRE): LeaseState.HELD,
    (LeaseState.FREE, LeaseEvent.TAKE): LeaseState.HELD,
    (LeaseState.HELD, LeaseEvent.TAKE): LeaseState.HELD,
    (LeaseState.HELD, LeaseEvent.RENEW): LeaseState.HELD,
    (LeaseState.HELD, LeaseEvent.RELEASE): LeaseState.FREE,
    (LeaseState.HELD, LeaseEvent.TIME_OUT): LeaseState.EXPIRED,
    (LeaseState.EXPIRED, LeaseEvent.ACQUIRE): LeaseState.HELD,
    (LeaseState.EXPIRED, LeaseEvent.TAKE): LeaseState.HELD,
    (LeaseState.EXPIRED, LeaseEvent.PROVE): LeaseState.HELD,
}
"""The state after an event; a pair that is missing is refused."""


@dataclass(frozen=True)
class Lease:
    """`holder` may command with `token` until `until` (monotonic ns), while `state` is held."""

    state: LeaseState = LeaseState.FREE
    holder: str = ""
    token: str = ""
    until: int = 0

    @property
    def held(self) -> bool:
        """Whether somebody may command."""
        return self.state is LeaseState.HELD

    def at(self, now: int) -> Lease:
        """The lease at a time (monotonic ns): expired if its holder did not renew it."""
        return self._after(LeaseEvent.TIME_OUT) if self.held and now >= self.until else self

    def acquired(self, holder: str, now: int, lifetime: int, take: bool, proof: str | None) -> Lease:
        """The lease of `holder` for `lifetime` (ns), with a new token. Raises `LeaseError`.

        `take`: also if another client holds it. `proof`: token of the expired lease, which then nobody else has had.
        """
        if proof is not None and (self.state is not LeaseState.EXPIRED or proof != self.token):
            raise LeaseError("this lease has not expired, or another client had one since: acquire without it")
        if proof is not None and now - self.until > LATE:
            raise LeaseError(f"this lease expired more than {LATE // SECOND} s ago: acquire without it")
        event = LeaseEvent.TAKE if take else LeaseEvent.ACQUIRE
        after = self._after(LeaseEvent.PROVE if proof is not None else event)
        return replace(after, holder=holder, token=secrets.token_hex(8), until=now + lifetime)

    def renewed(self, token: str | None, now: int, lifetime: int) -> Lease:
        """The lease, extended by `lifetime` (ns). Raises `LeaseError` if `token` is not that of the holder."""
        self.check(token)
        return replace(self._after(LeaseEvent.RENEW), until=now + lifetime)

    def released(self, token: str | None) -> Lease:
        """The free lease. Raises `LeaseError` if `token` is not that of the holder."""
        self.check(token)
        self._after(LeaseEvent.RELEASE)
        return Lease()

    def check(self, token: str | None) -> None:
        """Raises `LeaseError` unless `token` is that of the holder."""
        if token is None:
            raise LeaseError("this needs a lease; ask for one with rpc/lease")
        if not self.held:
            raise LeaseError("the lease has run out; renew it well within its lease_ms, or acquire a new one")
        if self.token != token:
            raise LeaseError(f"the lease is {self.holder}'s now")

    def _after(self, event: LeaseEvent) -> Lease:
        try:
            return replace(self, state=TABLE[self.state, event])
        except KeyError:
            who = f"{self.holder} holds the lease" if self.held else f"the lease is {self.state}"
            right = 'wait for its release, or take it over (--take; "take": true in rpc/lease)'
            raise LeaseError(f"{who}; {right}") from None
