"""Some rows of many: drawn at random, always the same ones, or evenly spaced."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def drawn_rows(count: int, most: int) -> NDArray[np.int64]:
    """Numbers of at most `most` of `count` rows, drawn without replacement, ascending, always the same."""
    return np.arange(count) if count <= most else np.sort(np.random.default_rng(0).choice(count, most, replace=False))


def spaced_rows(count: int, most: int) -> NDArray[np.int64]:
    """Numbers of at most `most` of `count` rows, evenly spaced, the first and the last among them."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.int64))
