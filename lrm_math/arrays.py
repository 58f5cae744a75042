"""Type aliases: float64 numpy arrays, batches first `(N, ...)`, and 3-vectors of floats."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
Vector3: TypeAlias = tuple[float, float, float]

ORIGIN: Vector3 = (0.0, 0.0, 0.0)
