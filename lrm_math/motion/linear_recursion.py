"""A linear recursion over many instants, by blocks that run side by side (prefix sums; Blelloch 1990).

Each block starts from zero beside the product of its matrices; where it really starts is then added. So √M steps of
array arithmetic do what M would, with the same result but for rounding.
"""

from __future__ import annotations

import numpy as np

from lrm_math.arrays import Array


def linear_recursion(A: Array, b: Array, x: Array) -> Array:
    """(M + 1, n, …), x and all x ← A x + b after it.

    Args:
        A: (M, n, n, …), or (1, n, n, …) where it is the same at all instants. b: (M, n, …). x: (n, …).
    """
    M, n = b.shape[:2]
    length = max(round(np.sqrt(M)), 1)
    count = -(-M // length)
    pushed = _in_blocks(b, count, length)
    turned = A[None] if len(A) == 1 else _in_blocks(A, count, length)  # (length or 1, count or 1, n, n, …)
    within = np.empty((length, *np.broadcast_shapes((count, *x.shape), pushed.shape[1:])))
    eye = np.eye(n).reshape(n, n, *[1] * (turned.ndim - 4))
    product, after = np.broadcast_to(eye, turned.shape[1:]), np.zeros(within.shape[1:])
    products = np.empty((length, *turned.shape[1:]))
    for k in range(length):
        step = turned[k if len(turned) > 1 else 0]
        after = _times(step, after) + pushed[k]
        product = np.sum(step[:, :, :, None] * product[:, None], axis=2)
        within[k], products[k] = after, product
    begun = np.empty(within.shape[1:])
    for block in range(count):
        begun[block] = x
        x = _times(products[-1, block if products.shape[1] > 1 else 0][None], x[None])[0] + within[-1, block]
    for k in range(length):
        within[k] += _times(products[k], begun)
    out = within.swapaxes(0, 1).reshape(count * length, *within.shape[2:])[:M]
    return np.concatenate([begun[:1], out])


def _times(A: Array, x: Array) -> Array:
    """(N, n, …) of matrices (N or 1, n, n, …) and vectors (N, n, …)."""
    return np.asarray(np.sum(A * x[:, None], axis=2))


def _in_blocks(values: Array, count: int, length: int) -> Array:
    """(length, count, …), of instants (M, …), the last block filled with zeros."""
    filled = np.zeros((count * length, *values.shape[1:]))
    filled[: len(values)] = values
    return filled.reshape(count, length, *values.shape[1:]).swapaxes(0, 1)
