"""A board, a daemon and a client in one hand, and the record of when servos were asked to be switched on."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Literal

from lrmd.client.rover import Rover
from lrmd.client.session import RequestRefused
from lrmd.config import load_config
from lrmd.messages.control import Event
from tests.support.daemon.daemon_process import BoardProcess, DaemonProcess, DaemonSetup, WaitTimeout, wait_for
from tests.support.daemon.pulse_invariants import PulseInvariants, pulse_invariants, read_frames

HOME = {f"joint{i}": 0.0 for i in range(1, 7)}
FAR = {"joint1": 1.5}
"""Half a minute away from `HOME`."""
Where = Literal["given", "stored", "board"]


class DaemonHarness:
    """`board_started`, `armed_at`: monotonic ns of the board's zero and of every request that switches servos on."""

    def __init__(self, setup: DaemonSetup, board: BoardProcess, daemon: DaemonProcess, rover: Rover) -> None:
        self.setup, self.board, self.daemon, self.rover = setup, board, daemon, rover
        self.config = load_config(setup.config)
        self.board_started = board.started_at()
        self.armed_at: list[int] = []
        self.begun, self.before = 0, rover.metrics()

    def begin(self) -> None:
        """Disarmed and without a fault, for the next of several tests: its events and counts are those from now on."""
        with self.rover.control("next", take=True):
            if self.mode() in ("fault", "estop"):
                self.rover.reset_fault()
            self.rover.relax()
        wait_for(lambda: (self.mode(), self.pulses()) == ("disarmed", []), "the arm is disarmed")
        self.begun, self.before = time.monotonic_ns(), self.rover.metrics()

    def events(self) -> list[Event]:
        """Events since it began."""
        return [event for event in self.rover.events() if event.t_mono_ns >= self.begun]

    def codes(self) -> list[str]:
        """Their codes."""
        return [event.code for event in self.events()]

    def more(self, name: str) -> int:
        """By how much a count of the metrics has grown since it began."""
        return int(getattr(self.rover.metrics(), name) - getattr(self.before, name))

    def arm(self, rover: Rover | None = None, where: Where = "given") -> None:
        """Arms at home, or where `where` says, once the board is ready."""
        self.armed_at.append(time.monotonic_ns())
        arm_when_ready(rover or self.rover, where, HOME if where == "given" else None)

    def mode(self) -> str:
        """The controller's mode."""
        return self.rover.mode().mode

    def wait_for_mode(self, mode: str) -> None:
        """Waits until the daemon has this mode. Raises `WaitTimeout` with the one that it has, and the last events."""
        try:
            wait_for(lambda: self.mode() == mode, f"the mode is {mode}")
        except WaitTimeout as late:
            late.add_note(f"mode {self.mode()}, pulses {self.pulses()}, last events {self.codes()[-20:]}")
            raise

    def pulses(self) -> list[float]:
        """Pulses that the board puts out (us)."""
        return self.board.pulses()

    def under_way(self) -> None:
        """Armed, and on a long move: frames with changing pulses go to the board."""
        self.arm()
        self.rover.move(FAR, wait=False)
        self.wait_until_moving()

    def wait_until_moving(self, rad: float = 0.02) -> None:
        start = self.joint1()
        wait_for(lambda: abs(self.joint1() - start) > rad, "joint 1 moves")

    def joint1(self) -> float:
        return self.rover.joints().q_rad[0]

    def stands_still(self, seconds: float = 0.3) -> bool:
        """Whether the board puts out the same pulses for a while."""
        before = self.pulses()
        time.sleep(seconds)
        return self.pulses() == before

    def check_invariants(self) -> PulseInvariants:
        """Asserts that no pulse of the whole frame log jumped, left its limits or was switched on without a request."""
        found = pulse_invariants(self.config, read_frames(self.setup.log))
        found.check([at - self.board_started for at in self.armed_at])
        return found


@contextmanager
def connected(setup: DaemonSetup) -> Iterator[tuple[DaemonProcess, Rover]]:
    """A daemon that has its board, and a client of it."""
    with DaemonProcess(setup) as daemon:
        daemon.ready()
        with setup.rover() as rover:
            wait_for_link(rover)
            yield daemon, rover


@contextmanager
def running_harness(setup: DaemonSetup) -> Iterator[DaemonHarness]:
    """All of it, and its invariants at last."""
    with BoardProcess(setup) as board, connected(setup) as (daemon, rover):
        harness = DaemonHarness(setup, board, daemon, rover)
        yield harness
        harness.check_invariants()


def wait_for_link(rover: Rover) -> None:
    """Waits until the board answers. Raises `WaitTimeout`."""
    wait_for(lambda: rover.mode().link == "ready", "the board answers")


def arm_when_ready(rover: Rover, where: Where = "given", q_rad: Mapping[str, float] | None = None) -> None:
    """Arms, asking again as long as the refusal says that this may help: a machine's stall costs the link a handshake.

    Raises `RequestRefused` with any other refusal, `WaitTimeout`.
    """

    def armed() -> bool:
        try:
            rover.arm(where, q_rad)
        except RequestRefused as refused:
            if not refused.retryable:
                raise
            return False
        return True

    wait_for(armed, "the arm is armed")
