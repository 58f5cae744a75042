"""Exact motion of a damped mass on a spring over one step."""

from __future__ import annotations

import numpy as np

from lrm_math.arrays import Array


def sprung(stiffness: Array, braking: Array, h: float) -> tuple[Array, Array, Array, Array]:
    """a, b, c, d of a step of h (s) by the spring's deflection F and the speed v: x' = x + a F + b v, v' = c F + d v.

    ẍ = stiffness F − braking ẋ, where F falls by what x gains.
    """
    half = 0.5 * braking
    w = np.sqrt(np.asarray(stiffness - half**2, dtype=np.complex128) + 1e-12)
    fades, cosine, sine = np.exp(-half * h), np.cos(w * h).real, (np.sin(w * h) / w).real
    b = fades * sine
    return 1.0 - fades * (cosine + half * sine), b, stiffness * b, fades * (cosine - half * sine)
