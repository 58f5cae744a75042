"""History of a measurement: which load the arm held for how long before each pose.

What an arm was sent to and when is known whatever the parameters are; the loads before a pose are those of the nominal
arm, until they are known of a fitted one (`History.borne_by`). The rows are put in the order of their times within each
session; a session begins with nothing known of what was before it. Where no times were measured, poses follow each
other in equal steps, and a number that is left out takes a step too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
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
class LoadedArm:
    """An arm under gravity at M poses.

    Attributes:
        amounts: of every slot of its chain, each a float or (M,) (rad, m). bodies: their weights, payload included.
        gravity: in the frame of measurement (m/s²).
    """

    chain: Chain
    amounts: Sequence[Number]
    bodies: tuple[statics.Weight, ...]
    gravity: statics.Gravity


@dataclass(frozen=True, eq=False)
class Visits:
    """All M poses that the arm was sent to, in the order of time.

    Attributes:
        q: (M, n), commands (rad). payload: (M,), kg. step: (M,), time since the pose before (s), 0 where it begins.
        begins: (M,), whether nothing is known of what was before: the first pose of each session.
        gravity: (M, 3), unit vectors of gravity's direction, or None: as the arm file says.
        timed: whether times were measured. bore: the arm that bore the loads; None: the nominal one.
        start: (n,), angles before the first pose (rad); None: not known.
        begun: memory of each effect, by name, before the first of them; None: of a file, whose effects' own parameters
            tell what was before. Where it is given each step was spent at the pose that it leads to.
    """

    q: Array
    payload: Array
    step: Array
    begins: NDArray[np.bool_]
    gravity: Array | None = None
    timed: bool = True
    bore: LoadedArm | None = None
    start: Array | None = None
    begun: Mapping[str, tuple[float, ...]] | None = None

    def sides(self, joint: int, before: float = 0.0) -> Array:
        """(M,), sign of the last move of joint number `joint` from 0 that led to each pose; `before`: to the first."""
        first = self.q[:1] if self.start is None else self.start[None]
        side, sides = before, np.empty(len(self.q))
        for i, move in enumerate(np.sign(np.diff(self.q, axis=0, prepend=first)[:, joint]).tolist()):
            sides[i] = side = move or side
        return sides

    def loads(self, chain: Chain, slots: Sequence[str]) -> Array:
        """(M, len(slots)), gravity's load on slots, by their keys (N·m; N along a translation).

        `chain`: of the nominal arm.
        """
        cached, key = _LOADS.setdefault(self, {}), (chain, tuple(slots))
        if key not in cached:
            arm = self.bore or self.nominal(chain)
            numbers = [arm.chain.index[slot] for slot in slots]
            turned = trig(arm.chain, arm.amounts)
            loads_now = statics.loads(arm.chain, arm.amounts, turned, arm.bodies, arm.gravity, sorted(numbers))
            columns = dict(zip(sorted(numbers), loads_now, strict=True))
            cached[key] = np.stack([np.broadcast_to(columns[k], len(self.q)) for k in numbers], axis=1)
        return cached[key]

    def nominal(self, chain: Chain) -> LoadedArm:
        """The nominal arm at all visits."""
        x, y, z = chain.gravity if self.gravity is None else math.hypot(*chain.gravity) * self.gravity.T
        bodies = statics.weights(chain, self.payload)
        return LoadedArm(chain, chain.values(list(self.q.T)), bodies, (x, y, z))


_LOADS: WeakKeyDictionary[Visits, dict[tuple[Chain, tuple[str, ...]], Array]] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class History:
    """History of N poses: `row` (N,) is the place of each among all `visits`."""

    visits: Visits
    row: NDArray[np.int64]

    def __getitem__(self, chosen: NDArray[np.int64]) -> History:
        """That of some of the poses: what was before them stays."""
        return History(self.visits, self.row[chosen])

    def own(self, values: Any) -> Any:
        """(N,), values (M,) of all visits at these poses; a number for one pose."""
        return values[int(self.row[0])] if len(self.row) == 1 else values[self.row]

    def turned(self, rotation: Array) -> History:
        """The same in a turned frame of measurement, of the nominal arm."""
        stated = self.visits.gravity
        if stated is None:
            return self
        return replace(self, visits=replace(self.visits, gravity=stated @ rotation.T, bore=None))

    @property
    def order(self) -> NDArray[np.int64] | None:
        """(M,), the pose of each visit, where these are all visits; else None."""
        order = np.argsort(self.row)
        return order if np.array_equal(self.row[order], np.arange(len(self.visits.q))) else None

    def borne_by(self, arm: LoadedArm) -> History:
        """The same, with the loads that an arm bears at all visits."""
        return replace(self, visits=replace(self.visits, bore=arm))


def history_of(
    q: Array,
    payload: Array,
    t: Array | None,
    session: Array | None,
    number: NDArray[np.int64],
    gravity: Array | None = None,
    start: Array | None = None,
    hold: Array | None = None,
) -> History:
    """The history of poses (N, n), rows in the order measured; their times (N,) in s, sessions and numbers (N,).

    `start`: (n,), angles before the first of them (rad). `hold`: (N,), how long the arm was to stand at each before it
    was measured (s): where no times were measured, that adds to the equal steps.

    Poses of equal times were measured at once; a pose that is repeated was held again.
    """
    count = len(q)
    of = np.zeros(count) if session is None else np.unique(session, return_inverse=True)[1].reshape(-1)
    paced = PACE_S * (number if (np.diff(number) > 0).all() else np.arange(count))
    clock = t if t is not None else paced if hold is None else paced + np.cumsum(hold)
    order = np.lexsort((np.arange(count), clock, of))
    row = np.empty(count, dtype=np.int64)
    row[order] = np.arange(count)
    begins = np.diff(of[order], prepend=-1.0) != 0.0
    step = np.where(begins, 0.0, np.diff(clock[order], prepend=0.0))
    stated = None if gravity is None else gravity[order]
    return History(Visits(q[order], payload[order], step, begins, stated, t is not None, start=start), row)


def differentiable(function: Callable[..., tuple[Any, ...]], *shapes: Any) -> tuple[Any, ...]:
    """Values of a function of shape parameters that may carry derivatives, by complex steps (Squire & Trapp 1998)."""
    given = [x.value if isinstance(x, Dual) else x for x in shapes]
    values = function(*given)
    slopes: list[Any] = [None] * len(values)
    for i, x in enumerate(shapes):
        if isinstance(x, Dual):
            moved = function(*(y + TINY * 1j * (i == j) for j, y in enumerate(given)))
            by_x = [np.imag(part) / TINY * x.slope for part in moved]
            slopes = [new if old is None else old + new for old, new in zip(slopes, by_x, strict=True)]
    return tuple(v if s is None else Dual(v, s) for v, s in zip(values, slopes, strict=True))


def first_order_lag(
    visits: Visits,
    driver: Array,
    start: float,
    constant: Any,
    stood: Any = np.inf,
    rest: Any = 0.0,
    late: Any = 0.0,
) -> tuple[Array, Array]:
    """First-order lag dc/dt = (driver − c)/T at M visits: the part left of what was before, and the share of its own.

    Between two poses the arm holds the first one for the share `late` of the time or more, and the second one for the
    last `stood` seconds at most. The memory is the first more the second times the pose's own `driver`; each is (M,).

    Args:
        driver: (M,), what is followed. constant: T (s). stood: s; they may be complex (`differentiable`).
        rest: s that the first pose of a session had been held before its reading; before that there was no load.
        start: c before the first visit of a record (`Visits.begun`), for which stood, rest and late do not count.
    """
    if visits.begun is not None:
        stood, rest, late = np.inf, visits.step[0], 0.0
    step, there = np.where(visits.begins, rest, visits.step), (1.0 - late) * visits.step
    last = np.where(visits.begins, step, np.where(np.real(stood) < np.real(there), stood, there))
    kept, after = np.exp(-step / constant), np.exp(-last / constant)
    gained, going_on = 1.0 - after, np.where(visits.begins, 0.0, kept)
    begun = np.where(visits.begins, kept * start, (after - kept) * np.append(start, driver)[:-1])
    memory = _recurrence(going_on, begun + gained * driver, start)
    return begun + going_on * np.append(start, memory)[:-1], gained


def _recurrence(factor: Array, added: Array, start: float) -> Array:
    """(M,), x_i = a_i x_(i−1) + b_i from a start, in log₂ M steps that each double how far back a row has looked (Kogge
    & Stone 1973)."""
    a, x, back = factor.copy(), added.copy(), 1
    x[:1] += a[:1] * start
    while back < len(x):
        x[back:] += a[back:] * x[:-back]
        a[back:] *= a[:-back]
        back *= 2
    return x


def lag_state(visits: Visits, driver: Array, start: float, *shapes: float) -> Array:
    """(M,), the memory of a `first_order_lag` at the end of each visit; arguments as there."""
    past, gained = first_order_lag(visits, driver, start, *shapes)
    return np.asarray(past + gained * driver)
