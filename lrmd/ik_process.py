"""The ik process: answers queries for inverse kinematics. Whatever it is busy with, the ramp does not notice."""

from __future__ import annotations

import signal
import threading
import time
from dataclasses import dataclass

import zenoh

from lrmd.config import ZenohTable
from lrmd.mailbox import Shared
from lrmd.messages import ErrorReply, pack
from lrmd.ramp_process import die_with_parent
from lrmd.shared_fd import SharedFd
from lrmd.zenoh_session import client, key, own_endpoints


@dataclass(frozen=True)
class IkSetup:
    """What the ik process is given at its start."""

    robot: str
    zenoh: ZenohTable
    memory: SharedFd


def run(setup: IkSetup) -> None:
    """The process: answers until it is told to stop or its parent is gone."""
    die_with_parent()
    ending = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: ending.set())
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    shared = Shared(setup.memory.number)

    def answer(query: zenoh.Query) -> None:
        with query:
            shared.ik[0] = time.monotonic_ns()
            end = time.perf_counter() + 3e-3
            while time.perf_counter() < end:
                pass
            query.reply_err(pack(ErrorReply(code="not_implemented", msg="no inverse kinematics yet")))
            shared.ik[0] = 0
            shared.ik[1] += 1

    with zenoh.open(client(own_endpoints(setup.zenoh), setup.zenoh.config)) as session:
        session.declare_queryable(key(setup.robot, "rpc/ik"), answer)
        ending.wait()
