"""Covariance of a model's parameters: the table `[covariance]` of a model file; estimates that are not plausible."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from lrm_math.model.model import Model
from lrm_math.toml_file import StrictSchema

DIGITS = 9  # of a correlation in the file
IN_DEGREES = {"rad": (math.degrees(1.0), "deg"), "rad_per_K": (math.degrees(1.0), "deg/K")}
"""Units in which people are told an angle: what to multiply an SI value by, and the unit."""
ROUNDING = 1e-6  # negative eigenvalues of the correlation matrix above −1e-6 are due to rounding


class CovarianceTable(StrictSchema):
    """Table `[covariance]`; the standard errors are in `[sigma]`.

    `keys`: its parameters, in the order of the model. `correlation`: the upper triangle of their
    correlation matrix without its diagonal, row by row: 1-2, 1-3, … 1-P, 2-3, …
    """

    keys: list[str]
    correlation: list[float]


class Covariance(NamedTuple):
    """Covariance `matrix` (P, P) of the parameters `keys` (P,), SI. Parameters not in it are taken as exact."""

    keys: tuple[str, ...]
    matrix: Array

    def marginal(self, model: Model, part: Model) -> Covariance:
        """Covariance of the parameters of a part of the model, the others marginalised. Raises `UnknownName`."""
        for key in self.keys:
            model.position(key)
        rows = [i for i, key in enumerate(self.keys) if key in part.keys]
        return Covariance(tuple(self.keys[i] for i in rows), self.matrix[np.ix_(rows, rows)])


def drawn_models(model: Model, covariance: Covariance, count: int, rng: np.random.Generator) -> list[Model]:
    """Models with parameters drawn from their normal distribution; those with a lower bound stop there."""
    rows = [model.position(key) for key in covariance.keys]
    least = np.array([model.parameters[row].lower for row in rows])
    drawn = rng.multivariate_normal(model.values[rows], covariance.matrix, count, method="eigh")
    return [model.with_values_of(covariance.keys, np.maximum(sample, least)) for sample in drawn]


@dataclass(frozen=True)
class ImplausibleEstimate:
    """An estimate beyond what is physically plausible, in the unit of its key; `usual`: what real arms stay below."""

    key: str
    value: float
    usual: float
    unit: str

    @property
    def sentence(self) -> str:
        """One line for a person."""
        size = f"{self.value:.3g} {self.unit}"
        return f"{self.key} = {size} is not physically plausible; usual is less than {self.usual:.2g} {self.unit}"


def implausible_estimates(model: Model, covariance: Covariance | None) -> tuple[ImplausibleEstimate, ...]:
    """The free parameters of a model whose estimates are surely beyond `Parameter.largest`, by two standard errors.

    Free forms and fields are exempt: their coefficients are no physical sizes, and are never called a cause.
    `covariance`: the covariance (SI); None: not known, and taken for zero.
    """
    errors = (
        {}
        if covariance is None
        else dict(zip(covariance.keys, np.sqrt(np.diag(covariance.matrix)).tolist(), strict=True))
    )
    implausible = []
    exempt = {key for effect in model.effects if effect.is_free_form or not effect.names_a_cause for key in effect.keys}
    for key in (key for key in model.free if key not in exempt):
        parameter, value = model.parameter(key), model.value(key)
        sizes = parameter.plausible
        if not sizes.admits(value, errors.get(key, 0.0)):
            scale, unit = IN_DEGREES.get(parameter.unit, (1.0 / parameter.si, parameter.unit.replace("_per_", "/")))
            implausible.append(ImplausibleEstimate(key, value * scale, sizes.usual * scale, unit))
    return tuple(implausible)


def covariance_table(keys: Sequence[str], matrix: Array) -> CovarianceTable:
    """The table of a covariance matrix (P, P) with positive diagonal; any units."""
    error = np.sqrt(np.diag(matrix))
    correlation = matrix / np.outer(error, error)
    upper = np.clip(correlation[np.triu_indices(len(keys), 1)], -1.0, 1.0)
    return CovarianceTable(keys=list(keys), correlation=np.round(upper, DIGITS).tolist())


def to_covariance(table: CovarianceTable, sigma: Mapping[str, float], model: Model) -> Covariance:
    """The covariance (SI) of a table and its standard errors (file units).

    Raises:
        UnknownName: a key that the model does not have.
        LrmError: keys given twice or without standard error, a wrong number of correlations, or a correlation matrix
            that is not positive semidefinite.
    """
    units = np.array([model.parameter(key).si for key in table.keys])
    without = [key for key in table.keys if not sigma.get(key, -1.0) >= 0.0]
    if without:
        raise LrmError(f"{without[0]} has no standard error in [sigma]")
    error = units * np.array([sigma[key] for key in table.keys])
    return Covariance(tuple(table.keys), correlation_matrix(table) * np.outer(error, error))


def correlation_matrix(table: CovarianceTable) -> Array:
    """(P, P), the whole correlation matrix of a table.

    Raises `LrmError`: keys given twice, a wrong number of correlations, or a matrix that is not positive semidefinite.
    """
    size = len(table.keys)
    if len(set(table.keys)) < size:
        raise LrmError("a key stands twice in keys")
    if len(table.correlation) != size * (size - 1) // 2:
        raise LrmError(
            f"{len(table.correlation)} correlations for {size} keys; should be {size * (size - 1) // 2}, the upper "
            "triangle without its diagonal"
        )
    correlation = np.eye(size)
    correlation[np.triu_indices(size, 1)] = table.correlation
    correlation = np.triu(correlation, 1).T + correlation
    if size and (np.abs(correlation).max() > 1.0 or np.linalg.eigvalsh(correlation)[0] < -ROUNDING):
        raise LrmError("the correlations contradict each other: some combination of parameters has a negative variance")
    return correlation
