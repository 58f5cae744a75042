"""An arm of bare Feetech servos, as `--robot feetech:/dev/ttyACM0,ids=1-5` names it.

Angles are those of the servos' encoders from the middle of their turn, less the homing offset in each servo's memory,
which LeRobot's calibration writes there too.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from lrm_ident.measuring.feetech import memory_table as table
from lrm_ident.measuring.feetech.bus import FeetechHost
from lrm_math.arm.arm import Arm
from lrm_math.errors import LrmError

KIND = "feetech:"
STEP = 2.0 * math.pi / 4096.0
"""rad for one count."""
MIDDLE = 2048
BAUD, POLL_S = 1_000_000, 0.02
MOST_TORQUE = 1000


@dataclass(frozen=True, eq=False)
class FeetechServos:
    """See `Servos`. `numbers`: of the servo of each joint."""

    name: str
    host: FeetechHost
    joints: tuple[str, ...]
    numbers: tuple[int, ...]
    limits: tuple[tuple[int, int], ...]

    def angles(self) -> tuple[float, ...]:
        """See `Servos`."""
        return tuple((self.host.read(number, table.POSITION) - MIDDLE) * STEP for number in self.numbers)

    def command(self, q: Sequence[float]) -> None:
        """See `Servos`. Raises `LrmError`: beyond the position limits in a servo's memory; it would stop short."""
        counts = [MIDDLE + round(angle / STEP) for angle in q]
        for joint, count, (low, high) in zip(self.joints, counts, self.limits, strict=True):
            if not low <= count <= high:
                least, most = (math.degrees((end - MIDDLE) * STEP) for end in (low, high))
                at = math.degrees((count - MIDDLE) * STEP)
                raise LrmError(f"{joint}: {at:.1f} deg is beyond its servo's own limits, {least:.0f} to {most:.0f} deg")
        self.host.move(dict(zip(self.numbers, counts, strict=True)))

    def powered(self) -> Mapping[str, bool]:
        """See `Servos`."""
        return {joint: bool(self.host.read(n, table.TORQUE_ENABLE)) for joint, n in self._each}

    def temperature(self) -> Mapping[str, float]:
        """See `Servos`."""
        return {joint: float(self.host.read(n, table.TEMPERATURE)) for joint, n in self._each}

    def bound_torque(self, share: float) -> None:
        """See `Servos`."""
        for number in self.numbers:
            self.host.write(number, table.TORQUE_LIMIT, round(share * MOST_TORQUE))

    def forget_late_answers(self) -> None:
        """See `Servos`."""
        self.host.forget_late_answers()

    @property
    def _each(self) -> Iterator[tuple[str, int]]:
        yield from zip(self.joints, self.numbers, strict=True)


@contextmanager
def connected_bus(text: str, arm: Arm) -> Iterator[FeetechServos]:
    """The servos, with torque, where they stand; they hold where they are left. Raises `LrmError`: one is not there."""
    import serial

    path, numbers, baud = _parsed(text, arm.dof)
    try:
        line = serial.Serial(path, baud, timeout=POLL_S, write_timeout=1.0, exclusive=True)
    except (serial.SerialException, OSError) as error:
        raise LrmError(f"--robot {text}: {path} cannot be opened ({' '.join(str(error).split())})") from None
    with line:
        host = FeetechHost(line)
        silent = {number: why for number, why in host.answering(numbers).items() if why}
        if silent:
            there = ", ".join(str(number) for number in numbers if number not in silent) or "none"
            raise LrmError(
                f"--robot {text}: {next(iter(silent.values()))}; of {_listed(numbers)} these answer: {there}"
            )
        limits = tuple((host.read(n, table.MIN_POSITION), host.read(n, table.MAX_POSITION)) for n in numbers)
        names = tuple(joint.name or f"joint{i}" for i, joint in enumerate(arm.joints, start=1))
        for number in numbers:  # where it stands is its goal before it gets torque: it does not move
            if not host.read(number, table.TORQUE_ENABLE):
                host.write(number, table.GOAL_POSITION, host.read(number, table.POSITION))
                host.write(number, table.TORQUE_ENABLE, 1)
        yield FeetechServos(text, host, names, numbers, limits)


def _parsed(text: str, count: int) -> tuple[str, tuple[int, ...], int]:
    """Path, servo numbers and baud rate of `feetech:PATH,ids=1-5,baud=1000000`."""
    path, *words = text.removeprefix(KIND).split(",")
    options = {"ids": f"1-{count}", "baud": str(BAUD)}
    for word in words:
        name, _, value = word.partition("=")
        if name not in options or not value:
            raise LrmError(f"--robot {text}: '{word}'; should be ids=1-{count}, ids=3+1+2, or baud={BAUD}")
        options[name] = value
    numbers = _numbers(options["ids"])
    if len(numbers) != count or len(set(numbers)) != count or not options["baud"].isdecimal():
        raise LrmError(f"--robot {text}: {len(numbers)} ids; should be one for each of the arm's {count} joints")
    return path, numbers, int(options["baud"])


def _numbers(text: str) -> tuple[int, ...]:
    if span := re.fullmatch(r"(\d+)-(\d+)", text):
        return tuple(range(int(span[1]), int(span[2]) + 1))
    return tuple(int(word) for word in text.split("+") if word.isdecimal())


def _listed(numbers: Sequence[int]) -> str:
    return ", ".join(map(str, numbers))
