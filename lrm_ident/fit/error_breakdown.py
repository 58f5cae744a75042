"""Where a model fails: its error beside held-out error, split by everything that may drive it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.error_stats import ErrorFigures, figures
from lrm_ident.data.measurements import Measurements
from lrm_ident.fit.cross_validation import held_out
from lrm_ident.fit.levenberg_marquardt import Bounds
from lrm_ident.fit.loss import Loss
from lrm_ident.fit.priors import Prior
from lrm_ident.progress import Tick, silent
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.model.derivatives import joint_jacobian
from lrm_math.model.equilibrium import Equilibrium, equilibrium
from lrm_math.model.model import Model, model_of

MOST_LEVELS, BINS, ORDER_PARTS, WORST = 8, 6, 10, 10


@dataclass(frozen=True)
class Group:
    """Some of the poses: what they share, how many, their error, and the mean residual (m).

    `acts_like`: the rotation of the factor's joint (rad) that would explain most of the group's residual, or None.
    """

    label: str
    count: int
    error: ErrorFigures
    bias: tuple[float, float, float]
    acts_like: float | None


@dataclass(frozen=True)
class Factor:
    """One way to split the poses.

    `share`: part of the residual's sum of squares (0 to 1) that the groups' means explain, less what as many groups
    drawn at random would (adjusted R²). It shows where to look; it is no test of a cause.
    """

    kind: str
    name: str
    share: float
    groups: tuple[Group, ...]

    @property
    def worst(self) -> Group:
        """The group with the largest RMS."""
        return max(self.groups, key=lambda group: group.error.rms)


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Held-out residual (N, 3) in m, or the reason why there is none."""

    residual: Array | None
    reason: str = ""

    @property
    def error(self) -> ErrorFigures | None:
        """Its figures."""
        return None if self.residual is None else figures(self.residual)


@dataclass(frozen=True, eq=False)
class Comparison:
    """A model against measurements. `factors` stand in falling order of their share; `worst`: rows, worst first."""

    rest: Equilibrium
    residual: Array
    nominal: ErrorFigures
    error: ErrorFigures
    held_out: HeldOut
    factors: tuple[Factor, ...]
    worst: tuple[int, ...]


def compare(model: Model, data: Measurements, progress: Tick = silent, prior: Prior | None = None) -> Comparison:
    """Compares a model, as it is, with measurements; held out, its free parameters are refitted in every fold.

    Raises:
        NotSettled: the model has no equilibrium at some pose.
    """
    rest = equilibrium(model, data.poses)
    residual = data.tcp - rest.tcp
    nominal = equilibrium(model_of(model.arm, ()), data.poses)
    distance = np.linalg.norm(residual, axis=1)
    return Comparison(
        rest=rest,
        residual=residual,
        nominal=figures(data.tcp - nominal.tcp),
        error=figures(residual),
        held_out=try_held_out(model, data, progress=progress, prior=prior),
        factors=tuple(sorted(_factors(rest, data, residual), key=lambda factor: -factor.share)),
        worst=tuple(np.argsort(-distance)[:WORST].tolist()),
    )


def try_held_out(
    model: Model,
    data: Measurements,
    bounds: Bounds | None = None,
    loss: Loss | None = None,
    progress: Tick = silent,
    prior: Prior | None = None,
) -> HeldOut:
    """Held-out error, or why it cannot be had (too few poses, a fold that does not converge)."""
    try:
        return HeldOut(held_out(model, data, bounds, loss, progress, prior=prior))
    except LrmError as error:
        return HeldOut(None, str(error))


def _factors(rest: Equilibrium, data: Measurements, residual: Array) -> Iterator[Factor]:
    J = joint_jacobian(rest)
    torque = rest.joint_torque
    for i in range(rest.model.arm.dof):
        turns = J[:, :, i]
        by_angle, by_torque = _by_value(np.degrees(data.poses.q[:, i]), "°"), _by_quantile(torque[:, i], " N·m")
        yield _factor("angle", f"angle of joint {i + 1}", *by_angle, residual, turns)
        yield _factor("torque", f"torque of joint {i + 1}", *by_torque, residual, turns)
    if np.ptp(data.poses.payload) > 0:
        yield _factor("load", "load", *_by_value(data.poses.payload * 1e3, " g"), residual)
    yield _factor("order", "order of measurement", *_by_order(data), residual)
    yield _factor("region", "region of the workspace", *_by_octant(data.tcp), residual)


def _factor(
    kind: str, name: str, group: NDArray[np.int64], labels: Sequence[str], residual: Array, turns: Array | None = None
) -> Factor:
    groups, explained = [], 0.0
    for number, label in enumerate(labels):
        chosen = group == number
        if chosen.any():
            bias = residual[chosen].mean(axis=0)
            explained += float(chosen.sum() * (bias**2).sum())
            acts_like = None if turns is None else _best_turn(residual[chosen], turns[chosen])
            x, y, z = bias.tolist()
            groups.append(Group(label, int(chosen.sum()), figures(residual[chosen]), (x, y, z), acts_like))
    return Factor(kind, name, _adjusted(explained, residual, len(groups)), tuple(groups))


def _adjusted(explained: float, residual: Array, groups: int) -> float:
    total = float((residual**2).sum())
    if total == 0.0 or len(residual) <= groups:
        return 0.0
    around_mean = total - len(residual) * float((residual.mean(axis=0) ** 2).sum())
    between = explained - (total - around_mean)
    if around_mean <= 0.0 or len(residual) < 2:
        return 0.0
    share = 1.0 - (1.0 - between / around_mean) * (len(residual) - 1) / (len(residual) - groups)
    return max(share, 0.0)


def _best_turn(residual: Array, turns: Array) -> float:
    """The one rotation that fits these residuals best, by least squares (rad)."""
    length = float((turns**2).sum())
    return float((residual * turns).sum() / length) if length > 0 else 0.0


def _by_value(values: Array, unit: str) -> tuple[NDArray[np.int64], list[str]]:
    """Groups by level where there are few, else by equal steps."""
    levels, group = np.unique(np.round(values, 3), return_inverse=True)
    if len(levels) <= MOST_LEVELS:
        return group.reshape(-1), [f"{level:g}{unit}" for level in levels]
    return _cut(values, np.linspace(values.min(), values.max(), BINS + 1), unit)


def _by_quantile(values: Array, unit: str) -> tuple[NDArray[np.int64], list[str]]:
    return _cut(values, np.unique(np.quantile(values, np.linspace(0.0, 1.0, BINS + 1))), unit)


def _cut(values: Array, edges: Array, unit: str) -> tuple[NDArray[np.int64], list[str]]:
    if len(edges) < 2:
        return np.zeros(len(values), dtype=np.int64), [f"{values[0]:.3g}{unit}"]
    group = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    return group, [f"{low:.3g} to {high:.3g}{unit}" for low, high in pairwise(edges)]


def _by_order(data: Measurements) -> tuple[NDArray[np.int64], list[str]]:
    parts = np.array_split(np.arange(len(data)), min(ORDER_PARTS, len(data)))
    group = np.concatenate([np.full(len(part), number) for number, part in enumerate(parts)])
    return group, [f"poses {data.pose[part[0]]} to {data.pose[part[-1]]}" for part in parts]


def _by_octant(tcp: Array) -> tuple[NDArray[np.int64], list[str]]:
    middle = np.median(tcp, axis=0)
    group = ((tcp > middle) * [1, 2, 4]).sum(axis=1)
    labels = [
        ", ".join(f"{axis} {'>' if octant >> i & 1 else '<'} {middle[i] * 1e3:.0f} mm" for i, axis in enumerate("xyz"))
        for octant in range(8)
    ]
    return group, labels
