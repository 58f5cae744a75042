"""Penalties that keep free forms smooth and small, their weights by the marginal likelihood.

A form has a penalty on the second differences of its curves' coefficients (P-splines, Eilers & Marx 1996) and one
on the size of all of them (ridge regression). Both enter the least squares as a Gaussian prior. They begin at the
effect's typical size; their weights are then those that make the measurements most probable (Wood & Fasiolo 2017), so
that a form of which the data show nothing is drawn to zero, and nothing is tuned.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lrm_ident.fitting.priors import Prior
from lrm_math.arrays import Array
from lrm_math.effects import Effect
from lrm_math.model.model import Model

MOST_UPDATES = 8
FIRST_MOST = 100.0
LEAST, MOST = 0.1, 1e6
"""Range of a weight, one at typical size: beyond it a form is unlike anything, or nothing."""
SETTLED = 0.3
"""Change of the logarithm of a weight that no longer matters."""


@dataclass(frozen=True, eq=False)
class Penalty:
    """½ w θᵀ S θ of the free coefficients `keys` (K), S (K, K) in SI; its weight w is one at typical size."""

    keys: tuple[str, ...]
    S: Array


def penalties(model: Model) -> tuple[Penalty, ...]:
    """Those of the model's free forms."""
    return tuple(penalty for effect in model.effects if effect.variant_of for penalty in _of_form(effect, model.free))


def _of_form(effect: Effect, free: Sequence[str]) -> list[Penalty]:
    names = [p.name for p in effect.parameters]
    known = [row for row, key in enumerate(effect.keys) if key in free]
    if not known:
        return []
    sizes, keys = np.array([effect.parameters[row].typical for row in known]), tuple(effect.keys[row] for row in known)
    place = {names[row]: at for at, row in enumerate(known)}
    found = [Penalty(keys, np.diag(sizes**-2.0))]
    triples = [three for curve in effect.curves for three in zip(curve, curve[1:], curve[2:], strict=False)]
    bend = np.zeros((len(triples), len(known)))
    for row, three in zip(bend, triples, strict=True):
        if all(name in place for name in three):
            row[[place[name] for name in three]] = 1.0, -2.0, 1.0
    if bend.any():
        bend /= sizes
        found.append(Penalty(keys, bend.T @ bend))
    return found


def with_penalties(prior: Prior | None, known: Sequence[Penalty], weights: Array) -> Prior | None:
    """The product of a prior, if there is one, and of weighted penalties."""
    if not known:
        return prior
    own = () if prior is None else prior.keys
    keys = tuple(dict.fromkeys((*own, *(key for penalty in known for key in penalty.keys))))
    precision, along = _weighted(keys, known, weights), np.zeros(len(keys))
    if prior is not None:
        rows, inverse = [keys.index(key) for key in own], np.linalg.inv(prior.covariance)
        precision[np.ix_(rows, rows)] += inverse
        along[rows] += inverse @ prior.mean
    covariance = np.asarray(np.linalg.inv(precision))
    return Prior("smooth" if prior is None else prior.name, keys, covariance @ along, covariance)


@dataclass(frozen=True, eq=False)
class Smoothness:
    """Penalties of a model's forms with their `weights`, each one at typical size at first, beside a `stated` prior.

    updates: how often the weights have been estimated.
    """

    known: tuple[Penalty, ...]
    weights: Array
    stated: Prior | None
    updates: int = 0

    @property
    def begun(self) -> bool:
        """Whether coefficients of an earlier fit say something of the weights."""
        return bool((self.weights != 1.0).any())

    @staticmethod
    def of(model: Model, stated: Prior | None) -> Smoothness:
        """Before any fit, or as the coefficients of an earlier one show."""
        known = penalties(model)
        return Smoothness(known, np.array([first_weight(penalty, model) for penalty in known]), stated)

    @property
    def prior(self) -> Prior | None:
        """The product of the stated prior and the penalties; None without either."""
        return with_penalties(self.stated, self.known, self.weights)

    def likelier(self, model: Model, covariance: Array) -> Smoothness:
        """Smoothness with the next weights towards the largest marginal likelihood, until estimated often enough.

        Arguments as `likelier_weights`'.
        """
        if not self.known or self.updates == MOST_UPDATES:
            return self
        weights = likelier_weights(self.known, self.weights, model, covariance)
        return replace(self, weights=weights, updates=self.updates + 1)

    def close_to(self, other: Smoothness) -> bool:
        """Whether no weight differs by enough to matter."""
        return bool((np.abs(np.log(self.weights / other.weights)) < SETTLED).all())


def first_weight(penalty: Penalty, model: Model) -> float:
    """The likeliest weight of coefficients that were known exactly, or 1 where these say nothing yet."""
    theta = np.array([model.value(key) for key in penalty.keys])
    size = float(theta @ penalty.S @ theta)
    return float(np.clip(np.linalg.matrix_rank(penalty.S) / size, LEAST, FIRST_MOST)) if size > 0.0 else 1.0


def likelier_weights(known: Sequence[Penalty], weights: Array, model: Model, covariance: Array) -> Array:
    """The next weights towards the maximum of the marginal likelihood: the generalised method of Fellner and Schall.

    Args:
        model: fitted with the present `weights`. covariance: (P, P), posterior one of its free parameters (SI).
    """
    keys = tuple(dict.fromkeys(key for penalty in known for key in penalty.keys))
    spread = np.asarray(np.linalg.inv(_weighted(keys, known, weights)))
    out = np.empty(len(known))
    for j, penalty in enumerate(known):
        rows, free = ([where.index(key) for key in penalty.keys] for where in (keys, model.free))
        theta = np.array([model.value(key) for key in penalty.keys])
        gained = _trace(spread, rows, penalty.S) - _trace(covariance, free, penalty.S)
        size = float(theta @ penalty.S @ theta)
        out[j] = weights[j] * (gained / size if gained > 0.0 < size else 1.0)
    return np.asarray(np.clip(out, LEAST, MOST))


def _trace(covariance: Array, rows: Sequence[int], S: Array) -> float:
    return float((covariance[np.ix_(rows, rows)] * S).sum())


def _weighted(keys: Sequence[str], known: Sequence[Penalty], weights: Array) -> NDArray[np.float64]:
    precision = np.zeros((len(keys), len(keys)))
    for penalty, weight in zip(known, weights, strict=True):
        rows = [keys.index(key) for key in penalty.keys]
        precision[np.ix_(rows, rows)] += weight * penalty.S
    return precision
