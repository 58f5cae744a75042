"""Time of a servo bus that no test waits for."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count
from types import SimpleNamespace
from unittest.mock import patch

import pytest

from lrm_ident.measuring.servo_bus import bus


@pytest.fixture(scope="module")
def hurried() -> Iterator[None]:
    """Nobody waits for answers that do not come: each look at the clock is 20 ms later."""
    looks = count()
    with patch.object(bus, "time", SimpleNamespace(monotonic=lambda: 0.02 * next(looks))):
        yield
