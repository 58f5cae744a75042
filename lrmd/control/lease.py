"""Lease on the arm: one client at a time may command; the lease expires unless its holder renews it."""

from __future__ import annotations

import secrets
from dataclasses import dataclass, replace

from lrmd.errors import RequestError


class LeaseError(RequestError):
    """No lease, another client's lease, or an expired one."""

    def __init__(self, text: str) -> None:
        super().__init__("lease", text, retryable=True)


@dataclass(frozen=True)
class Lease:
    """`holder` may command with `token` until `until` (monotonic ns)."""

    holder: str
    token: str
    until: int


def acquire(present: Lease | None, holder: str, now: int, lifetime: int, take: bool) -> Lease:
    """A new lease for `holder`. Raises `LeaseError` if another client has one, unless `take` is set."""
    if present is not None and now < present.until and not take:
        raise LeaseError(f"{present.holder} holds the lease; wait for its release, or take it over (take = true)")
    return Lease(holder, secrets.token_hex(8), now + lifetime)


def renew(present: Lease | None, token: str | None, now: int, lifetime: int) -> Lease:
    """The lease, extended by `lifetime` (ns). Raises `LeaseError` if it is not `token`'s, or has expired."""
    return replace(checked(present, token, now), until=now + lifetime)


def checked(present: Lease | None, token: str | None, now: int) -> Lease:
    """The lease, if `token` is its token and it has not expired. Raises `LeaseError`."""
    if token is None:
        raise LeaseError("this needs a lease; ask for one with rpc/lease")
    if present is None or (present.token == token and now >= present.until):
        raise LeaseError("the lease has run out; renew it well within its lease_ms, or acquire a new one")
    if present.token != token:
        raise LeaseError(f"the lease is {present.holder}'s now")
    return present
