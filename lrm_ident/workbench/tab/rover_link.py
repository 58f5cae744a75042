"""A running `lrmd`, asked by its client: where its arm is commanded, and where the model thinks the tip is."""

from __future__ import annotations

import atexit
import threading
from dataclasses import dataclass, field
from typing import Self

import numpy as np

from lrm_ident.residual.picture.error_field import arm_lines
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from lrmd.client import JointsState, ModeState, Rover

LOOK_S, AGAIN_S = 0.2, 2.0
"""s between two questions, and until a daemon that was silent is asked anew."""


@dataclass(frozen=True, eq=False)
class RoverTip:
    """Position of an arm.

    Attributes:
        mode: of the daemon, and why. q: (n,), commanded angles (rad). payload: kg.
        nominal, bent: (n + 2, 3), the frames' origins of the nominal arm and of the model, the TCP last (m).
    """

    mode: str
    q: Array
    payload: float
    nominal: Array
    bent: Array

    @property
    def words(self) -> str:
        """Words for a person."""
        tip, drawn = self.bent[-1] * 1e3, self.nominal[-1] * 1e3
        off = float(np.linalg.norm(tip - drawn))
        angles = " ".join(f"{angle:.1f}" for angle in np.degrees(self.q))
        return (
            f"{self.mode}; q {angles} deg, load {self.payload * 1e3:.0f} g; the model puts the tip at "
            f"{tip[0]:.2f} {tip[1]:.2f} {tip[2]:.2f} mm, {off:.2f} mm from where the nominal arm would be"
        )


@dataclass
class RoverLink:
    """A daemon that is asked for its state again and again, in a thread of its own: the page never waits for it."""

    rover: Rover
    failure: str = "connecting"
    _state: tuple[JointsState, ModeState] | None = None
    _ended: threading.Event = field(default_factory=threading.Event)

    @classmethod
    def to(cls, robot: str, endpoint: str) -> Self:
        """A link that has not begun. Raises `LrmError`: no name of a robot, no endpoint of zenoh."""
        return cls(Rover(robot, [endpoint]))

    def start(self) -> None:
        """Begins to ask, until `close` or the end of the program, which zenoh does not survive amid a query."""
        asking = threading.Thread(target=self._ask, daemon=True)
        asking.start()
        atexit.register(asking.join, AGAIN_S)
        atexit.register(self.close)

    def close(self) -> None:
        """Ends it."""
        self._ended.set()

    def tip(self, model: Model) -> RoverTip:
        """Position of the arm now. Raises `LrmError` if the daemon is silent or has another arm."""
        if self._state is None:
            raise LrmError(self.failure)
        joints, mode = self._state
        known = dict(zip(joints.names, joints.q_rad, strict=True))
        names = [f"joint{i + 1}" for i in range(model.arm.dof)]
        missing = [name for name in names if name not in known]
        if missing:
            raise LrmError(f"the robot '{self.rover.robot}' has no {missing[0]}: is it another arm?")
        q, load = np.array([known[name] for name in names]), mode.payload_kg
        lines = [arm_lines(solve_equilibrium(one, poses_of(q, load)))[0] for one in (model_of(model.arm, ()), model)]
        return RoverTip(f"{mode.mode} ({mode.why})", q, load, *lines)

    def _ask(self) -> None:
        while not self._ended.is_set():
            try:
                with self.rover as rover:
                    while not self._ended.wait(LOOK_S):
                        self._state = rover.joints(), rover.mode()
            except LrmError as error:
                self._state, self.failure = None, str(error)
                self._ended.wait(AGAIN_S)
