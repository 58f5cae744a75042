"""The child processes of the daemon, and the memory that they share with the api process."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from typing import Self

from lrmd.api import router_process
from lrmd.api.router_setup import router_setup
from lrmd.api.supervisor import ChildProcess, RestartLimitExceeded
from lrmd.config import Config
from lrmd.ik import entry as ik_entry
from lrmd.messages.codec import new_boot_id
from lrmd.ramp import process as ramp_process
from lrmd.ramp.setup import ramp_setup
from lrmd.ramp.shared_fd import SharedFd
from lrmd.ramp.shared_memory import SharedRecords


class ChildProcesses:
    """`with` starts those that take long to load and touch no hardware, while the api process loads itself.

    `boot_id`: identifier of this start of the daemon, in the messages of all of its processes.
    """

    def __init__(self, config: Config, speed: float = 1.0) -> None:
        """`speed`: ratio of a simulated board's clock to real time. Raises `FileError` for zenoh's configuration."""
        self.shared, self.boot_id = SharedRecords.create(), new_boot_id()
        memory = SharedFd(self.shared.descriptor)
        estop = SharedFd(os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC))
        self.ramp = ChildProcess("ramp", ramp_process.run, ramp_setup(config, speed, memory, estop))
        self.ik = ChildProcess("ik", ik_entry.run, config, memory, self.boot_id)
        router = router_setup(config, memory, estop, self.boot_id)
        self.router = ChildProcess("router", router_process.run, router)

    def __enter__(self) -> Self:
        now = time.monotonic_ns()
        self.ik.start(now)
        self.router.start(now)
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def wait_for_router(self, listen: Sequence[str], timeout: int) -> None:
        """Waits until the router on addresses `listen` routes. Raises `RestartLimitExceeded` after `timeout` (ns)."""
        deadline = time.monotonic_ns() + timeout
        while not self.shared.router[0]:
            if (ended := self.router.ended()) or time.monotonic_ns() > deadline:
                how = f"ended ({ended}); another program may use the address" if ended else "does not answer"
                raise RestartLimitExceeded(f"no zenoh router on {', '.join(listen)}: its process {how}")
            time.sleep(0.002)

    def wait_for_ramp(self, timeout: int) -> None:
        """Waits until the ramp has ticked or ended, or for `timeout` (ns)."""
        deadline = time.monotonic_ns() + timeout
        while self.shared.read_report() is None and time.monotonic_ns() < deadline and not self.ramp.ended():
            time.sleep(0.002)

    def wait_for_order(self, number: int, timeout: int) -> None:
        """Waits until the ramp has read an order, or for `timeout` (ns): then it is known where a motion begins."""
        deadline = time.monotonic_ns() + timeout
        while (report := self.shared.read_report()) and report.order != number and time.monotonic_ns() < deadline:
            time.sleep(0.001)

    def stop(self) -> None:
        """Ends all of them."""
        for child in (self.ramp, self.ik, self.router):
            child.stop()
