"""Column spaces of motions: orthonormal bases, numerical rank, and the angle between two (Björck & Golub 1973)."""

from __future__ import annotations

import numpy as np

from lrm_math.arrays import Array

NUMERICAL_RANK = 1e-9
"""Ratio to the largest singular value below which one counts as zero."""


def truncated_svd(A: Array) -> tuple[Array, Array]:
    """U (n, rank) and V S⁻¹ (m, rank) of A (n, m) = U S Vᵀ, numerically zero singular values left out."""
    basis, singular, rows = np.linalg.svd(A, full_matrices=False)
    keep = singular > NUMERICAL_RANK * singular.max(initial=0.0)
    return basis[:, keep], rows[keep].T / singular[keep]


def orthonormal_basis(columns: Array) -> Array:
    """(R N, rank), orthonormal basis of the space of columns (R N, m)."""
    return truncated_svd(columns)[0]


def projected_rank(columns: Array, original: Array) -> int:
    """Rank of projected columns (R N, m): directions that keep more than a thousandth of the original columns' norm."""
    scaled = columns / np.maximum(np.linalg.norm(original, axis=0), 1e-300)
    return int(np.count_nonzero(np.linalg.eigvalsh(scaled.T @ scaled) > 1e-6))


def principal_cosine(a: Array, b: Array) -> float:
    """Smallest principal cosine (Björck & Golub 1973) of two column spaces: 1 if the smaller lies in the larger."""
    return cosine_of_bases(orthonormal_basis(a), orthonormal_basis(b))


def cosine_of_bases(a: Array, b: Array) -> float:
    """`principal_cosine` of orthonormal columns."""
    small, large = sorted((a, b), key=lambda basis: basis.shape[1])
    if not small.shape[1]:
        return 0.0
    return float(np.linalg.svd(large.T @ small, compute_uv=False).min())
