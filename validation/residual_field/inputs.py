"""`python -m validation.residual_field.inputs`: whether data tell a field that follows load or side of approach too.

To the kernel of each axis one more is added: of the sides that the joints came from, or of the load, alone and times
the cosines of every joint. Variances have the largest marginal likelihood, in every fold anew for the held-out error.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import Bounds, minimize

from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.data.measurements import Measurements
from lrm_ident.fitting.cross_validation import FOLDS, joint_space_folds
from lrm_ident.fitting.field.fit import range_of
from lrm_ident.fitting.field.regression import AxisRegression, resolved_functions
from lrm_ident.study.study import Study
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects.field.residual_field import WAVES, ResidualField, wave_numbers
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model
from validation.options import asked
from validation.residual_field.nested import hidden

BOUNDS = Bounds((-6.0, -16.0, -8.0), (6.0, 2.0, 2.0))
"""Logarithms of the field's scale, the further variance, and the noise, in mean squares of the residual."""
STARTS = (-8.0, -2.0)
NOTHING = "the field alone"


def kernels(field: ResidualField, data: Measurements) -> tuple[Array, Array, dict[str, Array]]:
    """Functions of the field (N, M) and their half waves (M, n), and functions of each further input (N, K), of unit
    mean square; only of what varies."""
    every, resolved = resolved_functions(field, data.poses)
    waves = np.array(wave_numbers(field.arm.dof))[resolved]
    alone = every[:, ((waves > 0).sum(axis=1) <= 1) & (waves.max(axis=1) <= WAVES)]
    sides = np.zeros_like(data.poses.q) if data.poses.direction is None else data.poses.direction
    out = {NOTHING: np.zeros((len(data), 1))}
    for name, values in (("side of approach", sides), ("load", data.poses.payload[:, None])):
        varying = values[:, np.ptp(values, axis=0) > 0.0]
        unit = (varying - varying.mean(axis=0)) / varying.std(axis=0)
        if unit.size:
            out[name] = unit
            out[f"{name} × angles"] = (unit[:, :, None] * alone[:, None]).reshape(len(data), -1)
    return every, waves, out


@dataclass(frozen=True, eq=False)
class _Fitted:
    """Log marginal likelihood, and the three variances that it is largest at."""

    log_likelihood: float
    variances: Array

    @staticmethod
    def of(field: Array, further: Array, y: Array) -> _Fitted:
        """Regression with kernels (N, N) and outputs y (N,) of unit mean square."""

        def loss(log: Array) -> float:
            a, b, noise = np.exp(log)
            factor = cho_factor(a * field + b * further + noise * np.eye(len(y)))
            return float(0.5 * y @ cho_solve(factor, y) + np.log(np.diag(factor[0])).sum())

        starts = STARTS if further.any() else STARTS[:1]
        runs = [minimize(loss, (0.0, start, -1.0), method="L-BFGS-B", bounds=BOUNDS) for start in starts]
        best = min(runs, key=lambda run: float(run.fun))
        return _Fitted(-float(best.fun), np.exp(best.x))


def told(model: Model, data: Measurements) -> Iterator[tuple[str, float, float]]:
    """Name of each further input, the rise of the log marginal likelihood over three axes, and held-out RMS (m).

    The field's lengths are those of all poses; scales, noise and the further variance those of the other folds.
    """
    field = ResidualField(model.arm, "tool").over(range_of(data.poses))
    residual = field.along_axes(data.poses, data.position_error(solve_equilibrium(model, data.poses)))
    F, waves, inputs = kernels(field, data)
    fold = joint_space_folds(data.poses.q, data.repeat_of)
    size = np.sqrt((residual**2).mean(axis=0))
    priors = [
        AxisRegression.empirical_bayes(F, y, waves).variance / unit**2 for y, unit in zip(residual.T, size, strict=True)
    ]
    base = 0.0
    for name, D in inputs.items():
        further, rise, left = D @ D.T / D.shape[1], 0.0, np.empty_like(residual)
        for axis, (prior, unit) in enumerate(zip(priors, size, strict=True)):
            smooth, y = (F * prior) @ F.T, residual[:, axis] / unit
            rise += _Fitted.of(smooth, further, y).log_likelihood
            for number in range(FOLDS):
                known, test = np.flatnonzero(fold != number), np.flatnonzero(fold == number)
                left[test, axis] = unit * (y[test] - _predicted(smooth, further, y, known, test))
        base = rise if name == NOTHING else base
        yield name, rise - base, float(np.sqrt((left**2).sum(axis=1).mean()))


def _predicted(field: Array, further: Array, y: Array, known: NDArray[np.int64], test: NDArray[np.int64]) -> Array:
    at = np.ix_(known, known)
    a, b, noise = _Fitted.of(field[at], further[at], y[known]).variances
    K = a * field + b * further
    return np.asarray(K[np.ix_(test, known)] @ np.linalg.solve(K[at] + noise * np.eye(len(known)), y[known]))


def main() -> None:
    """Prints a table for each data set."""
    path, console = asked(__doc__, "data?").data, Console(width=120)
    sets = [] if path is None else [(path.stem, load_measurements(path, load_arm("lrm-lab")), "option1")]
    sets += [(name, hidden(name), "identifiable") for name in ("cable-over-3-and-5", "bearing3", "dahl1")]
    for title, data, parameters in sets:
        plain = Study.of(data).fit(parameters)
        for start, study in (("plain fit", plain), ("named", plain.auto()[1])):
            table = Table("inputs", "rise of log likelihood", "held-out RMS mm", title=f"{title}, {start}")
            for name, rise, rms in told(study.model, study.data):
                table.add_row(name, f"{rise:.1f}", f"{1e3 * rms:.2f}")
            console.print(table)


if __name__ == "__main__":
    main()
