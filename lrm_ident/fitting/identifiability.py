"""Identifiability: which parameters a data set determines, and which combinations the others are confounded with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.measurements import Measurements
from lrm_ident.data.registration.row_choice import drawn_rows
from lrm_ident.data.weights.whitening import PLAIN, Whitening
from lrm_ident.fitting.dependence import ROUND_OFF, UnidentifiableParameter, explain_dependence
from lrm_ident.fitting.least_squares.block_qr import compress
from lrm_ident.fitting.levenberg_marquardt import Fit, fit
from lrm_ident.fitting.loss import SQUARED, Loss
from lrm_ident.fitting.parameter_sets import Bounds, bounds_of, check_distinct_poses
from lrm_ident.fitting.typical_prior import typical_prior
from lrm_math.arrays import Array
from lrm_math.kinematics.forward import chain_geometry
from lrm_math.model.equilibrium import Equilibrium
from lrm_math.model.model import Model

MIN_T = 3.0  # ratio of typical size to standard error of a parameter worth fitting
FEW_OUTLIERS = 0.2  # share of the poses
MAX_SUBSAMPLE = 2000  # poses that are screened, or fitted without a start from the fit to a subsample
SELECTION_ORDER = (
    *("anchor.*", "touched_*", "compliance.*", "offsets.*.theta_rad", "offsets.base.?_mm", "offsets.tool.?_mm"),
    *("offsets.[jm]*_mm", "offsets.[jm]*", "offsets.base.*", "offsets.tool.*", "*"),  # of joints and mimics
)
AFTER_TOOL = "offsets.[jm]*_mm"  # the pattern that follows the tool's position
SHORT_LEVER = 0.05
"""m: closer to an axis, a tool offset of typical size (5 mm) equals a turn of more than 0.1 rad, too large for a zero
offset and for the linearisation of the fit."""


@dataclass(frozen=True, eq=False)
class IdentifiableSet:
    """Selection of the parameters to fit; the others are held at zero.

    Attributes:
        columns: (M, P), compressed Jacobian of the candidates in the `order` of selection.
        chosen: numbers of the columns that are kept. dropped: the others, with the norm of their independent part (m).
        noise: m per axis.
    """

    model: Model
    order: tuple[str, ...]
    columns: Array
    chosen: tuple[int, ...]
    dropped: tuple[tuple[int, float], ...]
    noise: float

    @cached_property
    def kept(self) -> tuple[str, ...]:
        """Keys to fit, in the model's order."""
        chosen = {self.order[j] for j in self.chosen}
        return tuple(key for key in self.model.keys if key in chosen)

    @cached_property
    def held(self) -> tuple[UnidentifiableParameter, ...]:
        """The parameters to hold at zero, and the combinations of others that they equal."""
        model, order, noise = self.model, self.order, self.noise
        typical = np.array([model.parameter(key).typical for key in order])
        return tuple(
            explain_dependence(self.columns, typical, order, model, self.chosen, j, independent, noise)
            for j, independent in self.dropped
        )


def selection_order(model: Model, keys: Sequence[str]) -> list[str]:
    """Order in which parameters are selected; of two confounded ones the earlier is kept.

    First the anchor of measured distances; then what matters most on such an arm: compliances, joint zero offsets,
    positions of base and tool; then lengths and twists, each from the base outwards; then further effects.

    The last joint's zero offset moves the TCP as an offset of the tool does, divided by the TCP's distance from that
    axis. Close to the axis a small tool offset would need a large turn, so the tool's position comes first there.
    """
    late = f"offsets.{model.arm.link_places[-1]}.theta_rad" if _last_lever(model) < SHORT_LEVER else ""

    def rank(key: str) -> int:
        placed_as = AFTER_TOOL if key == late else key
        return next(i for i, pattern in enumerate(SELECTION_ORDER) if fnmatchcase(placed_as, pattern))

    return sorted(keys, key=lambda key: (rank(key), model.position(key)))


def _last_lever(model: Model) -> float:
    """Distance of the nominal TCP from the last joint's axis (m)."""
    stretched = chain_geometry(model.chain, model.chain.values([0.0] * model.arm.dof), 1)
    last = model.chain.index[f"{model.arm.link_places[-1]}.theta"]
    axis, to_tcp = stretched.axis[last, :, 0], stretched.tcp[:, 0] - stretched.origin[last, :, 0]
    return float(np.linalg.norm(np.cross(axis, to_tcp)))


def select_identifiable(
    equilibrium: Equilibrium, keys: Sequence[str], noise: float, whitening: Whitening = PLAIN
) -> IdentifiableSet:
    """Forward selection of parameters by Gram–Schmidt orthogonalisation of their Jacobian columns.

    A parameter is kept if at this noise the independent part of its column determines it to a third of its typical
    size or better; else the data hardly improve on the prior knowledge that it is near zero.

    Args:
        equilibrium: at the poses, for the parameters to linearise about.
        keys: candidates.
        noise: expected residual of the fit, m per axis.
        whitening: weights of what was, or will be, measured.
    """
    order = selection_order(equilibrium.model, keys)
    columns = _columns(equilibrium, order, whitening)
    kept, dropped = _gram_schmidt(columns, noise)
    return IdentifiableSet(equilibrium.model, tuple(order), columns, tuple(kept), tuple(dropped), noise)


def identifiable_beside(
    equilibrium: Equilibrium, free: Sequence[str], others: Sequence[str], noise: float, whitening: Whitening = PLAIN
) -> tuple[str, ...]:
    """Keys among `others` that are identifiable beside the parameters `free`, by the rule of `select_identifiable`."""
    order = [*free, *selection_order(equilibrium.model, others)]
    columns = _columns(equilibrium, order, whitening)
    kept, _ = _gram_schmidt(columns, noise, len(free))
    return tuple(order[j] for j in kept if j >= len(free))


def _gram_schmidt(columns: Array, noise: float, given: int = 0) -> tuple[list[int], list[tuple[int, float]]]:
    """Numbers of the columns kept: the first `given`, and those whose independent part exceeds the noise `MIN_T` times;
    numbers of the others, with the norm of that part (m)."""
    rows = np.empty_like(columns.T, order="C")  # orthonormal basis of the kept columns, one a row
    kept: list[int] = []
    dropped = []
    for j, column in enumerate(np.ascontiguousarray(columns.T)):
        basis = rows[: len(kept)]
        remainder = column - (basis @ column) @ basis
        remainder -= (basis @ remainder) @ basis  # again, against round-off
        independent = float(np.linalg.norm(remainder))
        if independent > max(0.0 if j < given else MIN_T * noise, ROUND_OFF * float(np.linalg.norm(column))):
            rows[len(kept)] = remainder / independent
            kept.append(j)
        else:
            dropped.append((j, independent))
    return kept, dropped


def expected_noise(equilibrium: Equilibrium, keys: Sequence[str], data: Measurements) -> float:
    """Residual standard deviation per axis (m) that a fit of `keys` would leave, by one Gauss–Newton step."""
    whitening = data.whitening
    residual = whitening(data.residual(equilibrium))
    rows = compress(equilibrium, keys, whitening, np.full((1, 1), whitening.unit), residual)
    step, _, rank, _ = np.linalg.lstsq(rows.columns, rows.residual, rcond=ROUND_OFF)
    remainder = rows.residual - rows.columns @ step
    return float(np.sqrt(remainder @ remainder / max(data.measured_rows - int(rank), 1)))


def _columns(equilibrium: Equilibrium, order: Sequence[str], whitening: Whitening) -> Array:
    """(M, P), compressed Jacobian of parameters of typical sizes, whitened to a noise of the whitening's unit (m)."""
    keys = sorted(order)
    return _sorted_columns(equilibrium, tuple(keys), whitening)[:, [keys.index(key) for key in order]]


@lru_cache(maxsize=1)  # what else can be told beside a fit is asked in two orders
def _sorted_columns(equilibrium: Equilibrium, keys: tuple[str, ...], whitening: Whitening) -> Array:
    """The same, of parameters in the order of their keys."""
    nothing = np.zeros((len(equilibrium.poses), whitening.rows(equilibrium.model.arm.dof)))
    return compress(equilibrium, keys, whitening, np.full((1, 1), whitening.unit), nothing).columns


@dataclass(frozen=True, eq=False)
class IdentifiedFit:
    """Fit of parameters; `data`: the measurements as they were weighed."""

    fit: Fit
    data: Measurements


def fit_identifiable(
    model: Model,
    data: Measurements,
    keys: Sequence[str],
    loss: Loss = SQUARED,
    bounds: Bounds | None = None,
    near: Fit | None = None,
) -> IdentifiedFit:
    """Fits the parameters `keys` together, with the prior of typical sizes.

    Of many poses a subsample is fitted first, as a start close to the optimum.

    Args:
        bounds: of all `keys`; None: the physical ones.
        near: a fit of the same effects to these data, or a part of them, to start from.

    Raises `LrmError`: fewer distinct poses than a third of the parameters, or no convergence.
    """
    limits = bounds or bounds_of(model, keys)
    chosen = [keys.index(key) for key in model.keys if key in keys]
    free = model.with_free([keys[row] for row in chosen])
    check_distinct_poses(model, data.poses, len(keys) // 3 + 1, len(keys))
    if len(data) > MAX_SUBSAMPLE and near is None:
        near = fit_identifiable(model, data.take(subsample_rows(len(data))), keys, loss, bounds).fit
    if near is not None:
        free = near.model.with_free(free.free)
    equilibrium = None if near is None or len(near.residual) != len(data) else near.equilibrium
    within = Bounds(limits.lower[chosen], limits.upper[chosen])
    return IdentifiedFit(fit(free, data, within, loss, typical_prior(free), equilibrium), data)


def subsample_rows(count: int) -> NDArray[np.int64]:
    """Rows, at most `MAX_SUBSAMPLE`, drawn from `count` without replacement, ascending, always the same."""
    return drawn_rows(count, MAX_SUBSAMPLE)
