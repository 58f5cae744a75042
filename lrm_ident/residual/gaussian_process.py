"""Gaussian process regression with a squared-exponential kernel and a length per input (ARD).

Rasmussen & Williams 2006, chapters 2 and 5: y = f(x) + noise, k(x, x') = s² exp(−½ Σ ((x_d − x'_d) / l_d)²);
hyperparameters by the marginal likelihood (empirical Bayes, Eq 5.8) with its analytic gradient (Eq 5.9) and its average
information (Gilmour, Thompson & Cullis 1995).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.linalg.blas import dsymm, dsyr
from scipy.linalg.lapack import dpotri

from lrm_math.arrays import Array

LENGTH_RANGE, SIGNAL_RANGE, NOISE_RANGE = (0.2, 50.0), (1e-3, 10.0), (1e-2, 2.0)
"""Bounds in standard deviations of inputs and outputs; at the longest length an input hardly matters."""
START = (2.0, 1.0, 0.5)
WORTHWHILE = 2.0  # gain of log marginal likelihood of a step below which a search ends, as of two parameters in AIC
DAMPING = 1e-2  # least damping of a step, per row
LONGEST_STEP = 1.0  # of a hyperparameter's logarithm
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
        kernel = np.exp(values)
        return Kernel(kernel[:-2], float(kernel[-2]), float(kernel[-1]))

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
    """Gaussian process conditioned on data: `inputs` (n, D), `weights` (n,) = (K + noise² I)⁻¹ y, Cholesky `factor`."""

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
    return GaussianProcess(kernel, inputs, np.asarray(cho_solve((factor, True), output, check_finite=False)), factor)


@dataclass(frozen=True, eq=False)
class FactoredKernel:
    """A kernel at inputs (n, D): f's covariance `smooth` (n, n), and the lower Cholesky `factor` of the outputs'."""

    kernel: Kernel
    inputs: Array
    smooth: Array
    factor: Array

    @staticmethod
    def of(kernel: Kernel, inputs: Array) -> FactoredKernel:
        """A kernel factored at inputs (n, D)."""
        smooth = kernel.covariance(inputs, inputs)
        return FactoredKernel(kernel, inputs, smooth, _factor(kernel, smooth.copy()))

    @cached_property
    def inverse(self) -> Array:
        """(n, n), inverse of the outputs' covariance, its lower triangle."""
        return np.asarray(dpotri(self.factor, lower=1)[0])


@dataclass(frozen=True, eq=False)
class LogMarginalLikelihood:
    """Log marginal likelihood log p(y | X) (Eq 5.8) of a kernel for outputs (n,), to second order in the logarithms of
    its hyperparameters."""

    factored: FactoredKernel
    output: Array

    @cached_property
    def weights(self) -> Array:
        """(n,), w = K⁻¹ y."""
        return np.asarray(cho_solve((self.factored.factor, True), self.output, check_finite=False))

    @cached_property
    def value(self) -> float:
        """log p(y | X)."""
        log_root = float(np.log(np.diag(self.factored.factor)).sum())
        return -0.5 * float(self.output @ self.weights) - log_root - 0.5 * len(self.output) * math.log(2.0 * math.pi)

    @cached_property
    def _scaled(self) -> Array:
        """(n, D + 1), inputs in lengths, and ones."""
        return np.column_stack([self.factored.inputs / self.factored.kernel.lengths, np.ones(len(self.output))])

    @cached_property
    def gradient(self) -> Array:
        """(D + 2,), by the logarithms of lengths, signal and noise (Eq 5.9)."""
        scaled, kernel = self._scaled, self.factored.kernel
        excess = dsyr(-1.0, self.weights, lower=1, a=self.factored.inverse)  # −2 ∂/∂K of the value: the lower triangle
        noisy = -(kernel.noise**2) * np.trace(excess)
        excess *= self.factored.smooth.T
        weighted = dsymm(-1.0, excess, scaled, lower=1)
        # ½ tr((w wᵀ − K⁻¹) ∂K/∂ln l_d) with the square multiplied out; the ones' column gives the signal's
        lengths = weighted[:, -1] @ scaled[:, :-1] ** 2 - np.einsum("nd,nd->d", scaled[:, :-1], weighted[:, :-1])
        return np.array([*lengths, weighted[:, -1].sum(), noisy])

    @cached_property
    def information(self) -> Array:
        """(D + 2, D + 2), the average information ½ wᵀ ∂K K⁻¹ ∂K w (Gilmour, Thompson & Cullis 1995): the mean of
        observed and expected information without the second derivatives of the covariance, and products of matrices."""
        scaled, kernel, along = self._scaled, self.factored.kernel, self.weights[:, None]
        # ∂K/∂ln l_d at (i, j) is k_ij (x_id − x_jd)²/l_d². Times w, the square multiplied out needs only k times w, x w
        # and x² w, so that the derivatives cost three products with a vector for each input
        moments = self.factored.smooth @ np.hstack([scaled * along, scaled[:, :-1] ** 2 * along])
        inputs = scaled.shape[1] - 1
        first, ones, second = np.split(moments, [inputs, inputs + 1], axis=1)
        by_length = scaled[:, :-1] ** 2 * ones - 2.0 * scaled[:, :-1] * first + second
        derivatives = np.hstack([by_length, 2.0 * ones, 2.0 * kernel.noise**2 * along])  # of K, times the weights
        root = solve_triangular(self.factored.factor, derivatives, lower=True, check_finite=False)
        return np.asarray(0.5 * root.T @ root)


def log_marginal_likelihood(kernel: Kernel, inputs: Array, output: Array) -> LogMarginalLikelihood:
    """The log marginal likelihood of a kernel for outputs (n,) at inputs (n, D)."""
    return LogMarginalLikelihood(FactoredKernel.of(kernel, inputs), output)


def fit_kernel(start: FactoredKernel, output: Array) -> Kernel:
    """The kernel of largest marginal likelihood within bounds, by Fisher scoring with the average information.

    Steps are damped (Levenberg 1944); hyperparameters at a bound that the gradient leads beyond stay there.

    Args:
        start: at inputs (n, D), each of a standard deviation near one. output: (n,), likewise, about zero.
    """
    inputs = start.inputs
    lower, upper = np.log([*[LENGTH_RANGE] * inputs.shape[1], SIGNAL_RANGE, NOISE_RANGE]).T
    z, damping, likelihood = start.kernel.log, DAMPING, LogMarginalLikelihood(start, output)
    for _ in range(MAX_EVALUATIONS):
        # projected step: at a bound that the gradient leads beyond a hyperparameter is left out of the system
        free = ~(((z <= lower) & (likelihood.gradient < 0)) | ((z >= upper) & (likelihood.gradient > 0)))
        step = np.zeros_like(z)
        damped = likelihood.information[np.ix_(free, free)] + damping * len(output) * np.eye(int(free.sum()))
        step[free] = np.linalg.solve(damped, likelihood.gradient[free])
        trial = np.clip(z + step / max(1.0, np.abs(step).max() / LONGEST_STEP), lower, upper)
        # the gain that a straight line promises is at least that of the curve near a maximum
        if likelihood.gradient @ (trial - z) < WORTHWHILE:
            break
        then = log_marginal_likelihood(Kernel.of_log(trial), inputs, output)
        gain = then.value - likelihood.value
        if gain > 0.0:
            z, likelihood = trial, then
        if 0.0 < gain < WORTHWHILE:
            break
        damping = max(0.1 * damping, DAMPING) if gain > 0.0 else 10.0 * damping
    return Kernel.of_log(z)


def _factor(kernel: Kernel, covariance: Array) -> Array:
    """(n, n), lower Cholesky factor of the outputs' covariance, from f's, in its place; the noise, which has a lower
    bound, keeps it definite."""
    covariance.flat[:: len(covariance) + 1] += kernel.noise**2
    in_order = covariance.T  # LAPACK's order of memory
    return np.asarray(cholesky(in_order, lower=True, overwrite_a=True, check_finite=False))
