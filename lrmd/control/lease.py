"""One writer at a time: a lease that its holder keeps alive, and loses half a second after its last sign of life."""

from __future__ import annotations

import secrets
from dataclasses import dataclass, replace

from lrm_math.errors import LrmError


class LeaseError(LrmError):
    """No lease, another's lease, or one that has run out."""


@dataclass(frozen=True)
class Lease:
    """Who may command, until when (monotonic ns)."""

    holder: str
    token: str
    until: int


def acquire(present: Lease | None, holder: str, now: int, lifetime: int, take: bool) -> Lease:
    """A new lease for `holder`. Raises `LeaseError` if somebody else has one, unless it is to be taken over."""
    if present is not None and now < present.until and not take:
        raise LeaseError(f"{present.holder} holds the lease; wait for its release, or take it over (take = true)")
    return Lease(holder, secrets.token_hex(8), now + lifetime)


def renew(present: Lease | None, token: str | None, now: int, lifetime: int) -> Lease:
    """The lease, alive for another lifetime. Raises `LeaseError` if it is not `token`'s, or has run out."""
    return replace(checked(present, token, now), until=now + lifetime)


def checked(present: Lease | None, token: str | None, now: int) -> Lease:
    """The lease, if `token` is its token and it is alive. Raises `LeaseError` that says which of it is wrong."""
    if token is None:
        raise LeaseError("this needs a lease; ask for one with rpc/lease")
    if present is None or (present.token == token and now >= present.until):
        raise LeaseError("the lease has run out; renew it well within its lease_ms, or acquire a new one")
    if present.token != token:
        raise LeaseError(f"the lease is {present.holder}'s now")
    return present
