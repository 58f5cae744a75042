"""Black-box models on the residual of a rigid arm: a Gaussian process and gradient boosting, of the joint angles."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from lrm_ident.residual.gaussian_process import FactoredKernel, Kernel, condition, fit_kernel
from lrm_math.arrays import Array

KERNEL_ROWS = 250
TREES, DEPTH, RATE, BINS, LEAST_LEAF = 300, 3, 0.1, 32, 5


def gaussian_process(q: Array, left: Array, unseen: Array) -> Array:
    """(m, 3), prediction at unseen joint angles (m, n) of a residual (N, 3) at q (N, n); a kernel for each axis."""
    centre, spread = q.mean(axis=0), np.maximum(q.std(axis=0), 1e-9)
    known, asked, out = (q - centre) / spread, (unseen - centre) / spread, np.empty((len(unseen), left.shape[1]))
    chosen = np.random.default_rng(1).permutation(len(q))[:KERNEL_ROWS]
    for axis, values in enumerate(left.T):
        mean, size = values.mean(), max(float(values.std()), 1e-12)
        output = (values - mean) / size
        kernel = fit_kernel(FactoredKernel.of(Kernel.start(q.shape[1]), known[chosen]), output[chosen])
        found = condition(kernel, known, output)
        out[:, axis] = mean + size * (kernel.covariance(asked, known) @ found.weights)
    return out


def boosting(q: Array, left: Array, unseen: Array) -> Array:
    """(m, 3), the same by gradient boosting of regression trees (Friedman 2001), on quantiles of each angle."""
    edges = np.quantile(q, np.linspace(0.0, 1.0, BINS + 1)[1:-1], axis=0)
    bins, asked = (np.stack([np.searchsorted(e, v) for e, v in zip(edges.T, x.T, strict=True)]).T for x in (q, unseen))
    out = np.tile(left.mean(axis=0), (len(unseen), 1))
    rest = left - left.mean(axis=0)
    for _ in range(TREES):
        step, answer = _tree(bins, rest, asked, DEPTH)
        rest = rest - RATE * step
        out += RATE * answer
    return out


def _tree(bins: NDArray[np.int64], y: Array, asked: NDArray[np.int64], depth: int) -> tuple[Array, Array]:
    """Fitted values (N, 3) and answers (m, 3) of one regression tree."""
    here, there = np.tile(y.mean(axis=0), (len(y), 1)), np.tile(y.mean(axis=0), (len(asked), 1))
    if depth == 0 or len(y) < 2 * LEAST_LEAF:
        return here, there
    best, feature, edge = 0.0, -1, 0
    for column in range(bins.shape[1]):
        count = np.cumsum(np.bincount(bins[:, column], minlength=BINS))[:-1]
        below = np.cumsum([np.bincount(bins[:, column], axis, BINS) for axis in y.T], axis=1)[:, :-1]
        above, more = y.sum(axis=0)[:, None] - below, len(y) - count
        allowed = (count >= LEAST_LEAF) & (more >= LEAST_LEAF)
        gain = (below**2).sum(axis=0) / np.maximum(count, 1) + (above**2).sum(axis=0) / np.maximum(more, 1)
        gain = np.where(allowed, gain - (y.sum(axis=0) ** 2).sum() / len(y), 0.0)
        if gain.max() > best:
            best, feature, edge = float(gain.max()), column, int(np.argmax(gain))
    if feature < 0:
        return here, there
    for low in (True, False):
        rows, ask = (bins[:, feature] <= edge) == low, (asked[:, feature] <= edge) == low
        here[rows], there[ask] = _tree(bins[rows], y[rows], asked[ask], depth - 1)
    return here, there


RIGID, OURS = "rigid least squares", "lrm-ident fit (offsets, compliances)"
BLACK_BOXES: dict[str, Callable[[Array, Array, Array], Array]] = {
    "rigid, and a Gaussian process": gaussian_process,
    "rigid, and gradient boosting": boosting,
}
"""What each is called; a black box takes joint angles and residuals that are known, and joint angles unseen."""
