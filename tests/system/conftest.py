"""One daemon for the tests of a file that leave it running, and one for each test that does not.

Three processes take two seconds of a core to start.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.daemon.daemon_harness import DaemonHarness, running_harness
from tests.support.daemon.daemon_process import COOL, LONGEST_LEASE, DaemonSetup


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[DaemonHarness]:
    with running_harness(DaemonSetup.make(tmp_path_factory.mktemp("daemon"), LONGEST_LEASE | COOL)) as harness:
        yield harness


@pytest.fixture
def harness(running: DaemonHarness) -> Iterator[DaemonHarness]:
    """Disarmed at first, whatever the test before it did."""
    running.begin()
    yield running
    running.check_invariants()


@pytest.fixture
def own(tmp_path: Path) -> Iterator[DaemonHarness]:
    """A daemon that its test may end."""
    with running_harness(DaemonSetup.make(tmp_path, LONGEST_LEASE)) as harness:
        yield harness
