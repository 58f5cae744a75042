"""Simulated board, faulty link and simulated arm on one clock. Sans-io: time is an argument (ns)."""

from __future__ import annotations

from collections.abc import Iterable
from random import Random
from typing import Final

from lrmd.sim.arm import SimulatedArm
from lrmd.sim.board import SimulatedBoard
from lrmd.sim.faults import (
    BrownOut,
    ChipPowerLoss,
    ChipSilence,
    ClearFrameFaults,
    Fault,
    FaultyLine,
    FrameFault,
    HangUp,
    LineStall,
    ScheduledFault,
    TimedFault,
)

SECOND: Final = 1_000_000_000
MOST_HELD: Final = 4096
"""Bytes that a stalled line buffers; further ones are lost, as on a real one."""


class Simulation:
    """Board, link and arm on one clock that starts at 0.

    Args:
        arm: the arm that the servos move, or None: a board alone.
        random: selects the corrupted frames and bits.
        planned: scheduled faults.
    """

    def __init__(
        self, board: SimulatedBoard, arm: SimulatedArm | None, random: Random, planned: Iterable[ScheduledFault] = ()
    ) -> None:
        self.board, self.arm = board, arm
        self._in, self._out = FaultyLine("in", random), FaultyLine("out", random)
        self._held = b""
        self._plan = sorted(planned, key=lambda plan: plan.at)
        self._ends: dict[type[TimedFault], int] = {}

    @property
    def present(self) -> bool:
        """Whether the host sees the device."""
        return HangUp not in self._ends

    @property
    def deadline(self) -> int | None:
        """Latest time (ns) of the next `tick`, None if only input needs one."""
        times = [*self._ends.values(), *(round(plan.at * SECOND) for plan in self._plan[:1])]
        if self._powered and self.board.deadline is not None:
            times.append(self.board.deadline)
        return min(times, default=None)

    def tick(self, now: int) -> bytes:
        """Advances to `now`; returns bytes for the host."""
        self._move_arm(now)
        while self._plan and self._plan[0].at * SECOND <= now:
            self.begin(self._plan.pop(0).fault, now)
        for kind in [kind for kind, end in self._ends.items() if end <= now]:
            self._end(kind, now)
        if self._powered:
            self.board.tick(now)
        self._move_arm(now)
        return self._pass(b"", now) if self._held else b""

    def feed(self, data: bytes, now: int) -> bytes:
        """Handles bytes from the host; returns bytes for it."""
        return self.tick(now) + self._pass(data, now)

    def begin(self, fault: Fault, now: int) -> None:
        """Starts a fault."""
        match fault:
            case ClearFrameFaults():
                self._in.faults, self._out.faults = [], []
            case FrameFault():
                self._in.add_fault(fault)
                self._out.add_fault(fault)
            case TimedFault():
                self._ends[type(fault)] = now + round(fault.seconds * SECOND)
                self._start(fault, now)

    def _start(self, fault: TimedFault, now: int) -> None:
        if isinstance(fault, ChipSilence | ChipPowerLoss):
            self.board.chip.answers = False
        if isinstance(fault, BrownOut | ChipPowerLoss):
            self.board.chip.power_cycle()
            self._move_arm(now)
        if isinstance(fault, BrownOut | HangUp):
            self._held = b""

    def _end(self, kind: type[TimedFault], now: int) -> None:
        del self._ends[kind]
        if kind in (ChipSilence, ChipPowerLoss):
            self.board.chip.answers = True
        if kind is BrownOut:
            self.board.power_cycle(now)
            if self.arm:
                self.arm.power_cycle()

    @property
    def _powered(self) -> bool:
        return BrownOut not in self._ends

    def _pass(self, data: bytes, now: int) -> bytes:
        if LineStall in self._ends:
            self._held = (self._held + data)[:MOST_HELD]
            return b""
        arrived, self._held = self._in.transmit(self._held + data), b""
        if not (arrived and self._powered and self.present):
            return b""
        reply = self._out.transmit(self.board.feed(arrived, now))
        self._move_arm(now)
        return reply

    def _move_arm(self, now: int) -> None:
        if self.arm:
            self.arm.advance(self.board.chip, now)
