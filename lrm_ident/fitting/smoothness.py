"""Penalties that keep free forms smooth and small, their weights by the marginal likelihood.

A form has a penalty on the second differences of its curves' coefficients (P-splines, Eilers & Marx 1996) and one
on the size of all of them (ridge regression). Both enter the least squares as a Gaussian prior. They begin at the
effect's typical size; their weights are then those that make the measurements most probable (Wood & Fasiolo 2017), so
that a form of which the data show nothing is drawn to zero, and nothing is tuned.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lrm_ident.fitting.priors import Prior
from lrm_math.arrays import Array
from lrm_math.effects import Effect
from lrm_math.model.model import Model

if TYPE_CHECKING:
    from lrm_ident.fitting.levenberg_marquardt import Fit

MOST_WEIGHINGS = 8
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


def weighed(solve: Callable[[Model, Prior | None], Fit], model: Model, prior: Prior | None) -> Fit:
    """The fit with the likeliest weights: `solve` fits from a model on with a prior, beginning with `model`."""
    known = penalties(model)
    weights = np.ones(len(known))
    found = solve(model, with_penalties(prior, known, weights))
    for _ in range(MOST_WEIGHINGS if known else 0):
        likelier = likelier_weights(known, weights, found.model, found.covariance)
        if _settled(weights, likelier):
            break
        weights = likelier
        found = solve(found.model, with_penalties(prior, known, weights))
    return found


def _settled(before: Array, after: Array) -> bool:
    """Whether no weight changes enough to matter."""
    return bool((np.abs(np.log(after / before)) < SETTLED).all())


def _trace(covariance: Array, rows: Sequence[int], S: Array) -> float:
    return float((covariance[np.ix_(rows, rows)] * S).sum())


def _weighted(keys: Sequence[str], known: Sequence[Penalty], weights: Array) -> NDArray[np.float64]:
    precision = np.zeros((len(keys), len(keys)))
    for penalty, weight in zip(known, weights, strict=True):
        rows = [keys.index(key) for key in penalty.keys]
        precision[np.ix_(rows, rows)] += weight * penalty.S
    return precision
