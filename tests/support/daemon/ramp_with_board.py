"""A ramp core and a simulated board, tick by tick, without anything around them."""

from __future__ import annotations

from dataclasses import replace
from random import Random
from typing import Any

from lrmd.api.children import board_settings
from lrmd.config import Config
from lrmd.link.frames import Frame, FrameDecoder
from lrmd.ramp.core import RampCore
from lrmd.ramp.shared_memory import HOLD_PULSE, LinkState, RampOrder
from lrmd.ramp.stepping import Pace
from lrmd.sim.board import SimulatedBoard
from lrmd.sim.pca9685_chip import Pca9685Chip

TICK = 6_500_000
MIDDLE = 1_500_000


class RampWithBoard:
    """A ramp and a board, tick by tick; `sent` are the frames of the last tick."""

    def __init__(self, config: Config) -> None:
        self.now = 10**9
        self.board = SimulatedBoard(Pca9685Chip(), Random(1), self.now)
        self.ramp = RampCore(board_settings(config))
        self.ramp.opened(self.now)
        self.back = b""
        self.sent: list[Frame] = []

    def tick(self, order: RampOrder | None = None, pause: int = TICK, estop: bool = False) -> None:
        self.now += pause
        out = self.ramp.tick(self.now, self.now, order, self.back, estop)
        self.sent = [f for f in FrameDecoder().feed(out) if isinstance(f, Frame)]
        self.back = self.board.feed(out, self.now)

    def ready(self) -> RampWithBoard:
        for _ in range(5):
            self.tick()
        assert self.ramp.link is LinkState.READY
        return self

    def order(self, number: int = 1, **changes: Any) -> RampOrder:
        rows = (MIDDLE,) * 16, (HOLD_PULSE,) * 16, (1000,) * 16
        base = RampOrder(number, self.now, self.ramp.fault_count, 0b1, Pace.TOGETHER, *rows)
        return replace(base, **changes)
