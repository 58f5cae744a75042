"""Identification options of Conenna 2024, chapter 6: optimal poses, fit to them, validation on all and on the rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.error_stats import ErrorStats, error_stats
from lrm_ident.data.measurements import Measurements
from lrm_ident.design.detmax import exchange
from lrm_ident.design.fisher_information import Rows
from lrm_ident.design.observability import identification_jacobian
from lrm_ident.fitting.levenberg_marquardt import Fit, fit
from lrm_ident.fitting.model_fit import nominal_model
from lrm_ident.fitting.parameter_sets import bounds_of, no_bounds, select_parameters
from lrm_ident.fitting.progress import OnProgress, silent
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.errors import FileError, UnknownName
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model

POSES = 50


@dataclass(frozen=True)
class ThesisOption:
    """A parameter set of the thesis; `physical`: fitted with physical bounds.

    For options 1₂ and 3₂ the thesis discarded pose sets until no compliance was negative (Figure 6.3); here the fit is
    bounded, on the same poses.
    """

    name: str
    parameters: str
    physical: bool


OPTIONS = (
    *(ThesisOption(f"option{number}", f"option{number}", physical=False) for number in range(1, 6)),
    *(ThesisOption(f"option{number}_2", f"option{number}", physical=True) for number in (1, 3)),
)


def option_named(name: str) -> ThesisOption:
    """The option of that name. Raises `UnknownName`."""
    by_name = {option.name: option for option in OPTIONS}
    if name not in by_name:
        raise UnknownName("option", name, list(by_name))
    return by_name[name]


@dataclass(frozen=True, eq=False)
class OptionResult:
    """One option on one data set.

    Attributes:
        rows: (n,), training poses.
        fit: to those.
        residual: (N, 3), of all poses (m).
    """

    option: ThesisOption
    rows: Rows
    fit: Fit
    residual: Array

    @property
    def rest(self) -> NDArray[np.bool_]:
        """(N,), mask of the validation poses."""
        mask = np.ones(len(self.residual), dtype=np.bool_)
        mask[self.rows] = False
        return mask

    @property
    def on_chosen(self) -> ErrorStats:
        """Error over the training poses."""
        return error_stats(self.residual[self.rows])

    @property
    def on_all(self) -> ErrorStats:
        """Error over all poses (thesis Tables 6.4 and 6.6)."""
        return error_stats(self.residual)

    @property
    def on_rest(self) -> ErrorStats:
        """Error over the validation poses (thesis Tables 6.5 and 6.7)."""
        return error_stats(self.residual[self.rest])


@dataclass(frozen=True, eq=False)
class OptionStudy:
    """All options on one data set, with the nominal arm's residual (N, 3) in m."""

    data: Measurements
    nominal: Array
    identified: tuple[OptionResult, ...]

    def of(self, option: str) -> OptionResult:
        """The result of one option. Raises `UnknownName`."""
        by_name = {result.option.name: result for result in self.identified}
        if option not in by_name:
            raise UnknownName("option", option, list(by_name))
        return by_name[option]


def run_options(
    arm: Arm,
    data: Measurements,
    poses: int = POSES,
    options: Sequence[ThesisOption] = OPTIONS,
    seed: int = 0,
    progress: OnProgress = silent,
) -> OptionStudy:
    """Fits every option to its optimal poses (O1, DETMAX exchange) and validates on all poses.

    Raises:
        UnknownName: the arm lacks a parameter of an option.
        LrmError: too few or rank-deficient poses, or a fit that does not converge.
    """
    if len(data.positions.rows) < len(data):
        raise FileError(
            data.source.path, "", "the thesis's options need a position of every pose", "use fit and compare"
        )
    nominal = nominal_model(arm)
    equilibrium = solve_equilibrium(nominal, data.poses)
    rows: dict[str, Rows] = {}
    found = []
    for number, option in enumerate(options, start=1):
        keys = select_parameters(nominal, option.parameters)
        if option.parameters not in rows:
            rows[option.parameters] = exchange(identification_jacobian(equilibrium, keys), poses, seed=seed).rows
        found.append(identify(replace(nominal, free=keys), data, option, rows[option.parameters]))
        progress(number, len(options))
    return OptionStudy(data, data.tcp - equilibrium.tcp, tuple(found))


def identify(model: Model, data: Measurements, option: ThesisOption, rows: Rows) -> OptionResult:
    """One option fitted to the given rows, starting from the model's values. Raises `LrmError`."""
    limits = bounds_of(model, model.free) if option.physical else no_bounds(model.free)
    fitted = fit(model, data.take(rows), limits)
    return OptionResult(option, rows, fitted, residual_of(fitted.model, data))


def residual_of(model: Model, data: Measurements) -> Array:
    """(N, 3), measured − predicted TCP (m)."""
    return np.asarray(data.tcp - solve_equilibrium(model, data.poses).tcp)


@dataclass(frozen=True, eq=False)
class CrossLoadResult:
    """One option identified on each of two data sets and validated on both (thesis Table 6.8).

    `residual[i][j]`: (N_j, 3), m, on data set j with the parameters identified on data set i.
    """

    option: ThesisOption
    both: tuple[OptionResult, OptionResult]
    residual: tuple[tuple[Array, Array], tuple[Array, Array]]

    def error(self, identified_on: int, measured_on: int) -> ErrorStats:
        """Error over the validation poses of a data set."""
        return error_stats(self.residual[identified_on][measured_on][self.both[measured_on].rest])


def cross_apply(first: OptionStudy, second: OptionStudy, option: str) -> CrossLoadResult:
    """Validates the parameters of each data set on the other one. Raises `UnknownName`, `NoEquilibrium`."""
    a, b = first.of(option), second.of(option)
    to_second = residual_of(a.fit.model, second.data)
    to_first = residual_of(b.fit.model, first.data)
    return CrossLoadResult(a.option, (a, b), ((a.residual, to_second), (to_first, b.residual)))
