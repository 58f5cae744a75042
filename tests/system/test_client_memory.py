"""A hundred clients with larger messages leave no memory behind, in the daemon or in /dev/shm."""

from __future__ import annotations

from tests.soak.hostile.client_memory import CLIENTS, GROWTH_MB, measure


def test_clients_that_come_and_go_leave_no_memory_behind() -> None:
    before, after = measure(CLIENTS)
    assert after.growth(before) < GROWTH_MB
