"""Commanded poses: the input of every model."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.kinematics.chain import Number
from lrm_math.kinematics.history import PACE_S, History


@dataclass(frozen=True, eq=False)
class Poses:
    """N commanded poses of an arm with n joints.

    Attributes:
        q: (N, n), commanded joint angles (rad).
        payload: (N,), load carried (kg).
        direction: (N, n), sign of the last move of each joint (−1, 0 unknown, +1), or None if the order is unknown.
        t: (N,), time since the start (s), or None.
        session: (N,), number of the power-on session, or None.
        temperature: (N,), °C, or None.
        number: (N,), number of each pose in error messages, or None: 1 … N.
        friction: (N, n, K), states (−1 … 1) of elements of dry friction that the moves so far have turned over, see
            `lrm_math.kinematics.motion`, or None if the moves are unknown.
        running: (N,), time since the servos got power in the session (s), where that is not known since its first
            pose, or None.
        powered: (N,), time since they first got power (s); None where that is not known.
        warmed: (N,), K, temperature less that of then, or of the first pose. power_cycle: (N,), number of the session
            from 0, in the order of their numbers. Both follow from all the poses first given, and stay with each.
        gravity: (N, 3), unit vectors of gravity's direction in the frame of measurement; None: as the arm file says.
        history: what the arm was sent to before each of them, and when, see `lrm_math.kinematics.history`; or None.
        placement: (N,), number from 1 of where what is touched stands, see `TouchedPoint`; None: nothing is touched.
        sha256: of the file that they were read from; None: of none.
    """

    q: Array
    payload: Array
    direction: Array | None = None
    t: Array | None = None
    session: Array | None = None
    temperature: Array | None = None
    number: NDArray[np.int64] | None = None
    friction: Array | None = None
    running: Array | None = None
    powered: Array | None = None
    warmed: Array | None = None
    power_cycle: NDArray[np.int64] | None = None
    gravity: Array | None = None
    history: History | None = None
    placement: NDArray[np.int64] | None = None
    sha256: str | None = None

    def __post_init__(self) -> None:
        if self.warmed is None and self.temperature is not None:
            object.__setattr__(self, "warmed", self.temperature - self.temperature[:1])
        if self.power_cycle is None and self.session is not None:
            object.__setattr__(self, "power_cycle", np.unique(self.session, return_inverse=True)[1].reshape(-1))
        if self.q.ndim != 2 or self.payload.shape != (len(self.q),):
            shapes = f"q has shape {self.q.shape} and payload {self.payload.shape}"
            raise LrmError(f"poses: {shapes}; should be (N, n) and (N,)")

    def __repr__(self) -> str:
        return f"<Poses: {len(self)} of {self.q.shape[1]} joints>"

    def __len__(self) -> int:
        return len(self.q)

    @property
    def clock(self) -> Array | None:
        """(N,), time since the start (s); where it was not measured, `PACE_S` for each pose by its number; or None."""
        return PACE_S * self.number.astype(np.float64) if self.t is None and self.number is not None else self.t

    def names(self, rows: ArrayLike) -> list[int]:
        """The numbers of some rows."""
        chosen = np.asarray(rows)
        return [int(number) for number in (chosen + 1 if self.number is None else self.number[chosen])]

    def angle(self, joint: int) -> Number:
        """Commanded angle of joint number `joint` from 0 (rad): (N,), or a float if there is one pose only."""
        return _number(self.q[:, joint])

    def approach(self, joint: int) -> Number:
        """Sign of the last move of joint number `joint` from 0, 0 where unknown: (N,), or a float for one pose."""
        return 0.0 if self.direction is None else _number(self.direction[:, joint])

    def friction_states(self, joint: int, count: int) -> tuple[Number, ...]:
        """States of the `count` friction elements of a joint; where its moves are unknown, as after a long move."""
        if self.friction is None:
            return (self.approach(joint),) * count
        return tuple(_number(self.friction[:, joint, k]) for k in range(count))

    @property
    def down(self) -> tuple[Number, Number, Number] | None:
        """Components of gravity's direction, each (N,), or a float if it is the same in all poses; None if unknown."""
        if self.gravity is None:
            return None
        same = len(self) > 0 and bool((self.gravity == self.gravity[0]).all())
        x, y, z = self.gravity[0].tolist() if same else self.gravity.T
        return x, y, z

    @property
    def carried(self) -> Number:
        """Load carried (kg): (N,), or a float if it is the same in all poses."""
        same = len(self) and bool(np.all(self.payload == self.payload[0]))
        return float(self.payload[0]) if same else self.payload

    def take(self, rows: ArrayLike) -> Poses:
        """The poses of some rows (indices or a mask), in that order."""
        chosen = np.asarray(rows)
        columns = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "sha256"}
        return replace(self, **{name: column[chosen] for name, column in columns.items() if column is not None})

    def turned(self, rotation: Array) -> Poses:
        """The same poses where the frame of measurement is turned: directions d to R d, with R (3, 3)."""
        if self.gravity is None:
            return self
        history = None if self.history is None else self.history.turned(rotation)
        return replace(self, gravity=self.gravity @ rotation.T, history=history)

    def perturbed(self, joint: int, step: float | Array) -> Poses:
        """The same poses with one joint angle changed by `step` (rad), a float or (N,)."""
        q = self.q.copy()
        q[:, joint] += step
        return replace(self, q=q)


def _number(column: Array) -> Number:
    if isinstance(column, np.ndarray):
        return float(column[0]) if len(column) == 1 else np.ascontiguousarray(column)
    return column  # a dual number (`lrm_math.kinematics.dual`)


def poses_of(
    q: ArrayLike, payload: ArrayLike = 0.0, direction: Array | None = None, friction: Array | None = None
) -> Poses:
    """Poses from angles (N, n) or (n,) in rad and payload in kg, one number or (N,); `direction` (N, n) of arrival, and
    states of friction (N, n, K)."""
    angles = np.atleast_2d(np.asarray(q, dtype=np.float64))
    carried = np.broadcast_to(np.asarray(payload, dtype=np.float64), (len(angles),)).copy()
    return Poses(angles, carried, direction, friction=friction)


def roberts_sequence(count: int, n: int) -> Array:
    """(count, n), evenly over the unit cube: additive sequence with irrational steps (Roberts 2018)."""
    golden = 2.0
    for _ in range(40):
        golden = (1.0 + golden) ** (1.0 / (n + 1))
    return (0.5 + np.outer(np.arange(1, count + 1), golden ** -np.arange(1.0, n + 1.0))) % 1.0
