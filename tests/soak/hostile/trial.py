"""A daemon that moves its arm while it is attacked: what every attack has in common, and what is measured in it."""

from __future__ import annotations

import math
import threading
import time
from bisect import bisect_left
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import zenoh

from lrm_math.errors import LrmError
from lrmd.client import Rover
from lrmd.config import load_config
from tests.soak.hostile.estop_client import EstopClient
from tests.soak.hostile.link_proxy import LinkProxy
from tests.support.daemon.daemon_harness import HOME
from tests.support.daemon.daemon_process import SECOND, BoardProcess, DaemonProcess, DaemonSetup, WaitTimeout, wait_for
from tests.support.daemon.pulse_invariants import FrameLogEntry, PulseInvariants, pulse_invariants, read_frames

RECOVERY_S = 30.0
"""After an attack, until the arm moves again on request."""
ARMING = 6 * SECOND
"""ns that arming may take on a busy machine: switching on within this time of a request was requested."""


@dataclass(frozen=True)
class AttackResult:
    """Figures of one attack. `estops_ms`: of each emergency stop of an arm with pulses, see `estop_delay`."""

    name: str
    frames: int
    largest_step_us: float
    allowed_us: float
    moves: int
    estops_ms: tuple[float, ...]

    def row(self) -> str:
        """One line of the table."""
        worst = f"{max(self.estops_ms):.0f}" if self.estops_ms else "–"
        step = f"{self.largest_step_us:.2f} of {self.allowed_us:.2f}"
        return f"{self.name:<28}{self.frames:>9}{step:>16}{self.moves:>8}{len(self.estops_ms):>9}{worst:>12}"


HEAD = f"{'attack':<28}{'frames':>9}{'step (us)':>16}{'moves':>8}{'e-stops':>9}{'worst (ms)':>12}"


class Trial:
    """A daemon on a board, and a client that keeps the arm moving. `board_started`: monotonic ns."""

    def __init__(self, setup: DaemonSetup, board: BoardProcess, running: ExitStack) -> None:
        self.setup, self.board = setup, board
        self._running = running
        self.board_started = board.started_at()
        self.armed_at: list[int] = []
        self.estops_at: list[int] = []
        self.moves, self.last_refusal = 0, "none"
        self._pause, self._ending = threading.Event(), threading.Event()
        self.start_daemon()
        self._mover = threading.Thread(target=self._keep_moving, daemon=True)
        self._mover.start()
        running.callback(self._end_mover)

    def start_daemon(self) -> None:
        """Starts the daemon, the first one or the next."""
        self.daemon = self._running.enter_context(DaemonProcess(self.setup)).ready()

    def _end_mover(self) -> None:
        self._ending.set()
        self._mover.join(60)

    def _keep_moving(self) -> None:
        while not self._ending.is_set():
            with suppress(LrmError, zenoh.ZError), self.setup.rover(timeout=1.0) as rover:
                while not self._ending.is_set():
                    if self._pause.is_set():
                        time.sleep(0.02)
                        continue
                    try:
                        self._move_once(rover)
                    except LrmError as error:
                        self.last_refusal = str(error)
                        time.sleep(0.1)

    def _move_once(self, rover: Rover) -> None:
        with rover.control("trial", take=True):
            mode = rover.mode().mode
            if mode in ("fault", "estop"):
                rover.reset_fault()
            joints = rover.joints()
            if not any(joints.on):
                self.armed_at.append(time.monotonic_ns())
                known = dict(zip(joints.names[:6], joints.q_rad[:6], strict=False)) if any(joints.pulse_us) else HOME
                rover.arm("given", known)
            for goal in (0.15, -0.15):
                if self._pause.is_set():
                    return
                rover.move({"joint1": goal, "joint4": -goal})
                self.moves += 1

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Its own client keeps still, with the servos on."""
        self.wait_until_it_moves()
        self._pause.set()
        time.sleep(0.5)
        try:
            yield
        finally:
            self._pause.clear()

    def estop(self) -> None:
        """Stops the arm as a stranger would, if it has pulses; waits until they are off. Measured in `result`."""
        with EstopClient(self.setup.endpoint, self.setup.key("cmd/estop")) as client:
            self._pause.set()
            try:
                if self.board.pulses():
                    self.estops_at.append(client.stop())
                    wait_for(lambda: not self.board.pulses(), "the pulses stop", seconds=5.0)
            finally:
                self._pause.clear()

    def wait_until_it_moves(self) -> None:
        """After an attack: the arm can be moved again on request. Raises `WaitTimeout`, with the last refusal."""
        before = self.moves
        try:
            wait_for(lambda: self.moves > before, "the arm moves again after the attack", RECOVERY_S, pause=0.05)
        except WaitTimeout as error:
            raise WaitTimeout(f"{error}; {self.last_refusal}") from None

    def invariants(self) -> PulseInvariants:
        """Asserts the laws over the whole frame log of the board."""
        found = pulse_invariants(load_config(self.setup.config), read_frames(self.board.setup.log))
        found.check([at - self.board_started for at in self.armed_at], ARMING)
        return found

    def result(self, name: str) -> AttackResult:
        """The figures. Raises `AssertionError` if a law was broken."""
        found = self.invariants()
        lines = [line for line in read_frames(self.board.setup.log) if line.event in ("arm", "silence", "power")]
        delays = [estop_delay(lines, at - self.board_started) for at in self.estops_at]
        allowed, step = found.allowed / 1e3, found.largest_step / 1e3
        return AttackResult(name, found.frames, step, allowed, self.moves, tuple(d for d in delays if d is not None))


def estop_delay(lines: Sequence[FrameLogEntry], at: int) -> float | None:
    """ms from a request at `at` (board ns) to the first line without pulses; `inf` if there is none, None if the line
    before had none either."""
    k = bisect_left(lines, at, key=lambda line: line.t)
    if not (k and lines[k - 1].pulsing):
        return None
    return next(((line.t - at) / 1e6 for line in lines[k:] if not line.pulsing), math.inf)


@contextmanager
def trial(folder: Path, changes: Mapping[str, str] | None = None) -> Iterator[Trial]:
    """A trial whose arm moves. `changes`: as those of `DaemonSetup.make`."""
    with ExitStack() as running:
        setup = DaemonSetup.make(folder, changes)
        attacked = Trial(setup, running.enter_context(BoardProcess(setup)), running)
        attacked.wait_until_it_moves()
        yield attacked


@contextmanager
def link_trial(folder: Path, changes: Mapping[str, str] | None = None) -> Iterator[tuple[Trial, LinkProxy]]:
    """The same with a man in the middle of the link. He takes some ms from both, which the others are spared."""
    with ExitStack() as running:
        (folder / "board-side").mkdir(parents=True)
        setup = DaemonSetup.make(folder, changes)
        beyond = DaemonSetup(folder / "board-side", setup.port)
        board = running.enter_context(BoardProcess(beyond))
        proxy = running.enter_context(LinkProxy(setup.link, beyond.link))
        attacked = Trial(setup, board, running)
        attacked.wait_until_it_moves()
        yield attacked, proxy
