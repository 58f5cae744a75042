"""A simulated daemon whose arm a client holds, moves, and lets go."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from lrm_math.arrays import Array
from lrm_math.kinematics.known import Known
from lrmd.config import SECOND, Config
from lrmd.control.motion_record import known_of
from lrmd.control.state_machine import Mode
from lrmd.errors import RequestError
from lrmd.messages.control import ArmRequest, DisarmRequest, JogRequest, LeaseRequest, MoveRequest
from lrmd.persistence.state_file import StoredState
from lrmd.safety.collision_guard import CollisionGuard
from lrmd.sim.board import SimulatedBoard
from tests.support.daemon.in_memory_daemon import WALL, SimulatedDaemon


def take(sim: SimulatedDaemon) -> str:
    """The token of the lease, whoever has it."""
    lease = sim.core.handle(LeaseRequest(action="acquire", holder="test", take=True), sim.now).lease
    return lease.token


class ArmedDaemon(SimulatedDaemon):
    """Not armed at first; without a guard, unless `among` gives one."""

    def __init__(
        self, config: Config, stored: StoredState | None = None, board: SimulatedBoard | None = None, now: int = SECOND,
        torque: tuple[float, ...] = (0.0,) * 6,
    ) -> None:  # fmt: skip
        super().__init__(config, stored=stored, now=now, torque=torque)
        self.token = ""
        if board is not None:
            self.board = board
            self.outputs = self._pulses()
        self.keep(30)

    @classmethod
    def among(cls, config: Config, guard: CollisionGuard | None, start: Sequence[float] | Array) -> ArmedDaemon:
        """Armed at a pose (rad), with a guard."""
        assert guard is not None
        sim = cls(config)
        sim.core.adopt_guard(guard, sim.now)
        sim.arm("given", start)
        return sim

    def keep(self, ticks: int) -> None:
        """Lets time pass, and keeps the lease."""
        for _ in range(ticks):
            if self.token and self.ticks % 15 == 0:
                self.core.handle(LeaseRequest(action="renew", lease=self.token), self.now)
            self.tick()

    def named(self, q: Sequence[float] | Array) -> dict[str, float]:
        """Angles (rad) by joint."""
        return {name: float(angle) for name, angle in zip(self.config.names, q, strict=False)}

    def arm(self, where: str, q: Sequence[float] | Array | None = None) -> None:
        """Switches the joints on; `q`: rad, where it is given."""
        self.token = take(self)
        angles = {} if q is None else self.named(q)
        names = list(self.config.names[: self.config.dof]) if where == "stored" else None
        self.core.stored = self.core.saved(WALL)
        self.core.handle(ArmRequest(lease=self.token, where=where, q_rad=angles, servos=names), self.now)  # type: ignore[arg-type]
        self.until(Mode.ARMED)

    def disarm(self) -> None:
        """Ends the pulses."""
        self.core.handle(DisarmRequest(lease=self.token), self.now)
        self.keep(30)

    def start(self, *waypoints: Sequence[float] | Array, **more: Any) -> float:
        """Begins to move through angles (rad) of the joints; s that it takes. `more`: fields of the request."""
        self.settle()
        request = MoveRequest(lease=self.token, waypoints=[self.named(q) for q in waypoints], **more)
        return self.core.handle(request, self.now).seconds or 0.0

    def go(self, *waypoints: Sequence[float]) -> None:
        """Moves there, and waits."""
        self.start(*waypoints)
        self.until(Mode.ARMED)

    def jogged(self, way: Array) -> Array:
        """(N, n), angles (rad) tick by tick while 60 jogs that way, at 0.2 rad/s at most, are asked for or refused."""
        rates, visited = self.named(0.2 * way / np.abs(way).max()), []
        for _ in range(60):
            self.settle()
            with suppress(RequestError):
                self.core.handle(JogRequest(lease=self.token, rate_rad_per_s=rates), self.now)
            for _ in range(10):
                self.keep(1)
                visited.append(self.core.angles(self.ramp.position)[: self.config.dof])
        return np.array(visited)

    def until(self, mode: Mode) -> None:
        """Lets time pass until the arm is in a mode."""
        for _ in range(4000):
            self.keep(3)
            if self.core.mode is mode:
                return
        raise AssertionError(f"still {self.core.mode}: {self.core.why}")

    @property
    def q(self) -> list[float]:
        """Commanded angles of the joints (rad)."""
        return self.core.angles(self.core.position)[: self.config.dof]

    @property
    def known(self) -> Known:
        """Knowledge that the ik process gets."""
        self.core.observe(self.report, self.now)
        return known_of(self.core.motion_record.knowledge, self.now)

    def killed(self, silence: bool) -> ArmedDaemon:
        """The next daemon after a kill -9, on the same board; after a `silence` in which it has stopped its pulses."""
        text = self.core.saved(WALL).model_dump_json(by_alias=True)
        if silence:
            self.stop_ramp(3 * SECOND)
        return ArmedDaemon(self.config, StoredState.model_validate_json(text), self.board, self.now)
