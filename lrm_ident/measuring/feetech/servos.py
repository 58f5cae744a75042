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
from lrm_ident.measuring.feetech.bus import FeetechHost, GarbledAnswer, NoAnswer
from lrm_math.arm.arm import Arm
from lrm_math.errors import LrmError

KIND = "feetech:"
STEP = 2.0 * math.pi / 4096.0
"""rad for one count."""
MIDDLE = 2048
BAUD, POLL_S = 1_000_000, 0.02
MOST_TORQUE = 1000
MODELS = {table.MODEL_STS3215: "STS3215", table.MODEL_STS3250: "STS3250"}
"""Servos of 4096 counts a turn that speak this protocol, by their model number."""
BY_ANGLE = 0
"""Mode of a servo that goes to angles."""
LOOKED_FOR = range(1, 21)
"""Numbers that are asked for when a servo is missing."""


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
        return tuple((count - MIDDLE) * STEP for count in self._read(table.POSITION).values())

    @property
    def step(self) -> float:
        """See `Servos`."""
        return STEP

    def beyond_limits(self, q: Sequence[float]) -> str:
        """See `Servos`: those in its memory, where it would stop short without a word."""
        for joint, count, (low, high) in zip(self.joints, map(_count, q), self.limits, strict=True):
            if not low <= count <= high:
                at, least, most = (math.degrees((end - MIDDLE) * STEP) for end in (count, low, high))
                return f"{joint}: {at:.1f} deg is beyond its servo's own limits, {least:.0f} to {most:.0f} deg"
        return ""

    def command(self, q: Sequence[float]) -> None:
        """See `Servos`."""
        self.host.move(dict(zip(self.numbers, map(_count, q), strict=True)))

    def powered(self) -> Mapping[str, bool]:
        """See `Servos`."""
        return {joint: bool(value) for joint, value in self._read(table.TORQUE_ENABLE).items()}

    def temperature(self) -> Mapping[str, float]:
        """See `Servos`."""
        return {joint: float(value) for joint, value in self._read(table.TEMPERATURE).items()}

    def bound_torque(self, share: float) -> None:
        """See `Servos`."""
        for number in self.numbers:
            self.host.write(number, table.TORQUE_LIMIT, round(share * MOST_TORQUE))

    def forget_late_answers(self) -> None:
        """See `Servos`."""
        self.host.forget_late_answers()

    def _read(self, register: table.Register) -> dict[str, int]:
        """Values of a register by joint, in their order. Raises `NoAnswer`."""
        found = self.host.read_all(self.numbers, register)
        return {joint: found[number] for joint, number in zip(self.joints, self.numbers, strict=True)}


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
        try:
            servos = held_servos(text, FeetechHost(line), arm, numbers)
        except NoAnswer as error:
            raise LrmError(f"--robot {text}: {error}") from None
        yield servos


def held_servos(name: str, host: FeetechHost, arm: Arm, numbers: Sequence[int]) -> FeetechServos:
    """The servos of an arm's joints by their numbers, with torque where they stand, none unless all are fit.

    Raises `LrmError`: one is missing, there twice, of another kind; `NoAnswer`: the line is bad.
    """
    joints = tuple(joint.name or f"joint{i}" for i, joint in enumerate(arm.joints, start=1))
    try:
        limits = tuple(_limits(host, number) for number in numbers)
    except LrmError as error:
        raise LrmError(f"--robot {name}: {error}") from None
    for number in numbers:
        _hold(host, number)
    return FeetechServos(name, host, joints, tuple(numbers), limits)


def _limits(host: FeetechHost, number: int) -> tuple[int, int]:
    """Least and greatest goal (counts) of a servo that can be driven. Raises `LrmError` for any other."""
    try:
        memory = host.memory(number)
    except GarbledAnswer as error:
        raise LrmError(f"{error}: two servos have this number? Plug in one at a time, and give it its own") from None
    except NoAnswer as error:
        there = ", ".join(map(str, host.answering(LOOKED_FOR)))
        others = f"on the bus are {there}" if there else "nor does any other: is the power on, is it the right port?"
        raise LrmError(f"{error}; {others}") from None
    if (model := table.MODEL.read(memory)) not in MODELS:
        raise LrmError(f"servo {number} is of model {model}; should be {' or '.join(MODELS.values())}")
    if mode := table.MODE.read(memory):
        raise LrmError(f"servo {number} is in mode {mode}; should be {BY_ANGLE}, which goes to angles")
    return table.MIN_POSITION.read(memory), table.MAX_POSITION.read(memory)


def _hold(host: FeetechHost, number: int) -> None:
    """Gives a servo torque where it stands: that is its goal before, so that it does not move. Raises `NoAnswer`."""
    if not host.read(number, table.TORQUE_ENABLE):
        host.write(number, table.GOAL_POSITION, host.read(number, table.POSITION))
        host.write(number, table.TORQUE_ENABLE, 1)


def _count(angle: float) -> int:
    return MIDDLE + round(angle / STEP)


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
        which = f"ids={options['ids']},baud={options['baud']}"
        raise LrmError(f"--robot {text}: {which}; should be one id for each of the {count} joints, and bits per second")
    return path, numbers, int(options["baud"])


def _numbers(text: str) -> tuple[int, ...]:
    if span := re.fullmatch(r"(\d+)-(\d+)", text):
        return tuple(range(int(span[1]), int(span[2]) + 1))
    return tuple(int(word) for word in text.split("+") if word.isdecimal())
