"""A small grammar of laws: rotations of a joint and extensions of a link by one or two quantities of the pose.

Exhaustive symbolic regression (Bartlett, Desmond & Ferreira 2023) with linear coefficients: harmonics, powers, absolute
values, steps, hinges, saturations and bumps of one quantity; harmonics and hinges of sums and differences, and products
of two. Torques of other joints enter alone, and a length follows one quantity.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from lrm_ident.residual.covariates import levels
from lrm_math.arrays import Array
from lrm_math.kinematics.poses import Poses

HARMONICS, PAIR_HARMONICS, FACTOR_HARMONICS = range(1, 7), (1, 2, 3), (1, 2)
PLACES = (-1.2, -0.8, -0.4, 0.0, 0.4, 0.8, 1.2)  # rad, or parts of the largest torque, load or time
WIDTH = 0.4  # of bumps and saturations, likewise
NEAR_ZERO = 1e-9
LETTERS = "abcdef"


@dataclass(frozen=True)
class Quantity:
    """A quantity that a law may depend on.

    Attributes:
        name: in formulas. code: Python code for it from `poses`, and from `{tau}` if it is the torque of a joint.
        low, high: its range at the poses. levels: number of different values there.
        angle_of, torque_of: joint (from 0) of which it is the angle, or the torque.
        foreign: whether it is the torque of another one than the law's.
    """

    name: str
    code: str
    low: float
    high: float
    levels: int
    angle_of: int | None = None
    torque_of: int | None = None
    foreign: bool = False

    @property
    def signed(self) -> bool:
        """Whether it has values of both signs."""
        return self.low < 0.0 < self.high


@dataclass(frozen=True)
class Law:
    """Error motion at a joint: a sum of terms with a free coefficient each.

    Attributes:
        joint: from 0. slot: what moves: `theta`, a rotation (rad), or `a` or `d`, a length of the link after it (m).
        terms: Python expressions with numpy over the names of `quantities`.
    """

    joint: int
    quantities: tuple[Quantity, ...]
    terms: tuple[str, ...]
    slot: str = "theta"

    @property
    def key(self) -> str:
        """Key of the chain's slot that moves, for instance `joint3.theta`."""
        return f"joint{self.joint + 1}.{self.slot}"

    @property
    def rotates(self) -> bool:
        """Whether it is a rotation (rad), not a length (m)."""
        return self.slot == "theta"

    @property
    def torques_of(self) -> tuple[int, ...]:
        """Joints (from 0) whose torques enter it."""
        return tuple(
            dict.fromkeys(quantity.torque_of for quantity in self.quantities if quantity.torque_of is not None)
        )

    @property
    def size(self) -> int:
        """Complexity: number of quantities and terms."""
        return len(self.quantities) + len(self.terms)

    @property
    def formula(self) -> str:
        """Formula, for instance `δq3 = a sin(q1 + q4) + b cos(q1 + q4)`."""
        terms = (term.replace("np.", "").replace("**", "^") for term in self.terms)
        symbol = "q" if self.rotates else self.slot
        return (
            f"δ{symbol}{self.joint + 1} = "
            f"{' + '.join(f'{name} {term}' for name, term in zip(LETTERS, terms, strict=False))}"
        )

    def plus(self, other: Law) -> Law:
        """The sum of two laws of one slot; terms that both have count once."""
        quantities = dict.fromkeys((*self.quantities, *other.quantities))
        return replace(self, quantities=tuple(quantities), terms=tuple(dict.fromkeys((*self.terms, *other.terms))))

    def code_of(self, quantity: Quantity) -> str:
        """Python code for one of its quantities from `poses` and `tau`, the torques of the joints `torques_of`."""
        joint = quantity.torque_of
        return quantity.code.format(tau="" if joint is None else f"tau[{self.torques_of.index(joint)}]")

    def values(self, poses: Poses, torque: Array) -> Array:
        """(N, terms), every term at some poses; torque: (N, n), on the joints (N·m)."""
        given = {"poses": poses, "tau": torque.T[list(self.torques_of)]}
        values_by_name = {quantity.name: eval(self.code_of(quantity), {}, given) for quantity in self.quantities}
        columns = [np.asarray(eval(term, {"np": np}, values_by_name), dtype=np.float64) for term in self.terms]
        return np.stack([np.broadcast_to(column, len(poses)) for column in columns], axis=1)


def quantities_at(joint: int, poses: Poses, torque: Array) -> tuple[Quantity, ...]:
    """Quantities that a law at one joint may depend on: angles, torques, load, side and time, as far as they vary.

    Torques (`tau` of the joint itself, `tau`k of joint k), load and time are divided by their largest values.

    Args:
        torque: (N, n), on the joints (N·m).
    """
    quantities = [_quantity(f"q{i + 1}", f"poses.angle({i})", angle, i) for i, angle in enumerate(poses.q.T)]
    for k, tau in enumerate(torque.T):
        relative = _relative_quantity("tau" if k == joint else f"tau{k + 1}", "{tau}", tau)
        quantities.append(replace(relative, torque_of=k, foreign=k != joint))
    quantities.append(_relative_quantity("load", "poses.carried", poses.payload))
    if poses.direction is not None:
        quantities.append(_quantity("side", f"poses.approach({joint})", poses.direction[:, joint]))
    if poses.t is not None:
        quantities.append(_relative_quantity("time", "poses.t", poses.t))
    return tuple(quantity for quantity in quantities if quantity.levels > 1)


def _quantity(name: str, code: str, values: Array, angle_of: int | None = None) -> Quantity:
    """A quantity with the range and the levels of its values (N,)."""
    distinct = len(levels(values, 4)[0])
    return Quantity(name, code, float(values.min()), float(values.max()), distinct, angle_of)


def _relative_quantity(name: str, code: str, values: Array) -> Quantity:
    """A quantity divided by its largest size."""
    largest = float(np.abs(values).max())
    return _quantity(name, f"{code} / {largest:.4g}", values / max(largest, NEAR_ZERO))


def laws_at(joint: int, quantities: tuple[Quantity, ...]) -> Iterator[Law]:
    """Every law of the grammar at one joint."""
    for quantity in quantities:
        for terms in _terms_of_one(quantity):
            yield Law(joint, (quantity,), terms)
    for a, b in combinations([quantity for quantity in quantities if not quantity.foreign], 2):
        for terms in _terms_of_two(a, b):
            yield Law(joint, (a, b), terms)


def extensions_at(joint: int, slot: str, quantities: tuple[Quantity, ...]) -> Iterator[Law]:
    """Every law of the grammar by which the length `slot` (`a` or `d`) of the link after a joint grows."""
    for quantity in quantities:
        if quantity.name != "side":
            yield from (Law(joint, (quantity,), terms, slot) for terms in _terms_of_one(quantity))


def _terms_of_one(x: Quantity) -> Iterator[tuple[str, ...]]:
    """Terms of every law of one quantity."""
    yield (x.name,)
    if x.name == "side" or x.levels < 3:
        return
    if x.angle_of is not None:
        yield from ((_wave("sin", k, x.name), _wave("cos", k, x.name)) for k in HARMONICS)
    yield from ((f"{x.name}**2",), (f"{x.name}**3",))
    if x.signed:
        yield from ((f"np.abs({x.name})",), (f"{x.name} * np.abs({x.name})",))
    for shifted in _shifted(x.name, x.low, x.high):
        yield (f"np.heaviside({shifted}, 0.5)",)
        yield (f"np.maximum({shifted}, 0.0)",)
        yield (f"np.tanh(({shifted}) / {WIDTH})",)
        yield (f"np.exp(-(({shifted}) / {WIDTH})**2)",)


def _terms_of_two(a: Quantity, b: Quantity) -> Iterator[tuple[str, ...]]:
    """Terms of every law of two quantities."""
    if a.angle_of is not None and b.angle_of is not None:
        for sign, low, high in (("+", a.low + b.low, a.high + b.high), ("-", a.low - b.high, a.high - b.low)):
            both = f"{a.name} {sign} {b.name}"
            yield from ((_wave("sin", k, both), _wave("cos", k, both)) for k in PAIR_HARMONICS)
            yield from ((f"np.maximum({shifted}, 0.0)",) for shifted in _shifted(both, low, high))
            yield (f"np.abs({both})",)
    yield from ((f"{factor} * {right}",) for factor in _factors(a) for right in _factors(b))


def _shifted(of: str, low: float, high: float) -> Iterator[str]:
    """Code of a quantity less each of the `PLACES` within its range."""
    for place in PLACES:
        if low < place < high:
            yield of if place == 0 else f"{of} {'-' if place > 0 else '+'} {abs(place)}"


def _factors(x: Quantity) -> Iterator[str]:
    yield x.name
    if x.signed and x.name != "side":
        yield f"np.abs({x.name})"
    if x.angle_of is not None:
        yield from (_wave(wave, k, x.name) for k in FACTOR_HARMONICS for wave in ("sin", "cos"))


def _wave(function: str, k: int, of: str) -> str:
    inside = of if k == 1 else f"{k} * ({of})" if " " in of else f"{k} * {of}"
    return f"np.{function}({inside})"
