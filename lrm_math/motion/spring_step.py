"""Exact motion of a damped mass on a spring over one step, alone or with a second mass on a spring behind it."""

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


TERMS, HALVINGS = 8, 5
"""Of the exponential's series, and times that its step is halved first: 1e-9 off at a step of three radians."""


def two_masses(stiffness: Array, braking: Array, second: tuple[Array, Array, Array], h: float) -> Array:
    """(4, 4, ...), matrix of a step of h (s) of F, v, z and ż: deflection and speed of the first mass, z of the second.

    The second lies z ahead of the first and pushes back (scaling and squaring; Moler & Van Loan 2003):
    v̇ = stiffness F − braking v + m (s z + b ż), z̈ = −s z − b ż − v̇; `second`: s, b and its share m of the first.
    """
    k, d, s, b, m = np.broadcast_arrays(stiffness, braking, *second)
    none = np.zeros_like(k)
    first = [k * h, -d * h, m * s * h, m * b * h]
    relative = [-first[0], -first[1], -(1.0 + m) * s * h, -(1.0 + m) * b * h]
    rows = [[none, none - h, none, none], first, [none, none, none, none + h], relative]
    unit = np.array([1.0, h, 1.0, h])  # speeds by the step, so that all entries are alike in size
    A = np.moveaxis(np.array(rows), (0, 1), (-2, -1)) * unit[:, None] / unit / 2.0**HALVINGS
    out = term = np.broadcast_to(np.eye(4), A.shape)
    for number in range(1, TERMS + 1):
        term = term @ A / number
        out = out + term
    for _ in range(HALVINGS):
        out = out @ out
    return np.moveaxis(out / unit[:, None] * unit, (-2, -1), (0, 1))
