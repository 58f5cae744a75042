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
"""Range of a weight, one at typical sizes: smaller ones leave a form free, larger ones leave nothing of it."""
SETTLED = 0.3
"""Change of the logarithm of a weight below which it has converged."""


@dataclass(frozen=True, eq=False)
class Penalty:
    """Quadratic penalty ½ w θᵀ S θ of K free coefficients `keys`: S (K, K), SI; its weight w is 1 at typical sizes."""

    keys: tuple[str, ...]
    S: Array


def penalties_of(model: Model) -> tuple[Penalty, ...]:
    """Penalties of the model's free forms, on roughness and on size."""
    return tuple(penalty for effect in model.effects if effect.is_free_form for penalty in _of_form(effect, model.free))


def _of_form(effect: Effect, free: Sequence[str]) -> list[Penalty]:
    """Penalty on the size of a form's free coefficients, and on the second differences along its curves."""
    names = [p.name for p in effect.parameters]
    free_rows = [row for row, key in enumerate(effect.keys) if key in free]
    if not free_rows:
        return []
    sizes, keys = (
        np.array([effect.parameters[row].typical for row in free_rows]),
        tuple(effect.keys[row] for row in free_rows),
    )
    place = {names[row]: at for at, row in enumerate(free_rows)}
    penalties = [Penalty(keys, np.diag(sizes**-2.0))]
    triples = [three for curve in effect.curves for three in zip(curve, curve[1:], curve[2:], strict=False)]
    second_differences = np.zeros((len(triples), len(free_rows)))
    for row, three in zip(second_differences, triples, strict=True):
        if all(name in place for name in three):
            row[[place[name] for name in three]] = 1.0, -2.0, 1.0
    if second_differences.any():
        second_differences /= sizes
        penalties.append(Penalty(keys, second_differences.T @ second_differences))
    return penalties


def with_penalties(prior: Prior | None, penalties: Sequence[Penalty], weights: Array) -> Prior | None:
    """The product of a prior, if there is one, and of the Gaussians of weighted penalties."""
    if not penalties:
        return prior
    stated_keys = () if prior is None else prior.keys
    keys = tuple(dict.fromkeys((*stated_keys, *(key for penalty in penalties for key in penalty.keys))))
    precision, along = _precision(keys, penalties, weights), np.zeros(len(keys))
    if prior is not None:
        rows, inverse = [keys.index(key) for key in stated_keys], np.linalg.inv(prior.covariance)
        precision[np.ix_(rows, rows)] += inverse
        along[rows] += inverse @ prior.mean
    covariance = np.asarray(np.linalg.inv(precision))
    return Prior("smooth" if prior is None else prior.name, keys, covariance @ along, covariance)


@dataclass(frozen=True, eq=False)
class Smoothness:
    """Penalties of a model's forms with their `weights` (one at typical sizes), beside a `stated` prior.

    `updates`: how often the weights have been estimated.
    """

    penalties: tuple[Penalty, ...]
    weights: Array
    stated: Prior | None
    updates: int = 0

    @property
    def warm_started(self) -> bool:
        """Whether the weights come from coefficients of an earlier fit."""
        return bool((self.weights != 1.0).any())

    @staticmethod
    def of(model: Model, stated: Prior | None) -> Smoothness:
        """Penalties with weights of one, or as the coefficients of an earlier fit suggest (`initial_weight`).

        None where the stated prior is of an earlier fit, which holds them already.
        """
        penalties = () if stated is not None and stated.noise is not None else penalties_of(model)
        return Smoothness(penalties, np.array([initial_weight(penalty, model) for penalty in penalties]), stated)

    @property
    def prior(self) -> Prior | None:
        """The product of the stated prior and the penalties; None without either."""
        return with_penalties(self.stated, self.penalties, self.weights)

    @property
    def adapts(self) -> bool:
        """Whether the prior follows the estimate: by the weights of penalties, or by its heavy tails."""
        return bool(self.penalties) or (self.stated is not None and self.stated.heavy_tailed)

    def updated(self, model: Model, covariance: Array) -> Smoothness:
        """Smoothness with weights one step closer to the largest marginal likelihood, and the stated prior reweighted;
        at most `MOST_UPDATES` steps.

        Arguments as of `fellner_schall_weights`.
        """
        if not self.adapts or self.updates == MOST_UPDATES:
            return self
        weights = fellner_schall_weights(self.penalties, self.weights, model, covariance)
        stated = None if self.stated is None else self.stated.reweighted(model)
        return replace(self, weights=weights, stated=stated, updates=self.updates + 1)

    def close_to(self, other: Smoothness) -> bool:
        """Whether no weight, nor a variance of the stated prior, differs by enough to matter."""
        change = [np.abs(np.log(self.weights / other.weights))]
        if self.stated is not None and other.stated is not None:
            change.append(np.abs(np.log(np.diag(self.stated.covariance) / np.diag(other.stated.covariance))))
        return bool((np.concatenate(change) < SETTLED).all())


def initial_weight(penalty: Penalty, model: Model) -> float:
    """Maximum-likelihood weight if the model's coefficients were known exactly; 1 where all are zero."""
    theta = np.array([model.value(key) for key in penalty.keys])
    size = float(theta @ penalty.S @ theta)
    return float(np.clip(np.linalg.matrix_rank(penalty.S) / size, LEAST, FIRST_MOST)) if size > 0.0 else 1.0


def fellner_schall_weights(penalties: Sequence[Penalty], weights: Array, model: Model, covariance: Array) -> Array:
    """Weights after one step to the largest marginal likelihood: generalised Fellner–Schall (Wood & Fasiolo 2017).

    Args:
        model: fitted with the present `weights`. covariance: (P, P), posterior, of its free parameters (SI).
    """
    if not penalties:
        return weights
    keys = tuple(dict.fromkeys(key for penalty in penalties for key in penalty.keys))
    prior = np.asarray(np.linalg.inv(_precision(keys, penalties, weights)))
    out = np.empty(len(penalties))
    for j, penalty in enumerate(penalties):
        rows, free = ([where.index(key) for key in penalty.keys] for where in (keys, model.free))
        theta = np.array([model.value(key) for key in penalty.keys])
        gained = _trace(prior, rows, penalty.S) - _trace(covariance, free, penalty.S)
        size = float(theta @ penalty.S @ theta)
        out[j] = weights[j] * (gained / size if gained > 0.0 < size else 1.0)
    return np.asarray(np.clip(out, LEAST, MOST))


def _trace(covariance: Array, rows: Sequence[int], S: Array) -> float:
    """tr(Σ S) over some rows of a covariance."""
    return float((covariance[np.ix_(rows, rows)] * S).sum())


def _precision(keys: Sequence[str], penalties: Sequence[Penalty], weights: Array) -> NDArray[np.float64]:
    """(K, K), precision of the Gaussian of weighted penalties on the parameters `keys`."""
    precision = np.zeros((len(keys), len(keys)))
    for penalty, weight in zip(penalties, weights, strict=True):
        rows = [keys.index(key) for key in penalty.keys]
        precision[np.ix_(rows, rows)] += weight * penalty.S
    return precision
