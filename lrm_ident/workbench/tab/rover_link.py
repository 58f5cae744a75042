"""A running `lrmd`, listened to over zenoh: where its arm is commanded, and where the model thinks the tip is."""

from __future__ import annotations

import json
import threading
import time
from dataclasses import dataclass, field
from typing import Any

import msgpack
import numpy as np
import zenoh

from lrm_ident.residual.picture.error_field import arm_lines
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of

SILENT_S = 2.0


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
    """A connection to one daemon; takes in its states as they come."""

    robot: str
    endpoint: str
    joints: dict[str, Any] = field(default_factory=dict)
    mode: dict[str, Any] = field(default_factory=dict)
    heard: float = float("-inf")
    failure: str = ""
    _session: Any = None

    def start(self) -> None:
        """Connects, without waiting for it: `tip` has the result."""
        threading.Thread(target=self._open, daemon=True).start()

    def _open(self) -> None:
        config = zenoh.Config()
        settings = {"mode": "client", "connect/endpoints": [self.endpoint], "scouting/multicast/enabled": False}
        try:
            for key, value in settings.items():
                config.insert_json5(key, json.dumps(value))
            self._session = zenoh.open(config)
        except zenoh.ZError:
            self.failure = f"no connection to {self.endpoint}; is lrmd running, and is the endpoint written so?"
            return
        for name, store in (("joints", self.joints), ("mode", self.mode)):
            self._session.declare_subscriber(f"lrm/{self.robot}/state/{name}", lambda s, of=store: self._take(of, s))

    def close(self) -> None:
        """Ends the connection."""
        if self._session is not None:
            self._session.close()
            self._session = None

    def tip(self, model: Model) -> RoverTip:
        """Position of the arm now. Raises `LrmError` if the daemon is silent or has another arm."""
        if self.failure:
            raise LrmError(self.failure)
        if time.monotonic() - self.heard > SILENT_S:
            raise LrmError(f"nothing is heard of the robot '{self.robot}' at {self.endpoint}; is the name right?")
        known = dict(zip(self.joints.get("names", []), self.joints.get("q_rad", []), strict=True))
        names = [f"joint{i + 1}" for i in range(model.arm.dof)]
        missing = [name for name in names if name not in known]
        if missing:
            raise LrmError(f"the robot '{self.robot}' has no {missing[0]}: is it another arm?")
        q, load = np.array([known[name] for name in names]), float(self.mode.get("payload_kg", 0.0))
        lines = [arm_lines(solve_equilibrium(one, poses_of(q, load)))[0] for one in (model_of(model.arm, ()), model)]
        mode = f"{self.mode.get('mode', 'mode unknown')} ({self.mode.get('why', '')})"
        return RoverTip(mode, q, load, *lines)

    def _take(self, store: dict[str, Any], sample: Any) -> None:
        try:
            state = msgpack.unpackb(sample.payload.to_bytes())
        except ValueError:
            return
        if isinstance(state, dict):
            store.update(state)
            self.heard = time.monotonic()
