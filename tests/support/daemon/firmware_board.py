"""The firmware on a computer: its board logic on a model of the PCA9685 chip."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

from lrmd.link import protocol
from lrmd.link.frames import Frame, FrameDecoder, encode
from lrmd.link.protocol import BoardStatus
from lrmd.sim.pca9685_chip import I2cNoAcknowledge, Pca9685Chip

FIRMWARE = Path(__file__).resolve().parents[3] / "firmware"
MS = 1_000_000
BOOT = 14972


def firmware_module(name: str) -> ModuleType:
    """A file of the firmware as a module; the files import each other by bare names, as on a Pico."""
    sys.path.insert(0, str(FIRMWARE))
    try:
        return importlib.import_module(name)
    finally:
        sys.path.remove(str(FIRMWARE))


class FakeI2cBus:
    """The I2C bus as the firmware sees it: a model of the chip, whose power, answers and clock the test controls."""

    def __init__(self) -> None:
        self.chip = Pca9685Chip()
        self.now = 0
        self.enabled = True
        self.writes_left: int | None = None

    def write(self, register: int, data: bytes) -> None:
        if self.writes_left is not None:
            self.writes_left -= 1
            self.chip.answers = self.writes_left >= 0
        self._on_the_bus(lambda: self.chip.write(register, data, self.now))

    def read(self, register: int, length: int) -> bytes:
        return self._on_the_bus(lambda: self.chip.read(register, length))

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
    def _on_the_bus(transfer: Callable[[], Any]) -> Any:
        try:
            return transfer()
        except I2cNoAcknowledge as error:
            raise OSError(5, str(error)) from None


class FirmwareBoard:
    """The firmware's board logic on such a bus, with frames for bytes."""

    def __init__(self, kind: int = 0) -> None:
        self.bus = FakeI2cBus()
        self.logic = firmware_module("board").Board(self.bus, BOOT, kind)

    def ask(self, *frames: Frame) -> Frame:
        """The last answer to these frames."""
        answers = FrameDecoder().feed(self.logic.receive(b"".join(map(encode, frames))))
        assert len(answers) == len(frames)
        assert isinstance(answers[-1], Frame)
        return answers[-1]

    def wait(self, ms: int) -> None:
        self.bus.now += ms * MS
        self.logic.tick(ms)

    def set_up(self, silence_ms: int = 1000) -> FirmwareBoard:
        assert protocol.ack_of(self.ask(protocol.setup(1, 121, silence_ms))).status == BoardStatus.SET_UP
        return self
