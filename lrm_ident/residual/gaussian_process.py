"""Gaussian process regression with a squared-exponential kernel and a length per input (ARD).

Rasmussen & Williams 2006, chapters 2 and 5: y = f(x) + noise, k(x, x') = s² exp(−½ Σ ((x_d − x'_d) / l_d)²);
hyperparameters by the marginal likelihood (empirical Bayes, Eq 5.8) with its analytic gradient (Eq 5.9).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.linalg.blas import dsymm, dsyr
from scipy.linalg.lapack import dpotri

from lrm_math.arrays import Array

LENGTH_RANGE, SIGNAL_RANGE, NOISE_RANGE = (0.2, 50.0), (1e-3, 10.0), (1e-2, 2.0)
"""Bounds in standard deviations of inputs and outputs; an input with the longest length hardly counts."""
START = (2.0, 1.0, 0.5)
FUNCTION_TOLERANCE = 1e-3  # of the log marginal likelihood per row
MAX_EVALUATIONS = 60


@dataclass(frozen=True, eq=False)
class Kernel:
    """Hyperparameters: `lengths` (D,) in the units of the inputs, `signal` and `noise` SD in those of the output."""

    lengths: Array
    signal: float
    noise: float

    @property
    def log(self) -> Array:
        """(D + 2,), natural logarithms of lengths, signal and noise."""
        return np.asarray(np.log(np.concatenate([self.lengths, [self.signal, self.noise]])))

    @staticmethod
    def of_log(values: Array) -> Kernel:
        """Hyperparameters from their logarithms (D + 2,)."""
        found = np.exp(values)
        return Kernel(found[:-2], float(found[-2]), float(found[-1]))

    @staticmethod
    def start(inputs: int) -> Kernel:
        """Start of a search, for inputs and an output of unit standard deviation."""
        length, signal, noise = START
        return Kernel(np.full(inputs, length), signal, noise)

    def covariance(self, A: Array, B: Array) -> Array:
        """(n, m), covariance of f at the rows of A (n, D) and of B (m, D)."""
        a, b = A / self.lengths, B / self.lengths
        out = a @ b.T  # in place from here, a matrix is large: minus half the squared distances
        out -= 0.5 * (a**2).sum(axis=1)[:, None]
        out -= 0.5 * (b**2).sum(axis=1)
        np.minimum(out, 0.0, out=out)
        np.exp(out, out=out)
        out *= self.signal**2
        return np.asarray(out)


@dataclass(frozen=True, eq=False)
class GaussianProcess:
    """A Gaussian process conditioned on rows: `inputs` (n, D), `weights` (n,) = (K + noise² I)⁻¹ y, `factor` its L."""

    kernel: Kernel
    inputs: Array
    weights: Array
    factor: Array

    def mean(self, inputs: Array) -> Array:
        """(m,), predicted f at inputs (m, D) (Eq 2.25)."""
        return np.asarray(self.kernel.covariance(inputs, self.inputs) @ self.weights)

    def sd(self, inputs: Array) -> Array:
        """(m,), standard deviation of f at inputs (m, D), without noise (Eq 2.26)."""
        explained = solve_triangular(self.factor, self.kernel.covariance(self.inputs, inputs), lower=True)
        return np.asarray(np.sqrt(np.maximum(self.kernel.signal**2 - (explained**2).sum(axis=0), 0.0)))


def condition(kernel: Kernel, inputs: Array, output: Array) -> GaussianProcess:
    """The process with this kernel, given outputs (n,) at inputs (n, D)."""
    factor = _factor(kernel, kernel.covariance(inputs, inputs))
    return GaussianProcess(kernel, inputs, np.asarray(cho_solve((factor, True), output)), factor)


def log_marginal_likelihood(kernel: Kernel, inputs: Array, output: Array) -> tuple[float, Array]:
    """log p(y | X) (Eq 5.8) and its gradient (D + 2,) by the logarithms of lengths, signal and noise (Eq 5.9)."""
    n = len(output)
    smooth = kernel.covariance(inputs, inputs)
    factor = _factor(kernel, smooth)
    weights = cho_solve((factor, True), output)
    value = -0.5 * float(output @ weights) - float(np.log(np.diag(factor)).sum()) - 0.5 * n * np.log(2.0 * np.pi)
    inverse = dpotri(factor, lower=1, overwrite_c=1)[0]  # of all from here the lower triangle
    excess = dsyr(-1.0, weights, lower=1, a=inverse, overwrite_a=1)  # −2 ∂/∂K of the value
    noisy = -(kernel.noise**2) * np.trace(excess)
    excess *= smooth.T
    scaled = np.column_stack([inputs / kernel.lengths, np.ones(n)])
    weighted = dsymm(-1.0, excess, scaled, lower=1)
    by_length = weighted[:, -1] @ scaled[:, :-1] ** 2 - np.einsum("nd,nd->d", scaled[:, :-1], weighted[:, :-1])
    return value, np.array([*by_length, weighted[:, -1].sum(), noisy])


def fit_kernel(inputs: Array, output: Array, start: Kernel) -> Kernel:
    """The kernel of largest marginal likelihood within bounds (L-BFGS-B; Byrd et al. 1995), searched from `start`.

    Args:
        inputs: (n, D), each of a standard deviation near one. output: (n,), likewise, about zero.
    """
    lower, upper = np.log([*[LENGTH_RANGE] * inputs.shape[1], SIGNAL_RANGE, NOISE_RANGE]).T

    def loss(log_values: Array) -> tuple[float, Array]:
        """Negative log marginal likelihood per row."""
        value, gradient = log_marginal_likelihood(Kernel.of_log(log_values), inputs, output)
        return -value / len(output), -gradient / len(output)

    from scipy.optimize import Bounds, minimize  # takes a quarter of a second to load

    found = minimize(
        loss,
        np.clip(start.log, lower, upper),
        jac=True,
        bounds=Bounds(lower, upper),
        method="L-BFGS-B",
        options={"maxfun": MAX_EVALUATIONS, "ftol": FUNCTION_TOLERANCE, "gtol": FUNCTION_TOLERANCE},
    )
    return Kernel.of_log(np.asarray(found.x))


def _factor(kernel: Kernel, smooth: Array) -> Array:
    """Lower Cholesky factor of the outputs' covariance; the noise, which has a lower bound, keeps it definite."""
    outputs = smooth.copy()
    outputs.flat[:: len(outputs) + 1] += kernel.noise**2
    return np.asarray(cholesky(outputs.T, lower=True, overwrite_a=True, check_finite=False))  # LAPACK's order of memory
