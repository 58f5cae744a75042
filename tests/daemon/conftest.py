"""The configuration of the daemon's tests."""

from __future__ import annotations

import pytest

from lrmd.config import Config, load_config
from tests.support.daemon.in_memory_daemon import CONFIG


@pytest.fixture(scope="session")
def config() -> Config:
    """The shipped one."""
    return load_config(CONFIG)
