"""Range of what a model was fitted on, and how forms that are only known there are continued beyond it.

A curve through measurements says nothing beyond them, and a spline or a series grows without bound there. Beyond the
range such a form sees its covariate held at the range's edge; the way there is smooth, so that derivatives exist.

An angle is not reduced by whole turns. On an arm whose limits lie within one turn the question does not arise; on
one that turns further, what repeats with a turn is the kinematic error of gears and their eccentricity (Tuttle &
Seering 1996), which `eccentricity` states by formula, everywhere; cables and hoses, which a curve stands for as well,
wind up.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array
from lrm_math.effects.reversion import Reversion, correlation
from lrm_math.kinematics.chain import Number
from lrm_math.kinematics.dual import Dual
from lrm_math.kinematics.poses import Poses
from lrm_math.kinematics.scalar_or_array import exp, negative_part, positive_part

Interval: TypeAlias = tuple[float, float]
FADE = 0.05
"""Width of the way to the held value, as a part of the range's width."""
NARROWEST = 1e-9
SLACK = 1e-6
"""Part of a range's width that round-off of a file may lie beyond it."""


def held(x: Number, lower: float | Array, upper: float | Array) -> Number:
    """x within an interval; beyond it e the nearer end + e exp(−(e/w)²), e the excess and w `FADE` of the width.

    Twice continuously differentiable, never farther from the interval than 0.43 w, and its end from 3 w on.
    """
    excess, square = _excess(x, lower, upper)
    return x - excess * (1.0 - exp(-square))


def fading(x: Number, lower: float, upper: float) -> Number:
    """1 within an interval; beyond it exp(−(e/w)²), e the excess and w `FADE` of the width: below 1e-15 from 6 w on."""
    return exp(-_excess(x, lower, upper)[1])


def _excess(x: Number, lower: float | Array, upper: float | Array) -> tuple[Number, Number]:
    """e, x less the nearer end of an interval, zero within it, and (e/w)²."""
    excess = positive_part(x - upper) + negative_part(x - lower)
    part = excess / (FADE * (upper - lower) + NARROWEST)
    return excess, part * part


@dataclass(frozen=True)
class UnmeasuredAngles:
    """Error of each joint's angle, as far as the measured angles leave it open, whatever formulas a model has.

    It is a Gaussian process of the joint's angle (Matérn, 3/2; Rasmussen & Williams 2006, Eq 4.17), which the
    poses determine at the angles where the joint was measured, and at no other.

    Attributes:
        measured: angles at which each joint was measured (rad), ascending.
        sd: standard deviation of each joint's error far from these (rad).
    """

    measured: tuple[tuple[float, ...], ...]
    sd: tuple[float, ...]

    def spread(self, q: Array) -> Array:
        """(N, n), standard deviations of the joints' errors at commands q (N, n) (rad): zero where they were measured,
        larger between, `sd` far beyond."""
        columns = zip(q.T, self.measured, self.sd, strict=True)
        spread = [sd * np.sqrt(_left_open(angle, np.array(measured))) for angle, measured, sd in columns]
        return np.asarray(np.stack(spread, axis=1))


def _left_open(angle: Array, measured: Array) -> Array:
    """(N,), share of the process's variance that is left at angles (rad) when it is known at others."""
    between = np.asarray(correlation(np.abs(angle[:, None] - measured)))
    told = np.linalg.solve(np.asarray(correlation(np.abs(measured[:, None] - measured))), between.T).T
    return np.asarray(np.clip(1.0 - (between * told).sum(axis=1), 0.0, 1.0))


@dataclass(frozen=True)
class MeasuredRange:
    """Lowest and highest value of what the poses of a fit had.

    Attributes:
        angle: commands of every joint (rad). payload: kg.
        load: on slots, by key: N·m, or N along one that slides.
        t, running: s since the start, and since the session began; None where no time was known.
        tcp: of the TCP's x, y and z (m); None where it is not known.
        centre: mean position of the TCP (m), about which a tracker's frame distorts; None: about the base's origin.
        unmeasured: what is left open between the measured angles and beyond them; None where it is not known.
        reversion: to the model without its empirical terms; None where all of them hold.
        candidates: names of added effects, `id@place`, that the poses do not identify as causes: another law may stand
            behind them, which goes on otherwise beyond the range.
    """

    angle: tuple[Interval, ...]
    payload: Interval
    load: Mapping[str, Interval] = field(default_factory=dict)
    t: Interval | None = None
    running: Interval | None = None
    tcp: tuple[Interval, ...] | None = None
    centre: tuple[float, ...] | None = None
    unmeasured: UnmeasuredAngles | None = None
    reversion: Reversion | None = None
    candidates: tuple[str, ...] = ()

    def outside(self, q: Array) -> NDArray[np.bool_]:
        """(N, n), joints that stand outside their range at commands q (N, n) (rad)."""
        lower, upper = self._ends
        slack = SLACK * (upper - lower) + NARROWEST
        return np.asarray((q < lower - slack) | (q > upper + slack))

    def joints_outside(self, q: Array) -> tuple[int, ...]:
        """Numbers from 1 of the joints that stand outside their range at one command q (n,) (rad)."""
        return tuple((np.flatnonzero(self.outside(np.atleast_2d(q))[0]) + 1).tolist())

    def sentence(self, q: Array) -> str:
        """Number of commands q (N, n) (rad) lie outside, by which joints; empty if none does."""
        outside = self.outside(q)
        poses, beyond = int(outside.any(axis=1).sum()), np.flatnonzero(outside.any(axis=0)) + 1
        if not poses:
            return ""
        joints = ", ".join(map(str, beyond.tolist()))
        what = f"{poses} of {len(q)} poses lie outside the range that the model was fitted on (joint {joints})"
        held = f"{what}: there its curves stay as at the range's edge, and its error is not known"
        return held if self.reversion is None else f"{held}. {self.reversion.sentence.rstrip('.')}"

    def poses(self, poses: Poses) -> Poses:
        """The poses as a held form sees them."""
        lower, upper = self._ends
        changed: dict[str, Any] = {}
        if isinstance(poses.q, Dual) or ((poses.q < lower) | (poses.q > upper)).any():
            changed["q"] = held(poses.q, lower, upper)
        for name, ends in (("payload", self.payload), ("t", self.t), ("running", self.running)):
            values = getattr(poses, name)
            if ends is not None and values is not None and ((values < ends[0]) | (values > ends[1])).any():
                changed[name] = held(values, *ends)
        return replace(poses, **changed) if changed else poses

    def loads(self, slots: tuple[str, ...], tau: tuple[Number, ...]) -> tuple[Number, ...]:
        """Loads on slots as a held form sees them; those that were not measured as they are."""
        return tuple(held(x, *self.load[key]) if key in self.load else x for key, x in zip(slots, tau, strict=True))

    @cached_property
    def _ends(self) -> tuple[Array, Array]:
        lower, upper = np.array(self.angle).T
        return lower, upper
