"""The simulated SO-101 and its tracker as processes of their own."""

from __future__ import annotations

import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from lrm_math.errors import LrmError

SPEED = 10.0
"""Of the simulated clock, if none is asked for."""


@contextmanager
def simulated_so101(
    folder: Path, effect: str, seed: int, kind: str = "feetech", speed: float = SPEED, dead_time: float = 0.0
) -> Iterator[Path]:
    """Runs the bus, whose servos act on a goal after a dead time (s); yields its serial device. Raises `LrmError`."""
    link = folder / "so101"
    words = [
        sys.executable,
        "-m",
        "examples.so101",
        str(link),
        effect,
        str(seed),
        str(speed),
        kind,
        f"--dead-time={dead_time}",
        "--end-with-parent",
    ]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        if not process.stdout.readline():
            raise LrmError(f"the simulated bus ended with exit code {process.wait()}")
        yield link
    finally:
        process.terminate()
        process.wait()


@contextmanager
def simulated_camera(link: Path) -> Iterator[str]:
    """Runs the camera beside the bus; yields the address of its picture. Raises `LrmError`."""
    process = subprocess.Popen(
        [sys.executable, "-m", "examples.so101.camera", str(link), "0"], stdout=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout is not None
        said = process.stdout.readline()
        if not said:
            raise LrmError(f"the simulated camera ended with exit code {process.wait()}")
        yield said.split()[-1]
    finally:
        process.terminate()
        process.wait()


@contextmanager
def simulated_tracker(link: Path, seed: int) -> Iterator[str]:
    """Runs the tracker beside the bus; yields it by the name that `--tracker` takes."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = str(probe.getsockname()[1])
    process = subprocess.Popen(
        [sys.executable, "-m", "examples.so101.tracker", str(link), port, str(seed)], stdout=subprocess.DEVNULL
    )
    try:
        yield f"dtrack:{port}"
    finally:
        process.terminate()
        process.wait()
