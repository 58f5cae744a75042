"""The configuration of the controller's tests."""

from __future__ import annotations

import pytest

from lrmd.config import Config
from tests.support.daemon.in_memory_daemon import config_at


@pytest.fixture(scope="session")
def config(tmp_path_factory: pytest.TempPathFactory) -> Config:
    """The shipped one at 330 Hz: a count is shorter than a step."""
    return config_at(330.0, tmp_path_factory.mktemp("config"))
