"""History of a measurement: which load the arm held for how long before each pose.

What an arm was sent to and when is known whatever the parameters are; so the loads before a pose are those of the
nominal arm. The rows are put in the order of their times within each session; a session begins with nothing known of
what was before it. Where no times were measured, poses follow each other in equal steps, and a number that is left out
takes a step too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array
from lrm_math.kinematics import statics
from lrm_math.kinematics.chain import Chain, Number, trig
from lrm_math.kinematics.dual import Dual

PACE_S = 10.0
"""From pose to pose, where no times were measured: what has a memory follows their order then."""
TINY = 1e-100
"""Imaginary step of a derivative."""


@dataclass(frozen=True, eq=False)
class Visits:
    """All M poses that the arm was sent to, in the order of time.

    Attributes:
        q: (M, n), commands (rad). payload: (M,), kg. step: (M,), time since the pose before (s), 0 where it begins.
        begins: (M,), whether nothing is known of what was before: the first pose of each session.
        gravity: (M, 3), unit vectors of gravity's direction, or None: as the arm file says.
        timed: whether times were measured.
    """

    q: Array
    payload: Array
    step: Array
    begins: NDArray[np.bool_]
    gravity: Array | None = None
    timed: bool = True

    def loads(self, chain: Chain, slots: Sequence[int]) -> Array:
        """(M, len(slots)), gravity's load on slots, ascending, of the nominal arm (N·m; N along a translation)."""
        known = _LOADS.setdefault(self, {})
        key = chain, tuple(slots)
        if key not in known:
            values = chain.values(list(self.q.T))
            size = float(np.linalg.norm(chain.gravity))
            down = chain.gravity if self.gravity is None else tuple(size * self.gravity.T)
            found = statics.loads(
                chain, values, trig(chain, values), statics.weights(chain, self.payload), down, list(slots)
            )
            known[key] = np.stack([np.broadcast_to(load, len(self.q)) for load in found], axis=1)
        return known[key]


_LOADS: WeakKeyDictionary[Visits, dict[tuple[Chain, tuple[int, ...]], Array]] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class History:
    """History of N poses: `row` (N,) is the place of each among all `visits`."""

    visits: Visits
    row: NDArray[np.int64]

    def __getitem__(self, chosen: NDArray[np.int64]) -> History:
        """That of some of the poses: what was before them stays."""
        return History(self.visits, self.row[chosen])

    def turned(self, rotation: Array) -> History:
        """The same in a turned frame of measurement."""
        stated = self.visits.gravity
        return self if stated is None else replace(self, visits=replace(self.visits, gravity=stated @ rotation.T))


def history_of(
    q: Array,
    payload: Array,
    t: Array | None,
    session: Array | None,
    number: NDArray[np.int64],
    gravity: Array | None = None,
) -> History:
    """The history of poses (N, n), rows in the order measured; their times (N,) in s, sessions and numbers (N,).

    Poses of equal times were measured at once; a pose that is repeated was held again.
    """
    count = len(q)
    of = np.zeros(count) if session is None else np.unique(session, return_inverse=True)[1].reshape(-1)
    clock = t if t is not None else PACE_S * (number if (np.diff(number) > 0).all() else np.arange(count))
    order = np.lexsort((np.arange(count), clock, of))
    row = np.empty(count, dtype=np.int64)
    row[order] = np.arange(count)
    begins = np.diff(of[order], prepend=-1.0) != 0.0
    step = np.where(begins, 0.0, np.diff(clock[order], prepend=0.0))
    stated = None if gravity is None else gravity[order]
    return History(Visits(q[order], payload[order], step, begins, stated, t is not None), row)


def followed(visits: Visits, driver: Array, constant: Number, stood: Number) -> tuple[Number, Number]:
    """Memory dc/dt = (driver − c)/T at each of the M visits: the part of the loads before, and the share of its own.

    Between two poses the arm holds the first one, and the second one for the last `stood` seconds. What begins had
    stood there for long. The memory is the first, (M,), more the second, (M,), times the pose's own `driver`.

    Args:
        driver: (M,), what is followed. constant: T (s). stood: s. Either may carry derivatives.
    """
    if not isinstance(constant, Dual) and not isinstance(stood, Dual):
        return _followed(visits, driver, constant, stood)
    given = [x.value if isinstance(x, Dual) else x for x in (constant, stood)]
    values = _followed(visits, driver, *given)
    slopes: list[Array] = [np.zeros(1), np.zeros(1)]
    for i, x in enumerate((constant, stood)):
        if isinstance(x, Dual):  # complex step (Squire & Trapp 1998)
            stepped = [y + TINY * 1j * (i == j) for j, y in enumerate(given)]
            moved = _followed(visits, driver, *stepped)
            slopes = [s + part.imag / TINY * x.slope for s, part in zip(slopes, moved, strict=True)]
    past, own = (Dual(value.real, slope) for value, slope in zip(values, slopes, strict=True))
    return past, own  # type: ignore[return-value]


def _followed(visits: Visits, driver: Array, constant: Any, stood: Any) -> tuple[Array, Array]:
    last = np.where(np.real(stood) < visits.step, stood, visits.step)
    kept, after = np.exp(-visits.step / constant), np.exp(-last / constant)
    past = np.zeros(len(driver), dtype=kept.dtype)
    state = before = 0.0
    rows = zip(visits.begins.tolist(), kept.tolist(), after.tolist(), driver.tolist(), strict=True)
    for i, (begins, a, b, now) in enumerate(rows):
        if begins:
            state = now
        else:
            past[i] = a * state + (b - a) * before
            state = past[i] + (1.0 - b) * now
        before = now
    return past, np.where(visits.begins, 1.0, 1.0 - after)
