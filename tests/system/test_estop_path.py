"""The emergency stop passes through no busy process: the router process takes it, and signals the ramp itself."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest
import zenoh

from lrm_math.errors import LrmError
from lrmd.api.router_process import NICENESS
from lrmd.messages.codec import pack
from lrmd.messages.control import EstopCommand
from lrmd.messages.zenoh_session import client
from tests.support.daemon.daemon_harness import FAR, DaemonHarness
from tests.support.daemon.daemon_process import wait_for

UNREADABLE = "a message that cannot be read"
REASONS = {"put": "a put", "put to all robots": "for all", "unreadable": UNREADABLE, "query": "asked"}


def test_it_stops_the_arm_while_the_api_process_is_stopped(harness: DaemonHarness) -> None:
    with zenoh.open(client([harness.setup.endpoint])) as session:
        stops: dict[str, Callable[[], object]] = {
            "put": lambda: session.put(harness.setup.key("cmd/estop"), pack(EstopCommand(why="a put"))),
            "put to all robots": lambda: session.put("lrm/*/cmd/estop", pack(EstopCommand(why="for all"))),
            "unreadable": lambda: session.put(harness.setup.key("cmd/estop"), b"\xc1"),
            "query": lambda: harness.rover.estop("asked"),
        }
        for how, stop in stops.items():
            with harness.rover.control("test", take=True):
                if harness.mode() == "estop":
                    harness.rover.reset_fault()
                harness.arm()
                harness.rover.move(FAR, wait=False)
                harness.daemon.signal(signal.SIGSTOP)
                try:
                    stop()
                    wait_for(lambda: not harness.pulses(), "the pulses stop")
                finally:
                    harness.daemon.signal(signal.SIGCONT)
            harness.wait_for_mode("estop")
            (fault,) = harness.rover.faults().faults
            assert fault.text == f"emergency stop: {REASONS[how]}"


def test_what_is_put_on_everything_is_no_emergency_stop(harness: DaemonHarness) -> None:
    with harness.rover.control("test"), zenoh.open(client([harness.setup.endpoint])) as session:
        harness.arm()
        for pattern in ("lrm/**", "**", "lrm/rover/cmd/*", "lrm/*/*/estop"):
            session.put(pattern, b"anything")
        list(session.get("lrm/rover/**", payload=b"anything", timeout=2.0))
        harness.rover.move({"joint1": 0.02})
        assert harness.mode() == "armed"


def test_the_reply_says_that_the_ramp_has_it(harness: DaemonHarness) -> None:
    """While the ramp is stopped, there is no confirmation; the signal waits for the ramp, or for the one after it."""
    with harness.rover.control("test", take=True):
        harness.arm()
        os.kill(harness.daemon.child("ramp"), signal.SIGSTOP)
        with pytest.raises(LrmError, match="did not confirm") as error:
            harness.rover.estop("ramp stopped")
        assert getattr(error.value, "code", "") == "estop_unconfirmed"
        wait_for(lambda: not harness.pulses(), "the pulses stop")
        harness.wait_for_mode("estop")


def test_the_router_has_a_thread_for_each_of_many_clients_and_goes_before_ordinary_work(own: DaemonHarness) -> None:
    router = own.daemon.child("router")
    names = [path.read_text().strip() for path in Path(f"/proc/{router}/task").glob("*/comm")]
    assert len({name for name in names if name.startswith("rx-")}) == 16
    said = "router_priority" in own.daemon.codes()
    assert said or os.getpriority(os.PRIO_PROCESS, router) == NICENESS


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_the_router_process_comes_back_and_nothing_moves_meanwhile(harness: DaemonHarness, number: int) -> None:
    deaths = harness.daemon.codes().count("router_died")
    with suppress(LrmError), harness.rover.control("test", take=True):
        harness.arm()
        harness.rover.move(FAR, wait=False)
        time.sleep(0.2)
        os.kill(harness.daemon.child("router"), number)

    def answers() -> bool:
        with suppress(LrmError):
            return harness.mode() == "holding"
        return False

    wait_for(answers, "the daemon can be reached again, and holds: its client's lease was lost", seconds=20)
    assert harness.daemon.codes().count("router_died") == deaths + 1
    assert "name_taken" not in harness.daemon.codes()
    harness.rover.estop("after that")
    wait_for(lambda: not harness.pulses(), "the pulses stop")


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
@pytest.mark.parametrize("stop", ["estop", "hold"])
def test_a_stop_is_repeated_until_confirmed(harness: DaemonHarness, stop: str, number: signal.Signals) -> None:
    """The lease is renewed by nobody meanwhile, so that a motion would end by itself, too; pulses would not."""
    with harness.rover.control("test"):
        harness.arm()
        os.kill(harness.daemon.child("router"), number)
        time.sleep(0.02)
        if stop == "estop":
            harness.rover.estop("while the router restarts")
            assert not harness.pulses()
        else:
            harness.rover.hold()
            assert harness.pulses()
    harness.wait_for_mode("estop" if stop == "estop" else "holding")
