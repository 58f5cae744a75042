"""The browser of the workbench's tests."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from tests.support.browser import RunningWorkbench, browser_path, chromium, workbench
from tests.support.commands import part_of_example


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """A headless Chromium."""
    with chromium() as found:
        yield found


@pytest.fixture(scope="session")
def small(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningWorkbench]:
    """A workbench on a part of the shipped data set, for what does not depend on the number of poses.

    Every test leaves it with the fit alone.
    """
    assert browser_path()
    folder = tmp_path_factory.mktemp("small")
    with workbench(part_of_example(folder), cwd=folder) as found:
        yield found
