"""The method of Conenna 2024, chapter 6, on any data: choose poses, identify on them, validate on all and the rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lrm_ident.data.error_stats import ErrorFigures, figures
from lrm_ident.data.measurements import Measurements
from lrm_ident.design.detmax import exchange
from lrm_ident.design.observability import identification_jacobian
from lrm_ident.fit.levenberg_marquardt import Fit, bounds_of, fit, no_bounds
from lrm_ident.fit.parameter_sets import chosen
from lrm_ident.progress import Tick, silent
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.errors import UnknownName
from lrm_math.model.equilibrium import equilibrium
from lrm_math.model.model import Model, model_of

Rows = NDArray[np.int64]
POSES = 50
PHYSICAL = "_2"


@dataclass(frozen=True)
class Option:
    """A choice of parameters by its name in the thesis; `physical`: with the bounds that physics sets.

    The thesis reached options 1₂ and 3₂ by throwing away pose sets until no compliance was negative (Figure 6.3). Here
    the fit itself obeys the bounds, on the same poses.
    """

    name: str
    parameters: str
    physical: bool


OPTIONS = (
    *(Option(f"option{number}", f"option{number}", physical=False) for number in range(1, 6)),
    *(Option(f"option{number}{PHYSICAL}", f"option{number}", physical=True) for number in (1, 3)),
)


def option_named(name: str) -> Option:
    """One of the options. Raises `UnknownName`."""
    for option in OPTIONS:
        if option.name == name:
            return option
    raise UnknownName("option", name, [option.name for option in OPTIONS])


@dataclass(frozen=True, eq=False)
class Identified:
    """One option on one data set.

    Attributes:
        rows: (n,), of the poses it was identified on.
        fit: to those.
        residual: (N, 3) of all poses (m).
    """

    option: Option
    rows: Rows
    fit: Fit
    residual: Array

    @property
    def rest(self) -> NDArray[np.bool_]:
        """(N,), the poses that it never saw."""
        mask = np.ones(len(self.residual), dtype=np.bool_)
        mask[self.rows] = False
        return mask

    @property
    def on_chosen(self) -> ErrorFigures:
        """Error over the poses that it was identified on."""
        return figures(self.residual[self.rows])

    @property
    def on_all(self) -> ErrorFigures:
        """Error over all poses (thesis Tables 6.4 and 6.6)."""
        return figures(self.residual)

    @property
    def on_rest(self) -> ErrorFigures:
        """Error over the poses that it never saw (thesis Tables 6.5 and 6.7)."""
        return figures(self.residual[self.rest])


@dataclass(frozen=True, eq=False)
class Method:
    """All options on one data set, with the nominal arm's residual (N, 3) in m."""

    data: Measurements
    nominal: Array
    identified: tuple[Identified, ...]

    def of(self, option: str) -> Identified:
        """The result of one option. Raises `UnknownName`."""
        for one in self.identified:
            if one.option.name == option:
                return one
        raise UnknownName("option", option, [one.option.name for one in self.identified])


def run_method(
    arm: Arm,
    data: Measurements,
    poses: int = POSES,
    options: Sequence[Option] = OPTIONS,
    seed: int = 0,
    progress: Tick = silent,
) -> Method:
    """Every option identified on the poses that tell its parameters best (O1, DETMAX), validated on all and the rest.

    Raises:
        UnknownName: the arm lacks a parameter of an option.
        LrmError: too few or too poor poses, or a fit that does not converge.
    """
    empty = nominal_model(arm)
    rest = equilibrium(empty, data.poses)
    rows: dict[str, Rows] = {}
    found = []
    for number, option in enumerate(options, start=1):
        keys = chosen(empty, option.parameters)
        if option.parameters not in rows:
            rows[option.parameters] = exchange(identification_jacobian(rest, keys), poses, seed=seed).rows
        found.append(identify(replace(empty, free=keys), data, option, rows[option.parameters]))
        progress(number, len(options))
    return Method(data, data.tcp - rest.tcp, tuple(found))


def identify(model: Model, data: Measurements, option: Option, rows: Rows) -> Identified:
    """One option fitted to some rows, from the model's values. Raises `LrmError`."""
    limits = bounds_of(model, model.free) if option.physical else no_bounds(model.free)
    fitted = fit(model, data.take(rows), limits)
    return Identified(option, rows, fitted, residual_of(fitted.model, data))


def nominal_model(arm: Arm) -> Model:
    """An arm with all errors of levels 2 and 3 at zero."""
    return model_of(arm, effects_at(arm, "offsets") + effects_at(arm, "compliance"))


def residual_of(model: Model, data: Measurements) -> Array:
    """(N, 3), measured − predicted TCP (m)."""
    return np.asarray(data.tcp - equilibrium(model, data.poses).tcp)


@dataclass(frozen=True, eq=False)
class Crossed:
    """One option identified on each of two data sets, and applied to both (thesis Table 6.8).

    `residual[i][j]`: (N_j, 3), m, of the parameters identified on data set i, on data set j.
    """

    option: Option
    both: tuple[Identified, Identified]
    residual: tuple[tuple[Array, Array], tuple[Array, Array]]

    def error(self, identified_on: int, measured_on: int) -> ErrorFigures:
        """Over the poses of a data set that were not chosen there."""
        return figures(self.residual[identified_on][measured_on][self.both[measured_on].rest])


def cross(first: Method, second: Method, option: str) -> Crossed:
    """Applies the parameters of each data set to the other one. Raises `UnknownName`, `NotSettled`."""
    a, b = first.of(option), second.of(option)
    to_second = residual_of(a.fit.model, second.data)
    to_first = residual_of(b.fit.model, first.data)
    return Crossed(a.option, (a, b), ((a.residual, to_second), (to_first, b.residual)))
