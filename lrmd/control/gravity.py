"""Direction of gravity on a vehicle that leans: told by an accelerometer, used while it is fresh, adopted in steps.

Theory of operation: `cmd/gravity` tells a direction as often as its sender likes. What is told is kept with its time.
The direction that was told last is used as long as it is no older than `max_age_s`; then that of the model, or with
`fallback = "last"` still the last one. Another one is adopted if it leans by more than `STEP` against the one in use,
and no more often than every `PERIOD`: model, guard and torques follow each of them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from lrm_math.arrays import Vector3
from lrmd.config import SECOND, Config
from lrmd.errors import RequestError

STEP = math.radians(0.2)
"""rad, by which the lab arm's tip moves by less than 0.1 mm."""
PERIOD = SECOND // 2
LEAST, MOST = 9.3, 10.3
"""m/s²: what a cheap accelerometer reads anywhere on Earth, at rest or nearly so."""


class KnownGravity:
    """Directions are unit vectors in the arm's frame, None where the model's is meant; times are monotonic ns.

    `used`: in use. `told`, `at`: what was told last, and when.
    """

    def __init__(self, config: Config) -> None:
        self._stated = config.arm.gravity
        self._max_age = config.gravity_age
        self._keeps_last = config.gravity_keeps_last
        self.used: Vector3 | None = None
        self.told: Vector3 | None = None
        self.at = 0
        self._adopted_at: int | None = None

    def tell(self, gravity: Sequence[float], now: int) -> None:
        """Keeps the direction of a vector (m/s²). Raises `RequestError`: not as long as gravity, or it points up."""
        size = math.hypot(*gravity)
        if not LEAST <= size <= MOST:
            raise RequestError("gravity", f"its length is {size:.2f} m/s2; gravity's is {LEAST} to {MOST}")
        if not any(self._stated):
            raise RequestError("gravity", "the arm file states no gravity, so its model knows no weight")
        if sum(a * b for a, b in zip(gravity, self._stated, strict=True)) <= 0.0:
            text = "gravity points away from that of the arm file; an accelerometer at rest reads upwards: change signs"
            raise RequestError("gravity", text)
        x, y, z = (component / size for component in gravity)
        self.told, self.at = (x, y, z), now

    def age_s(self, now: int) -> float | None:
        """Time since the last direction was told (s); None if none was."""
        return None if self.told is None else (now - self.at) / SECOND

    def fresh(self, now: int) -> bool:
        """Whether a direction was told and is not too old."""
        return self.told is not None and now - self.at <= self._max_age

    def due(self, now: int) -> bool:
        """Whether another direction than the one in use has to be adopted now."""
        wanted = self._wanted(now)
        if wanted is None or self.used is None:
            return wanted is not self.used
        recent = self._adopted_at is not None and now - self._adopted_at < PERIOD
        return not recent and angle_between(wanted, self.used) > STEP

    def adopt(self, now: int) -> Vector3 | None:
        """Uses the direction that is due from now on, and returns it."""
        self.used, self._adopted_at = self._wanted(now), now
        return self.used

    def _wanted(self, now: int) -> Vector3 | None:
        return self.told if self._keeps_last or self.fresh(now) else None


def angle_between(a: Vector3, b: Vector3) -> float:
    """Angle between two unit vectors (rad)."""
    return 2.0 * math.asin(min(1.0, 0.5 * math.dist(a, b)))
