"""Which parameters the data can tell, and what those it cannot tell are made of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lrm_ident.data.measurements import Measurements
from lrm_ident.fit.levenberg_marquardt import Bounds, Fit, bounds_of, check_enough, fit
from lrm_ident.fit.loss import Loss
from lrm_math.arrays import Array
from lrm_math.model.derivatives import parameter_jacobian
from lrm_math.model.equilibrium import Equilibrium, equilibrium
from lrm_math.model.model import Model

ROUND_OFF = 1e-7  # a column is numerically dependent when no more than this part of it is left
CLEARLY = 3.0  # standard errors that must fit into the typical size of a parameter worth fitting
NEGLIGIBLE = 0.05  # part of a combination too small to be worth a word
MOST_ROUNDS = 6


@dataclass(frozen=True)
class Unidentifiable:
    """A parameter held at zero because the data cannot tell it from others.

    Attributes:
        survival: part of its effect on the TCP (0 to 1) that no combination of the kept ones reproduces.
        combination: (key, amount): what the kept parameters would have to change by, in their own file units, to move
            the TCP as one file unit of this parameter does.
        standard_error: of this parameter if it were fitted too (SI), infinite if it cannot be told at all.
    """

    key: str
    survival: float
    combination: tuple[tuple[str, float], ...]
    standard_error: float


@dataclass(frozen=True)
class Identifiable:
    """The parameters to fit, and those to hold."""

    kept: tuple[str, ...]
    held: tuple[Unidentifiable, ...]


def preference(model: Model, keys: Sequence[str]) -> list[str]:
    """The order in which parameters are taken in; of two that look alike the earlier one is kept.

    What matters most on such an arm comes first: compliances, the angles that servos are mounted at, where the base
    and the tool stand; then lengths and twists, each from the base outwards; then the parameters of further effects.
    """

    def rank(key: str) -> int:
        """Place in the order, lowest first."""
        effect, place, name = key.split(".")
        match effect, place, name:
            case "compliance", _, _:
                return 0
            case "offsets", _, "theta_rad":
                return 1
            case "offsets", "base", "x_mm" | "y_mm" | "z_mm":
                return 2
            case "offsets", "tool", "x_mm" | "y_mm" | "z_mm":
                return 3
            case "offsets", _, "extra_z_mm" | "a_mm" | "d_mm":
                return 4
            case "offsets", "tool", _:
                return 7
            case "offsets", "base", _:
                return 6
            case "offsets", _, _:
                return 5
        return 8

    return sorted(keys, key=lambda key: (rank(key), model.position(key)))


def identifiable(rest: Equilibrium, keys: Sequence[str], noise: float, sd: Array | None = None) -> Identifiable:
    """Sorts parameters into those that these poses can tell and those they cannot.

    Taken in by preference, a parameter is kept if the part of its column that is new would fix it to a third of its
    typical size or better at this noise: else what is known beforehand (about zero) is hardly improved by the data.

    Args:
        rest: equilibrium at the poses, at the parameters to linearise about.
        noise: m per axis, what the fit is expected to leave.
        sd: (N,), relative weights of the poses as in `Measurements.sd`, or None.
    """
    model = rest.model
    order = preference(model, keys)
    typical = np.array([model.parameters[model.position(key)].typical for key in order])
    columns = (parameter_jacobian(rest, order) * typical * _weights(sd)).reshape(-1, len(order))
    basis = np.empty((columns.shape[0], 0))
    kept: list[int] = []
    dropped: list[tuple[int, float]] = []
    for j in range(len(order)):
        whole = float(np.linalg.norm(columns[:, j]))
        left = columns[:, j] - basis @ (basis.T @ columns[:, j])
        left -= basis @ (basis.T @ left)
        remains = float(np.linalg.norm(left))
        if remains > max(CLEARLY * noise, ROUND_OFF * whole):
            kept.append(j)
            basis = np.column_stack([basis, left / remains])
        else:
            dropped.append((j, remains))
    held = [describe(columns, typical, order, model, kept, j, remains, noise) for j, remains in dropped]
    chosen = {order[j] for j in kept}
    return Identifiable(tuple(key for key in model.keys if key in chosen), tuple(held))


def expected_noise(rest: Equilibrium, keys: Sequence[str], tcp: Array, sd: Array | None = None) -> float:
    """What a fit of `keys` would leave per axis (m), by one linear least-squares step from `rest`.

    Args:
        tcp: (N, 3), measured (m).
    """
    weights = _weights(sd)
    typical = np.array([rest.model.parameters[rest.model.position(key)].typical for key in keys])
    columns = (parameter_jacobian(rest, keys) * typical * weights).reshape(-1, len(keys))
    residual = ((tcp - rest.tcp)[:, :, None] * weights).reshape(-1)
    step, _, rank, _ = np.linalg.lstsq(columns, residual, rcond=ROUND_OFF)
    left = residual - columns @ step
    return float(np.sqrt(left @ left / max(len(left) - int(rank), 1)))


def _weights(sd: Array | None) -> Array:
    """Relative weight of each pose, (N, 1, 1), of mean square one in 1/sd's own sense; one where no sd is known."""
    return np.ones((1, 1, 1)) if sd is None else (np.sqrt(np.mean(sd**2)) / sd)[:, None, None]


def describe(
    columns: Array,
    typical: Array,
    order: Sequence[str],
    model: Model,
    kept: Sequence[int],
    j: int,
    remains: float,
    noise: float,
) -> Unidentifiable:
    """Why the data cannot tell parameter `j` from the kept ones: the combination that moves the tip as it does."""
    whole = float(np.linalg.norm(columns[:, j]))
    units = np.array([model.parameters[model.position(key)].si for key in order])
    share, *_ = np.linalg.lstsq(columns[:, kept], columns[:, j], rcond=None)
    size = np.abs(share) * np.linalg.norm(columns[:, kept], axis=0)
    parts = [
        (order[k], float(amount * typical[k] / typical[j] * units[j] / units[k]))
        for k, amount, matters in sorted(zip(kept, share, size, strict=True), key=lambda part: -part[2])
        if matters > NEGLIGIBLE * whole
    ]
    survival = remains / whole if whole > 0 else 0.0
    error = noise / remains * typical[j] if survival > ROUND_OFF else np.inf
    return Unidentifiable(order[j], survival, tuple(parts), float(error))


@dataclass(frozen=True, eq=False)
class IdentifiedFit:
    """A fit of the identifiable part of a model, and what was held."""

    fit: Fit
    held: tuple[Unidentifiable, ...]


def fit_identifiable(
    model: Model, data: Measurements, keys: Sequence[str], loss: Loss | None = None, signed: Bounds | None = None
) -> IdentifiedFit:
    """Fits whatever part of `keys` the data can tell; the rest is held at zero.

    Which part that is depends on the noise that the fit leaves and on where it ends, so both are repeated until the
    choice stays. Parameters held are zero in the result.

    Args:
        signed: bounds of all `keys`; the physical ones if None.

    Raises:
        LrmError: fewer poses than parameters that could be told, or no convergence.
    """
    limits = signed or bounds_of(model, keys)
    by_key = {key: (low, high) for key, low, high in zip(keys, limits.lower, limits.upper, strict=True)}
    rest = equilibrium(model, data.poses)
    noise = expected_noise(rest, keys, data.tcp, data.sd)
    seen: list[tuple[str, ...]] = []
    for _ in range(MOST_ROUNDS):
        choice = identifiable(rest, keys, noise, data.sd)
        check_enough(len(data), len(choice.kept))
        start = _holding(rest.model, keys, choice.kept)
        low, high = np.array([by_key[key] for key in choice.kept]).reshape(-1, 2).T
        result = fit(start, data, Bounds(low, high), loss)
        if choice.kept in seen:
            break
        seen.append(choice.kept)
        rest, noise = result.rest, result.sigma
    return IdentifiedFit(result, choice.held)


def _holding(model: Model, keys: Sequence[str], kept: Sequence[str]) -> Model:
    """The model with `kept` free and the others of `keys` at zero."""
    values = model.values.copy()
    for key in set(keys) - set(kept):
        values[model.position(key)] = 0.0
    return replace(model.with_values(values), free=tuple(kept))
