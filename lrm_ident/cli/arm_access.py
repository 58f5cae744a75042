"""The arm as commands reach it: its daemon or bare servos, its loads, and interruptions."""

from __future__ import annotations

import math
import shlex
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from typer import Exit

from lrm_ident.cli.common import show
from lrm_math.arm.arm_file import GRAM, load_arm
from lrm_math.errors import LrmError

if TYPE_CHECKING:
    from lrm_ident.measuring.campaign.session import OpenArm
    from lrm_ident.measuring.tracker.frames import TargetNumbers
    from lrm_math.arm.arm import Arm
    from lrmd.client import Rover

SO101 = "so101"
"""The arm of servos that are driven without a daemon, if no other is named."""
SERVOS = "lerobot:, feetech: and dynamixel:"


@dataclass(frozen=True)
class ArmConnection:
    """An arm and the name of its description; `daemon`: its own, or None; `drive`: opens it.

    `rates`: (n,), how fast its joints turn at most (rad/s).
    """

    name: str
    arm: Arm
    daemon: Rover | None
    drive: OpenArm
    rates: tuple[float, ...]


@dataclass(frozen=True)
class ArmAccess:
    """Options by which an arm is reached. `speed`: deg/s. `model`: the one that corrects commands without a daemon."""

    robot: str
    connect: str | None
    speed: float | None
    take: bool
    release: bool = False
    model: Path | None = None

    @contextmanager
    def connection(self, arm: str | None, client: str) -> Iterator[ArmConnection]:
        """The arm, described by a name or by its daemon; ended as by Ctrl-C if the process is told to end.

        `client`: what holds its lease. Raises `LrmError`.
        """
        signal.signal(signal.SIGTERM, _end)
        daemon = self._daemon()
        with daemon or nullcontext():
            name = arm or (SO101 if daemon is None else daemon.info().arm)
            described = load_arm(name)
            rates = self._rates(described) if daemon is None else daemon.info().rate_rad_per_s[: described.dof]
            yield ArmConnection(name, described, daemon, self._drive(daemon, described, client), tuple(rates))

    def _daemon(self) -> Rover | None:
        """The connection with a daemon, None for servos without one. Raises `LrmError`: what only these take."""
        from lrm_ident.measuring.campaign.session import drives_servos
        from lrmd.client import Rover

        if drives_servos(self.robot):
            return None
        if self.speed is not None:
            raise LrmError(f"--speed: a daemon's arm moves at the speed of its lrmd.toml; it goes with {SERVOS}")
        if self.model is not None:
            raise LrmError(f"--model {self.model}: a daemon uses its own model (lrm deploy); it goes with {SERVOS}")
        return Rover(self.robot, self.connect.split(",") if self.connect else None)

    def _drive(self, daemon: Rover | None, arm: Arm, client: str) -> OpenArm:
        """Opener of a daemon's arm, or of servos without one."""
        from lrm_ident.measuring.campaign.session import BUSES, by_daemon, by_servos

        if self.release and not self.robot.startswith(tuple(kind.prefix for kind in BUSES)):
            raise LrmError(f"--release: it goes with {' and '.join(kind.prefix for kind in BUSES)}")
        if daemon is not None:
            return partial(by_daemon, daemon, arm, self.take, client)
        return partial(by_servos, self.robot, arm, max(self._rates(arm)), self.release)

    def _rates(self, arm: Arm) -> tuple[float, ...]:
        """(n,), speed of servos without a daemon (rad/s)."""
        from lrm_ident.measuring.campaign.servo_arm import SPEED

        return (SPEED if self.speed is None else math.radians(self.speed),) * arm.dof


def target_numbers(tool: int, base: int, tracker: str) -> TargetNumbers:
    """The targets whose positions count; no base where the tracker's are in the arm's frame."""
    from lrm_ident.measuring.tracker.frames import TargetNumbers
    from lrm_ident.measuring.tracker.source import IN_ARM_FRAME

    return TargetNumbers(tool, None if base < 0 or tracker.startswith(IN_ARM_FRAME) else base)


@contextmanager
def resumable(where: str) -> Iterator[None]:
    """Ends the command with code 1 if it is interrupted, and says the state of the arm and where the results are."""
    try:
        yield
    except (KeyboardInterrupt, SystemExit) as stop:
        state = "its torque is released" if getattr(stop, "released", False) else "the arm holds"
        show(f"stopped; {state}. {where}")
        raise Exit(1) from None


def load_changer(load_command: str | None) -> Callable[[float], None]:
    """Changes the load (kg) by a command, or asks a person for it where it differs from the last one."""
    last = 0.0  # the first poses may need no load

    def change(payload: float) -> None:
        """Runs the command with the load (g) as its last word, or asks at the terminal and waits."""
        nonlocal last
        if load_command:
            words = [*shlex.split(load_command), f"{payload / GRAM:.4g}"]
            done = subprocess.run(words, capture_output=True, text=True)
            if done.returncode:
                problem = f"exit code {done.returncode} of {shlex.join(words)}: {done.stderr.strip()}"
                raise LrmError(f"--load-command: {problem}")
        elif payload != last:
            if not sys.stdin.isatty():
                raise LrmError(
                    f"a load of {payload / GRAM:g} g is wanted, and nobody to put it on: give --load-command"
                )
            input(f"Put {payload / GRAM:g} g on the tool, then press Enter. ")
        last = payload

    return change


def _end(*_: object) -> NoReturn:
    raise SystemExit(1)
