"""The identification Jacobian, its singular values, and the observability indices O1 to O5 of a set of poses."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.weights.whitening import PLAIN, Whitening
from lrm_math.arrays import Array
from lrm_math.effects import Parameter
from lrm_math.model.equilibrium import Equilibrium

Units = Literal["thesis", "scaled"]
Index = Literal["O1", "O2", "O3", "O4", "O5"]
UNITS: tuple[Units, ...] = ("thesis", "scaled")
INDICES: tuple[Index, ...] = ("O1", "O2", "O3", "O4", "O5")
MM_PER_M = 1e3


def unit_of(parameter: Parameter, units: Units) -> float:
    """One unit of a parameter in SI: its typical size, or the thesis's unit (mm, rad, N·mm; section 4.5)."""
    if units == "scaled":
        return parameter.typical
    above, _, below = parameter.unit.partition("_per_")
    return _thesis_unit(above) / (_thesis_unit(below) if below else 1.0)


def _thesis_unit(word: str) -> float:
    """The thesis's unit in SI: mm, N·mm and g instead of m, N·m and kg, to the power behind the unit."""
    power = int(word[-1]) if word[-1].isdigit() else 1
    return float({"mm": 1e-3, "Nm": 1e-3, "g": 1e-3}.get(word.rstrip("0123456789"), 1.0) ** power)


def identification_jacobian(
    settled: Equilibrium, keys: Sequence[str], units: Units = "scaled", whitening: Whitening = PLAIN
) -> Array:
    """(N, 3, P), motion of the TCP (mm) for one unit of each parameter, through the equilibrium (thesis Eq 4.1).

    (N, R, P) of all that is measured where `whitening` says so, each number weighted by its noise: as if it were a
    position with the mean noise.

    Args:
        units: "thesis" for mm/rad, mm/mm and mm/(rad/N·mm), "scaled" for mm per typical size of the parameter.
    """
    chosen = [settled.model.parameter(key) for key in keys]
    per_unit = np.array([unit_of(p, units) for p in chosen]) * MM_PER_M
    return np.asarray(whitening.unit * whitening.jacobian(settled, keys) * per_unit)


def singular_values(jacobian: Array) -> Array:
    """(min(3 N, P),), descending, of all poses of a Jacobian (N, 3, P) stacked."""
    return np.asarray(np.linalg.svd(jacobian.reshape(-1, jacobian.shape[2]), compute_uv=False))


@dataclass(frozen=True)
class Observability:
    """The five indices of Sun & Hollerbach 2008 and Joubair & Bonev 2013; the larger the better.

    With σ1 ≥ … ≥ σm of n stacked poses: O1 = (σ1 … σm)^(1/m) / √n, O2 = σm/σ1, O3 = σm, O4 = σm²/σ1, O5 = 1/Σ(1/σi).
    (The thesis prints O1 again as O3, and three of the terms of O5, Eqs 2.52 and 2.54.)
    """

    O1: float
    O2: float
    O3: float
    O4: float
    O5: float

    def value(self, index: Index) -> float:
        """One of the five indices."""
        return float(getattr(self, index))

    @classmethod
    def median(cls, jacobian: Array, draws: Iterable[NDArray[np.int64]]) -> Observability:
        """Medians of the indices over sets of rows of a Jacobian (N, 3, m)."""
        indices = [list(vars(observability(jacobian[rows])).values()) for rows in draws]
        return cls(*np.median(indices, axis=0).tolist())


def observability(jacobian: Array) -> Observability:
    """All five indices of a Jacobian (n, R, m); zero where the Jacobian is rank deficient."""
    n, rows, m = jacobian.shape
    sigma = singular_values(jacobian)
    sigma[sigma <= np.finfo(np.float64).eps * rows * n * sigma[0]] = 0.0
    if rows * n < m:
        return Observability(0.0, 0.0, 0.0, 0.0, 0.0)
    return Observability(*(float(observability_index(sigma**2, name, n)) for name in INDICES))


def observability_index(eigenvalues: NDArray[np.floating], index: Index, n: int) -> Array:
    """One index from the eigenvalues σ² (…, m) of the information matrix JᵀJ of n poses; (…,)."""
    sigma = np.sqrt(np.maximum(eigenvalues, 0.0))
    least, most = sigma.min(axis=-1), sigma.max(axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        match index:
            case "O1":
                value = np.exp(np.log(sigma).mean(axis=-1)) / np.sqrt(n)
            case "O2":
                value = least / most
            case "O3":
                value = least
            case "O4":
                value = least**2 / most
            case "O5":
                value = 1.0 / (1.0 / sigma).sum(axis=-1)
    return np.asarray(np.nan_to_num(value, nan=0.0))
