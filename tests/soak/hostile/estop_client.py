"""A stranger with the emergency stop at hand: `python -m tests.soak.hostile.estop_client ENDPOINT KEY`.

For every line that it reads it puts one message, and prints the time (monotonic ns) just before. A client on a computer
of its own does not wait for the processors of this one; so it goes before ordinary work, where that is allowed.
"""

from __future__ import annotations

import os
import sys
import time
from contextlib import suppress

import msgpack
import zenoh

from tests.support.module_process import ModuleProcess

SETTLING_S = 0.2
"""After the connection is made: whoever has the stop at hand is connected before he needs it."""


def foreign(endpoint: str) -> zenoh.Config:
    """The settings that a foreign client has."""
    config = zenoh.Config()
    for place, value in {
        "mode": '"client"', "connect/endpoints": f'["{endpoint}"]', "scouting/multicast/enabled": "false",
    }.items():  # fmt: skip
        config.insert_json5(place, value)
    return config


def serve(endpoint: str, key: str) -> None:
    """Reads lines until its input ends."""
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    with zenoh.open(foreign(endpoint)) as session:
        publisher = session.declare_publisher(key, express=True)
        time.sleep(SETTLING_S)
        print("ready", flush=True)
        for _ in sys.stdin:
            print(time.monotonic_ns(), flush=True)
            publisher.put(msgpack.packb({"v": 1, "why": "trial"}))


class EstopClient(ModuleProcess):
    """That client as a process of its own."""

    def __init__(self, endpoint: str, key: str) -> None:
        super().__init__("tests.soak.hostile.estop_client", endpoint, key)
        assert self.output.readline() == "ready\n", "the client of the emergency stop reached nobody"

    def stop(self) -> int:
        """Puts an emergency stop; monotonic ns just before."""
        self.input.write("\n")
        return int(self.output.readline())


if __name__ == "__main__":
    serve(*sys.argv[1:])
