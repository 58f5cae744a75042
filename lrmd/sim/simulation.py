"""The simulated board with faults on its line and an arm behind it: sans-io, time is an argument (ns)."""

from __future__ import annotations

from collections.abc import Iterable
from random import Random
from typing import Final

from lrmd.sim.arm import SimulatedArm
from lrmd.sim.board import Board
from lrmd.sim.faults import BrownOut, Calm, ChipSilence, Fault, FrameFault, HangUp, Line, Planned, Stall, TimedFault

SECOND: Final = 1_000_000_000
MOST_HELD: Final = 4096
"""Bytes that a line holds back in a stall; it loses what comes on top, as a real one does."""


class Simulation:
    """Board, line and arm on one clock that starts at 0.

    Args:
        arm: what the servos move, or None: a board alone.
        random: decides which frames are spoilt, and how.
        planned: faults to come.
    """

    def __init__(self, board: Board, arm: SimulatedArm | None, random: Random, planned: Iterable[Planned] = ()) -> None:
        self.board, self.arm = board, arm
        self._in, self._out = Line("in", random), Line("out", random)
        self._held = b""
        self._plan = sorted(planned, key=lambda plan: plan.at)
        self._ends: dict[type[TimedFault], int] = {}

    @property
    def present(self) -> bool:
        """Whether the host sees the device at all."""
        return HangUp not in self._ends

    @property
    def deadline(self) -> int | None:
        """When `tick` has to be called at the latest (ns), or None: not before something comes in."""
        times = [*self._ends.values(), *(round(plan.at * SECOND) for plan in self._plan[:1])]
        if self._powered and self.board.deadline is not None:
            times.append(self.board.deadline)
        return min(times, default=None)

    def tick(self, now: int) -> bytes:
        """Lets time pass; returns bytes for the host."""
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
        """Takes what the host sent; returns bytes for it."""
        return self.tick(now) + self._pass(data, now)

    def begin(self, fault: Fault, now: int) -> None:
        """Lets a fault begin."""
        match fault:
            case Calm():
                self._in.faults, self._out.faults = [], []
            case FrameFault():
                self._in.take(fault)
                self._out.take(fault)
            case TimedFault():
                self._ends[type(fault)] = now + round(fault.seconds * SECOND)
                self._start(fault, now)

    def _start(self, fault: TimedFault, now: int) -> None:
        if isinstance(fault, ChipSilence):
            self.board.chip.answers = False
        if isinstance(fault, BrownOut):
            self.board.chip.power_cycle()
            self._move_arm(now)
        if isinstance(fault, BrownOut | HangUp):
            self._held = b""

    def _end(self, kind: type[TimedFault], now: int) -> None:
        del self._ends[kind]
        if kind is ChipSilence:
            self.board.chip.answers = True
        if kind is BrownOut:
            self.board.power_cycle(now)
            if self.arm:
                self.arm.power_cycle()

    @property
    def _powered(self) -> bool:
        return BrownOut not in self._ends

    def _pass(self, data: bytes, now: int) -> bytes:
        if Stall in self._ends:
            self._held = (self._held + data)[:MOST_HELD]
            return b""
        arrived, self._held = self._in.carry(self._held + data), b""
        if not (arrived and self._powered and self.present):
            return b""
        reply = self._out.carry(self.board.feed(arrived, now))
        self._move_arm(now)
        return reply

    def _move_arm(self, now: int) -> None:
        if self.arm:
            self.arm.advance(self.board.chip, now)
