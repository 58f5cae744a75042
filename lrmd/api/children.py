"""The child processes of the daemon, their start arguments, and the memory that they share with the api process."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from typing import Self

from lrmd.api import router_process
from lrmd.api.router_process import EstopReplies, RouterSetup
from lrmd.api.supervisor import ChildProcess, RestartLimitExceeded
from lrmd.config import MS, Config
from lrmd.control.state_machine import Mode
from lrmd.errors import RequestError
from lrmd.ik import entry as ik_entry
from lrmd.messages.codec import HeaderSource, error_reply, new_boot_id
from lrmd.messages.control import Reply
from lrmd.messages.zenoh_session import GONE_KEY, key, router, wildcard_error, with_rate_limits
from lrmd.ramp import process as ramp_process
from lrmd.ramp.board_link import BoardSettings, ServoOutput
from lrmd.ramp.parent import SharedFd
from lrmd.ramp.process import RampSetup
from lrmd.ramp.shared_memory import SharedRecords


def board_settings(config: Config, speed: float = 1.0) -> BoardSettings:
    """Settings of the board, for a clock that runs at `speed` times real time."""
    return BoardSettings(
        servos=tuple(ServoOutput(servo.channel, servo.lowest, servo.highest) for servo in config.servos),
        prescale=config.clock.prescale, count_s=config.clock.count_s, step=config.step, reply=config.reply,
        pause=config.link.silence_ms * MS // 2, silence_ms=config.link.silence_ms, simulated=speed != 1.0,
    )  # fmt: skip


def ramp_setup(config: Config, speed: float, memory: SharedFd, estop: SharedFd) -> RampSetup:
    """Start arguments of the ramp process. `speed`: ratio of a simulated board's clock to real time."""
    return RampSetup(
        board_settings(config, speed), config.link.port, config.link.baud, config.tick, config.realtime_priority, speed,
        memory, estop,
    )  # fmt: skip


def estop_replies(query: str, boot_id: str) -> EstopReplies:
    """The replies to the emergency stop on the key `query`."""
    silent = "the ramp did not confirm the stop in time; it reads the signal as soon as it ticks"
    stopped = Reply(**HeaderSource(boot_id).next(query), mode=Mode.ESTOP.value)
    errors = RequestError("estop_unconfirmed", silent, retryable=True), wildcard_error(query)
    return EstopReplies(stopped.model_dump(), *(error_reply(error, boot_id).model_dump() for error in errors))


def router_setup(config: Config, memory: SharedFd, estop: SharedFd, boot_id: str) -> RouterSetup:
    """Start arguments of the router process. Raises `FileError` for a zenoh configuration that cannot be read."""
    query = key(config.robot, "rpc/estop")
    keys = key(config.robot, "cmd/estop"), key("*", "cmd/estop")
    zenoh = str(with_rate_limits(router(config.zenoh)))
    return RouterSetup(zenoh, keys, query, GONE_KEY, estop_replies(query, boot_id), memory, estop)


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

    def stop(self) -> None:
        """Ends all of them."""
        for child in (self.ramp, self.ik, self.router):
            child.stop()
