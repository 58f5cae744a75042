"""The simulated SO-101 as a process of its own."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from lrm_math.errors import LrmError

SPEED = 10.0
"""Of the simulated clock."""


@contextmanager
def simulated_so101(folder: Path, effect: str, seed: int) -> Iterator[Path]:
    """Runs the bus; yields its serial device. Raises `LrmError`."""
    link = folder / "so101"
    words = [sys.executable, "-m", "examples.so101", str(link), effect, str(seed), str(SPEED)]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        if not process.stdout.readline():
            raise LrmError(f"the simulated bus ended with exit code {process.wait()}")
        yield link
    finally:
        process.terminate()
        process.wait()
