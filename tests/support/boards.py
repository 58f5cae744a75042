"""The firmware's board on a model of its chip, as the tests of the firmware use it."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

from lrmd.link import protocol
from lrmd.link.protocol import Decoder, Frame, Status, encode
from lrmd.sim.pca9685_chip import NoAnswer, Pca9685Chip

FIRMWARE = Path(__file__).resolve().parents[2] / "firmware"
MS = 1_000_000
BOOT = 14972


def firmware(name: str) -> ModuleType:
    """A file of the firmware as a module: on a Pico they lie side by side, so they import each other by bare names."""
    sys.path.insert(0, str(FIRMWARE))
    try:
        return importlib.import_module(name)
    finally:
        sys.path.remove(str(FIRMWARE))


class Bus:
    """What the firmware holds for its chip: the model of the chip, whose power, answers and clock the test holds."""

    def __init__(self) -> None:
        self.chip = Pca9685Chip()
        self.now = 0
        self.enabled = True
        self.writes_left: int | None = None

    def write(self, register: int, data: bytes) -> None:
        if self.writes_left is not None:
            self.writes_left -= 1
            self.chip.answers = self.writes_left >= 0
        self._asked(lambda: self.chip.write(register, data, self.now))

    def read(self, register: int, length: int) -> bytes:
        return self._asked(lambda: self.chip.read(register, length))

    def enable(self, on: bool) -> None:
        self.enabled = on

    def pause_us(self, us: int) -> None:
        self.now += us * 1000

    @property
    def pulses(self) -> dict[int, int]:
        """Counts of the channels that pulse."""
        widths = {channel: self.chip.width(channel) for channel in range(16)}
        return {channel: width for channel, width in widths.items() if width}

    @staticmethod
    def _asked(ask: Callable[[], Any]) -> Any:
        try:
            return ask()
        except NoAnswer as error:
            raise OSError(5, str(error)) from None


class Board:
    """The firmware's board on such a bus, with frames for bytes."""

    def __init__(self, kind: int = 0) -> None:
        self.bus = Bus()
        self.logic = firmware("board").Board(self.bus, BOOT, kind)

    def ask(self, *frames: Frame) -> Frame:
        """The last answer to these frames."""
        answers = Decoder().feed(self.logic.receive(b"".join(map(encode, frames))))
        assert len(answers) == len(frames)
        assert isinstance(answers[-1], Frame)
        return answers[-1]

    def wait(self, ms: int) -> None:
        self.bus.now += ms * MS
        self.logic.tick(ms)

    def set_up(self, silence_ms: int = 1000) -> Board:
        assert protocol.ack_of(self.ask(protocol.setup(1, 121, silence_ms))).status == Status.SET_UP
        return self
