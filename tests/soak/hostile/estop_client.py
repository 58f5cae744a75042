"""A stranger with the emergency stop at hand: `python -m tests.soak.hostile.estop_client ENDPOINT KEY`.

For every line that it reads it puts one message, and prints the time (monotonic ns) just before. A client on a computer
of its own does not wait for the processors of this one; so it goes before ordinary work, where that is allowed.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Self

import msgpack
import zenoh

SETTLING_S = 0.2
"""After the connection is made: whoever has the stop at hand is connected before he needs it."""
ROOT = Path(__file__).resolve().parents[3]


def serve(endpoint: str, key: str) -> None:
    """Reads lines until its input ends."""
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    config = zenoh.Config()
    for place, value in {
        "mode": '"client"', "connect/endpoints": f'["{endpoint}"]', "scouting/multicast/enabled": "false",
    }.items():  # fmt: skip
        config.insert_json5(place, value)
    with zenoh.open(config) as session:
        publisher = session.declare_publisher(key, express=True)
        time.sleep(SETTLING_S)
        print("ready", flush=True)
        for _ in sys.stdin:
            print(time.monotonic_ns(), flush=True)
            publisher.put(msgpack.packb({"v": 1, "why": "trial"}))


class EstopClient:
    """That client as a process of its own, from `with` to its end."""

    def __init__(self, endpoint: str, key: str) -> None:
        command = [sys.executable, "-m", "tests.soak.hostile.estop_client", endpoint, key]
        self._process = subprocess.Popen(
            command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._ask, self._answers = self._process.stdin, self._process.stdout
        assert self._answers.readline() == "ready\n", "the client of the emergency stop reached nobody"

    def stop(self) -> int:
        """Puts an emergency stop; monotonic ns just before."""
        self._ask.write("\n")
        return int(self._answers.readline())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()


if __name__ == "__main__":
    serve(*sys.argv[1:])
