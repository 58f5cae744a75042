"""Elbow angles of arms whose first two axes are skew: zeros of a trigonometric polynomial of degree two (Pieper 1968).

With e^{i t3} as the unknown, ux² + uy² = vx² + vy² is a self-reciprocal polynomial of degree four; its roots on the
unit circle, eigenvalues of the companion matrix, are the angles.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lrm_math.arrays import Array
from lrm_math.ik.pieper import PieperForm

Complex = NDArray[np.complex128]

OFF_CIRCLE = 1e-2
"""A double root splits by the square root of the round-off; a root further off the circle is no angle."""
POLISH = 4
LARGEST_STEP = 1e-3
EXACT = 1e-12
"""Share of the arm's length squared by which the polynomial may miss zero."""


def skew_elbow(form: PieperForm, height: Array, square: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Angles t3 (4, N) in rad, and which of them exist (4, N).

    `height`, `square`: (N,), C_z (m) and |C|² (m²) of the wrist centre.
    """
    F = _polynomial(form, height, square)
    scale = np.abs(F).max(axis=0) + np.finfo(float).tiny
    leading = np.where(np.abs(F[4]) < 1e-14 * scale, 1e-14 * scale, F[4])
    companion = np.zeros((len(height), 4, 4), dtype=np.complex128)
    companion[:, 0] = -(F[3::-1] / leading).T
    companion[:, [1, 2, 3], [0, 1, 2]] = 1.0
    root = np.linalg.eigvals(companion).T
    size = np.abs(root)
    near = np.abs(size - 1.0) < OFF_CIRCLE
    t = np.where(near, np.angle(np.where(near, root, 1.0)), 0.0)
    for _ in range(POLISH):
        value, slope = _value(F, t), _slope(F, t)
        step = np.where(slope != 0.0, -value / np.where(slope != 0.0, slope, 1.0), 0.0)
        moved = t + np.clip(step, -LARGEST_STEP, LARGEST_STEP)
        t = np.where(np.abs(_value(F, moved)) < np.abs(value), moved, t)
    return t, near & (np.abs(_value(F, t)) < EXACT * form.length**2)


def _polynomial(form: PieperForm, height: Array, square: Array) -> Complex:
    """(5, N), coefficients of e^{-2it} … e^{2it} of ux² + uy² - vx² - vy² (m²)."""
    v0, vc, vs = (np.array(v) for v in (form.v0, form.vc, form.vs))
    cos, sin = form.links[0]
    norm = _harmonic(np.full(len(height), v0 @ v0 + vc @ vc), 2 * v0 @ vc, 2 * v0 @ vs)
    vz = _harmonic(np.full(len(height), v0[2]), vc[2], vs[2])
    constant = _harmonic(np.ones(len(height)), 0.0, 0.0)
    ux = ((square - form.a**2) * constant - norm) / (2.0 * form.a)
    uy = (height * constant - cos * vz) / sin
    F = _times(ux, ux) + _times(uy, uy) + _times(vz, vz)
    F[1:4] -= norm
    return F


def _harmonic(mean: Array, cosine: float, sine: float) -> Complex:
    """(3, N), coefficients of e^{-it}, 1, e^{it} of mean + cosine cos t + sine sin t."""
    half = complex(cosine, -sine) / 2.0
    return np.stack([np.full(len(mean), half.conjugate()), mean.astype(np.complex128), np.full(len(mean), half)])


def _times(f: Complex, g: Complex) -> Complex:
    """(5, N), product of two trigonometric polynomials of degree one."""
    out = np.zeros((5, f.shape[1]), dtype=np.complex128)
    for i in range(3):
        out[i : i + 3] += f[i] * g
    return out


def _value(F: Complex, t: Array) -> Array:
    z = np.exp(1j * t)
    return np.asarray(F[2].real + 2.0 * (F[3] * z + F[4] * z * z).real)


def _slope(F: Complex, t: Array) -> Array:
    z = np.exp(1j * t)
    return np.asarray(2.0 * (1j * (F[3] * z + 2.0 * F[4] * z * z)).real)
