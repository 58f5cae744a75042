"""An arm of bare servos, as `--robot feetech:/dev/ttyACM0,ids=1-5` or `dynamixel:/dev/ttyUSB0` names it.

Angles are those of the servos' encoders from the middle of their turn, less the homing offset in each servo's memory,
which LeRobot's calibration writes there too.
"""

from __future__ import annotations

import math
import re
import signal
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import NoReturn

from lrm_ident.data.wording import joint_labels
from lrm_ident.measuring.servo_bus.bus import GarbledAnswer, NoAnswer, ServoHost
from lrm_ident.measuring.servo_bus.kind import BusServoKind, Register
from lrm_ident.measuring.servo_bus.torque_on import JointServo, bound_torque, released, switch_on
from lrm_math.arm.arm import Arm
from lrm_math.arm.servo_goal import MIDDLE, STEP
from lrm_math.arm.servo_settings import JointServoSettings, ServoSettings
from lrm_math.errors import LrmError

POLL_S = 0.02
LOOKED_FOR = range(1, 21)
"""Numbers that are asked for when a servo is missing."""
WORD = "release"


@dataclass(frozen=True, eq=False)
class BusServos:
    """See `Servos`. `numbers`: of the servo of each joint."""

    name: str
    host: ServoHost
    joints: tuple[str, ...]
    numbers: tuple[int, ...]
    limits: tuple[tuple[int, int], ...]

    def angles(self) -> tuple[float, ...]:
        """See `Servos`."""
        return tuple((count - MIDDLE) * STEP for count in self._read(self.host.kind.position).values())

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
        return {joint: bool(value) for joint, value in self._read(self.host.kind.torque).items()}

    def temperature(self) -> Mapping[str, float]:
        """See `Servos`."""
        return {joint: float(value) for joint, value in self._read(self.host.kind.temperature).items()}

    def settings(self) -> ServoSettings:
        """See `Servos`."""
        kind, stored = self.host.kind, ServoSettings()
        for joint, number in zip(self.joints, self.numbers, strict=True):
            memory = self.host.memory(number)
            values = {name: factor * register.read(memory) for name, (register, factor) in kind.settings.items()}
            version = ".".join(str(register.read(memory)) for register in kind.firmware)
            stored[joint] = JointServoSettings(**values, firmware=version)
        return stored

    def bound_torque(self, share: float) -> None:
        """See `Servos`."""
        bound_torque(self.host, self.numbers, share)

    def release(self) -> None:
        """Takes the torque from all: the arm falls. Each is told, whatever the others say. Raises `NoAnswer`."""
        if silent := released(self.host, self.servos):
            raise NoAnswer(f"torque may be on: no answer of {', '.join(silent)}")

    @property
    def servos(self) -> tuple[JointServo, ...]:
        """The servo of each joint."""
        each = zip(self.joints, self.numbers, self.limits, strict=True)
        return tuple(JointServo(joint, number, *limits) for joint, number, limits in each)

    def forget_late_answers(self) -> None:
        """See `Servos`."""
        self.host.forget_late_answers()

    def _read(self, register: Register) -> dict[str, int]:
        """Values of a register by joint, in their order. Raises `NoAnswer`."""
        values = self.host.read_all(self.numbers, register)
        return {joint: values[number] for joint, number in zip(self.joints, self.numbers, strict=True)}


@contextmanager
def connected_bus(text: str, kind: BusServoKind, arm: Arm) -> Iterator[BusServos]:
    """The servos, with torque, where they stand; they hold where they are left. Raises `LrmError`: one is not there."""
    with _opened(text, kind, arm) as (host, numbers):
        yield held_servos(text, host, arm, numbers)


@contextmanager
def limp_bus(text: str, kind: BusServoKind, arm: Arm) -> Iterator[BusServos]:
    """The servos without torque, to be moved by hand. Raises `LrmError`: one is not there, or holds torque."""
    with _opened(text, kind, arm) as (host, numbers):
        yield limp_servos(text, host, arm, numbers)


def limp_servos(name: str, host: ServoHost, arm: Arm, numbers: Sequence[int]) -> BusServos:
    """The servos of an arm's joints, none of which holds torque; nothing is written to them. Raises `LrmError`."""
    try:
        limits = tuple(_limits(host, number) for number in numbers)
        servos = BusServos(name, host, joint_labels(arm), tuple(numbers), limits)
        powered = [joint for joint, holds in servos.powered().items() if holds]
    except (NoAnswer, LrmError) as error:
        raise LrmError(f"--robot {name}: {error}") from None
    if powered:
        right = "support the arm, then switch their supply off and on"
        raise LrmError(f"--robot {name}: torque is on at {', '.join(powered)}, and a hand cannot move them: {right}")
    return servos


@contextmanager
def _opened(text: str, kind: BusServoKind, arm: Arm) -> Iterator[tuple[ServoHost, tuple[int, ...]]]:
    """The host on the line that a text names, and the servos' numbers. Raises `LrmError`."""
    import serial

    path, numbers, baud = _parsed(text, kind, arm.dof)
    try:
        line = serial.Serial(path, baud, timeout=POLL_S, write_timeout=1.0, exclusive=True)
    except (serial.SerialException, OSError) as error:
        raise LrmError(f"--robot {text}: {path} cannot be opened ({' '.join(str(error).split())})") from None
    with line:
        yield ServoHost(line, kind), numbers


class ReleaseKey(KeyboardInterrupt):
    """The release key of servos without a daemon was pressed: Ctrl-backslash, which the terminal sends as SIGQUIT.

    It stops as Ctrl-C does: nothing more is commanded, and the arm holds where it was sent last. Only if the person
    says so besides, by an option before or by a word after, the servos lose their torque (`released`), and it falls.
    """

    released = False


@contextmanager
def release_key(servos: BusServos, release: bool) -> Iterator[None]:
    """Listens to the release key meanwhile, on the main thread. `release`: said before; else it asks."""
    before = signal.signal(signal.SIGQUIT, _press)
    try:
        yield
    except ReleaseKey as pressed:
        signal.signal(signal.SIGQUIT, signal.SIG_IGN)  # pressed again it says nothing new
        if release or _asked_for_release():
            servos.release()
            pressed.released = True
        raise
    finally:
        signal.signal(signal.SIGQUIT, before)


def _asked_for_release() -> bool:
    """Asks on the terminal. Anything but the word, and no terminal, is no."""
    try:
        return input(f"The arm holds. To release its torque, so that it falls, type {WORD}: ").strip() == WORD
    except (EOFError, KeyboardInterrupt):
        return False


def _press(*_: object) -> NoReturn:
    raise ReleaseKey


def held_servos(name: str, host: ServoHost, arm: Arm, numbers: Sequence[int]) -> BusServos:
    """The servos of an arm's joints by their numbers, with bounded torque where they stand, none unless all are fit.

    Raises `LrmError`: one is missing, there twice, of another kind, or beyond its own limits; or the line is bad.
    """
    try:
        limits = tuple(_limits(host, number) for number in numbers)
        servos = BusServos(name, host, joint_labels(arm), tuple(numbers), limits)
        switch_on(host, servos.servos)
    except (NoAnswer, LrmError) as error:
        raise LrmError(f"--robot {name}: {error}") from None
    return servos


def _limits(host: ServoHost, number: int) -> tuple[int, int]:
    """Least and greatest goal (counts) of a servo that can be driven. Raises `LrmError` for any other."""
    try:
        memory = host.memory(number)
    except GarbledAnswer as error:
        raise LrmError(f"{error}: two servos have this number? Plug in one at a time, and give it its own") from None
    except NoAnswer as error:
        there = ", ".join(map(str, host.answering(LOOKED_FOR)))
        others = f"on the bus are {there}" if there else "nor does any other: is the power on, is it the right port?"
        raise LrmError(f"{error}; {others}") from None
    kind = host.kind
    if (model := kind.model.read(memory)) not in kind.models:
        raise LrmError(f"servo {number} is of model {model}; should be {' or '.join(kind.models.values())}")
    if (mode := kind.mode.read(memory)) not in kind.modes:
        right = " or ".join(map(str, kind.modes))
        raise LrmError(f"servo {number} is in mode {mode}; should be {right}, which goes to angles")
    return kind.least.read(memory), kind.greatest.read(memory)


def _count(angle: float) -> int:
    return MIDDLE + round(angle / STEP)


def _parsed(text: str, kind: BusServoKind, count: int) -> tuple[str, tuple[int, ...], int]:
    """Path, servo numbers and baud rate of `feetech:PATH,ids=1-5,baud=1000000`."""
    path, *words = text.removeprefix(kind.prefix).split(",")
    options = {"ids": f"1-{count}", "baud": str(kind.baud)}
    for word in words:
        name, _, value = word.partition("=")
        if name not in options or not value:
            raise LrmError(f"--robot {text}: '{word}'; should be ids=1-{count}, ids=3+1+2, or baud={kind.baud}")
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
