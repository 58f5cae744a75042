"""A running `lrmd`, asked by its client: where its arm is commanded, and where the model thinks the tip is."""

from __future__ import annotations

import atexit
import threading
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np

from lrm_ident.report.plots.interactive.candidate_view import rounded
from lrm_ident.residual.picture.error_field import arm_lines
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from lrmd.client import JointsState, ModeState, Rover

LOOK_S, AGAIN_S = 0.2, 2.0
"""s between two questions, and until a daemon that was silent is asked anew."""


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

    def position(self, model: Model) -> dict[str, Any]:
        """Position of the arm now: `words`, and frames (mm), the TCP last, of the `nominal` arm and the `bent` model.

        Raises `LrmError`: the daemon is silent, or has another arm.
        """
        if self._state is None:
            raise LrmError(self.failure)
        joints, mode = self._state
        angles = dict(zip(joints.names, joints.q_rad, strict=True))
        names = [f"joint{i + 1}" for i in range(model.arm.dof)]
        missing = [name for name in names if name not in angles]
        if missing:
            raise LrmError(f"the robot '{self.rover.robot}' has no {missing[0]}: is it another arm?")
        q, load = np.array([angles[name] for name in names]), mode.payload_kg
        poses, models = poses_of(q, load), (model_of(model.arm, ()), model)
        nominal, bent = (arm_lines(solve_equilibrium(model, poses))[0] * 1e3 for model in models)
        x, y, z = bent[-1]
        words = (
            f"{mode.mode} ({mode.why}); q {' '.join(f'{angle:.1f}' for angle in np.degrees(q))} deg, load "
            f"{load * 1e3:.0f} g; the model puts the tip at {x:.2f} {y:.2f} {z:.2f} mm, "
            f"{np.linalg.norm(bent[-1] - nominal[-1]):.2f} mm from where the nominal arm would be"
        )
        return {"words": words, "nominal": rounded(nominal, 2), "bent": rounded(bent, 2)}

    def _ask(self) -> None:
        while not self._ended.is_set():
            try:
                with self.rover as rover:
                    while not self._ended.wait(LOOK_S):
                        self._state = rover.joints(), rover.mode()
            except LrmError as error:
                self._state, self.failure = None, str(error)
                self._ended.wait(AGAIN_S)
