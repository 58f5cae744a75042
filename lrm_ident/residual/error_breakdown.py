"""Breakdown of a model's error: nominal, fit and held-out error, and one-way analysis of variance by factor."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, pairwise

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.error_stats import ErrorStats, error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.data.notebook import ShownInNotebook
from lrm_ident.data.registration.set_up import nominal_arm
from lrm_ident.data.wording import in_mm
from lrm_ident.fitting.cross_validation import held_out_blocks
from lrm_ident.fitting.held_out import HeldOutBlock, held_out_residual, held_out_turns
from lrm_ident.fitting.loss import SQUARED, Loss
from lrm_ident.fitting.parameter_sets import Bounds
from lrm_ident.fitting.priors import Prior
from lrm_ident.fitting.progress import OnProgress, silent
from lrm_ident.residual.covariates import ExplanatoryVariable, levels
from lrm_ident.residual.deployment.deployed_error import DeployedError
from lrm_ident.residual.deployment.forecast_error import forecast_error
from lrm_ident.residual.predictability import PredictableError, predictable_error
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.model.derivatives import joint_jacobian
from lrm_math.model.equilibrium import Equilibrium, solve_equilibrium
from lrm_math.model.model import Model

MAX_LEVELS, BINS, ORDER_PARTS, WORST = 8, 6, 10, 10


@dataclass(frozen=True)
class PoseGroup:
    """A group of poses: label, count, error, and mean residual `bias` (m).

    `equivalent_rotation`: rotation of the factor's joint (rad) that fits the group's residual best, or None.
    """

    label: str
    count: int
    error: ErrorStats
    bias: tuple[float, float, float]
    equivalent_rotation: float | None


@dataclass(frozen=True)
class Factor:
    """Factor of an analysis of variance: a grouping of the poses.

    `share`: adjusted R² (0 to 1) of the group means; descriptive, no test of a cause.
    """

    variable: ExplanatoryVariable
    share: float
    groups: tuple[PoseGroup, ...]

    @property
    def worst(self) -> PoseGroup:
        """The group with the largest RMS."""
        return max(self.groups, key=lambda group: group.error.rms)


@dataclass(frozen=True, eq=False)
class HeldOutResidual:
    """Held-out residual (N, 3) in m with the blocks of its cross-validation, or the error that prevents it.

    `deployed`: held-out error of the model as it is deployed.
    """

    residual: Array | None
    reason: str = ""
    blocks: tuple[HeldOutBlock, ...] = ()
    deployed: DeployedError | None = None

    @classmethod
    def of(
        cls, model: Model, data: Measurements, blocks: tuple[HeldOutBlock, ...], loss: Loss, prior: Prior | None
    ) -> HeldOutResidual:
        """The held-out residual of a model that was cross-validated on these data, with a loss and a prior."""
        later = forecast_error(model, data, loss, prior)
        deployed = DeployedError.of(model, data.poses, blocks, later)
        return HeldOutResidual(held_out_residual(blocks), blocks=blocks, deployed=deployed)

    def __repr__(self) -> str:
        error = self.error
        words = self.reason if error is None else f"{in_mm(error.mean)} mm mean, {in_mm(error.rms)} mm RMS"
        return f"<{type(self).__name__}: {words}>"

    @property
    def unseen(self) -> bool:
        """Whether the model's own error is a held-out one: it was fitted to none of these poses."""
        return self.residual is None and bool(self.blocks)

    @property
    def error(self) -> ErrorStats | None:
        """Error statistics of the held-out residual; None without one."""
        return None if self.residual is None else error_stats(self.residual, held_out_turns(self.blocks))


@dataclass(frozen=True, eq=False, repr=False)
class NestedResidual(HeldOutResidual):
    """Held-out residual of a nested cross-validation; `chosen`: effects that each fold selected, in order."""

    chosen: tuple[tuple[str, ...], ...] = ()

    @property
    def frequency(self) -> dict[str, int]:
        """Selection frequency (Meinshausen & Bühlmann 2010): number of folds that chose each effect, most first."""
        return dict(Counter(chain.from_iterable(map(dict.fromkeys, self.chosen))).most_common())


@dataclass(frozen=True, eq=False)
class ModelComparison(ShownInNotebook):
    """A model against measurements.

    Attributes:
        residual: (N, 3), measured − predicted TCP (m).
        predictable: part of the residual that a Gaussian process predicts; None without a held-out error.
        factors: by decreasing share. worst: rows by decreasing error.
        speaks: (N,), where the data determine the model's residual field; None without one, or without its covariance.
    """

    data: Measurements
    equilibrium: Equilibrium
    residual: Array
    nominal: ErrorStats
    error: ErrorStats
    held_out: HeldOutResidual
    predictable: PredictableError | None
    factors: tuple[Factor, ...]
    worst: tuple[int, ...]
    speaks: NDArray[np.bool_] | None = None

    def __repr__(self) -> str:
        held_out = f", {in_mm(self.held_out.error.rms)} mm held out" if self.held_out.error else ""
        arm = self.equilibrium.model.arm.name
        return f"<Comparison of {arm} with {len(self.data)} poses: {in_mm(self.error.rms)} mm RMS{held_out}>"


def compare(
    model: Model,
    data: Measurements,
    progress: OnProgress = silent,
    prior: Prior | None = None,
    loss: Loss = SQUARED,
) -> ModelComparison:
    """Compares a model, as it is, with measurements; held out, its free parameters are refitted in every fold.

    Raises `NoEquilibrium`: the model has no equilibrium at some pose.
    """
    held_out = try_held_out(model, data, loss=loss, progress=progress, prior=prior)
    return _compared(model, data, held_out)


def compare_unseen(model: Model, data: Measurements, progress: OnProgress = silent) -> ModelComparison:
    """Compares a model with measurements that no fit of it saw: nothing is refitted. Raises `NoEquilibrium`."""
    as_it_is = try_held_out(replace(model, free=()), data, progress=progress)
    return _compared(model, data, HeldOutResidual(None, blocks=as_it_is.blocks, deployed=as_it_is.deployed))


def _compared(model: Model, data: Measurements, held_out: HeldOutResidual) -> ModelComparison:
    """Comparison of a model as it is, with a known held-out residual."""
    equilibrium = solve_equilibrium(model, data.poses)
    residual = data.position_error(equilibrium)
    nominal = solve_equilibrium(nominal_arm(model.arm, data), data.poses)
    distance = np.linalg.norm(residual, axis=1)
    return ModelComparison(
        data=data,
        equilibrium=equilibrium,
        residual=residual,
        nominal=data.errors(nominal),
        error=data.errors(equilibrium),
        held_out=held_out,
        predictable=predictable_error(data, held_out.blocks) if held_out.blocks else None,
        factors=tuple(sorted(_factors(equilibrium, data, residual), key=lambda factor: -factor.share)),
        worst=tuple(np.argsort(-distance)[:WORST].tolist()),
    )


def try_held_out(
    model: Model,
    data: Measurements,
    bounds: Bounds | None = None,
    loss: Loss = SQUARED,
    progress: OnProgress = silent,
    prior: Prior | None = None,
) -> HeldOutResidual:
    """Held-out residual (arguments as of `held_out_blocks`), or the `LrmError` because of which there is none."""
    try:
        blocks = held_out_blocks(model, data, bounds, loss, progress, prior=prior)
    except LrmError as error:
        return HeldOutResidual(None, str(error))
    return HeldOutResidual.of(model, data, blocks, loss, prior)


def _factors(equilibrium: Equilibrium, data: Measurements, residual: Array) -> Iterator[Factor]:
    """Factors by angle and torque of every joint, load, order of measurement and region of the workspace."""
    J = joint_jacobian(equilibrium)
    torque = equilibrium.joint_torque
    for i in range(equilibrium.model.arm.dof):
        column = J[:, :, i]
        quantiles = np.unique(np.quantile(torque[:, i], np.linspace(0.0, 1.0, BINS + 1)))
        by_angle, by_torque = _by_value(np.degrees(data.poses.q[:, i]), "°"), _cut(torque[:, i], quantiles, " N·m")
        yield _factor(ExplanatoryVariable("angle", i), *by_angle, residual, column)
        yield _factor(ExplanatoryVariable("torque", i), *by_torque, residual, column)
    if np.ptp(data.poses.payload) > 0:
        yield _factor(ExplanatoryVariable("load"), *_by_value(data.poses.payload * 1e3, " g"), residual)
    yield _factor(ExplanatoryVariable("order"), *_by_order(data), residual)
    yield _factor(ExplanatoryVariable("region"), *_by_octant(data.places(equilibrium)), residual)


def _factor(
    variable: ExplanatoryVariable,
    group: NDArray[np.int64],
    labels: Sequence[str],
    residual: Array,
    column: Array | None = None,
) -> Factor:
    """The factor of a grouping; `group`: (N,), number of each pose's label; `column`: (N, 3), of the joint (m/rad)."""
    groups, explained = [], 0.0
    for number, label in enumerate(labels):
        chosen = group == number
        if chosen.any():
            bias = residual[chosen].mean(axis=0)
            explained += float(chosen.sum() * (bias**2).sum())
            rotation = None if column is None else _equivalent_rotation(residual[chosen], column[chosen])
            x, y, z = bias.tolist()
            groups.append(PoseGroup(label, int(chosen.sum()), error_stats(residual[chosen]), (x, y, z), rotation))
    return Factor(variable, _adjusted_r2(explained, residual, len(groups)), tuple(groups))


def _adjusted_r2(explained: float, residual: Array, groups: int) -> float:
    """Adjusted R² of group means, from their sum of squares about zero (m²)."""
    n, total = len(residual), float((residual**2).sum())
    around_mean = total - n * float((residual.mean(axis=0) ** 2).sum())
    if n <= groups or around_mean <= 0.0:
        return 0.0
    between = explained - (total - around_mean)
    return max(1.0 - (1.0 - between / around_mean) * (n - 1) / (n - groups), 0.0)


def _equivalent_rotation(residual: Array, column: Array) -> float:
    """Rotation (rad) of a joint with Jacobian columns (N, 3) that fits the residuals (N, 3) best (least squares)."""
    length = float((column**2).sum())
    return float((residual * column).sum() / length) if length > 0 else 0.0


def _by_value(values: Array, unit: str) -> tuple[NDArray[np.int64], list[str]]:
    """Groups of equal values where these are few, else bins of equal width."""
    distinct, group = levels(values, 3)
    if len(distinct) <= MAX_LEVELS:
        return group, [f"{level:g}{unit}" for level in distinct]
    return _cut(values, np.linspace(values.min(), values.max(), BINS + 1), unit)


def _cut(values: Array, edges: Array, unit: str) -> tuple[NDArray[np.int64], list[str]]:
    """Groups between ascending edges."""
    if len(edges) < 2:
        return np.zeros(len(values), dtype=np.int64), [f"{values[0]:.3g}{unit}"]
    group = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    return group, [f"{low:.3g} to {high:.3g}{unit}" for low, high in pairwise(edges)]


def _by_order(data: Measurements) -> tuple[NDArray[np.int64], list[str]]:
    """Groups of successive poses."""
    parts = np.array_split(np.arange(len(data)), min(ORDER_PARTS, len(data)))
    group = np.concatenate([np.full(len(part), number) for number, part in enumerate(parts)])
    return group, [f"poses {data.pose[part[0]]} to {data.pose[part[-1]]}" for part in parts]


def _by_octant(tcp: Array) -> tuple[NDArray[np.int64], list[str]]:
    """Groups by octant about the median of positions (N, 3) in m."""
    middle = np.median(tcp, axis=0)
    group = ((tcp > middle) * [1, 2, 4]).sum(axis=1)
    labels = [
        ", ".join(f"{axis} {'>' if octant >> i & 1 else '<'} {middle[i] * 1e3:.0f} mm" for i, axis in enumerate("xyz"))
        for octant in range(8)
    ]
    return group, labels
