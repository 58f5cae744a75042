"""Clients with larger messages leave no memory behind, in the daemon or in /dev/shm; a hundred: `make soak`."""

from __future__ import annotations

from tests.soak.hostile.client_memory import GROWTH_MB, measure


def test_clients_that_come_and_go_leave_no_memory_behind() -> None:
    before, after = measure(8)
    assert after.growth(before) < GROWTH_MB
