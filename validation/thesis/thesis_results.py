"""Published results of Conenna 2024: errors (Tables 6.4 to 6.8) and identified parameters (Tables B.1 and B.2)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from lrm_ident.fitting.model_fit import nominal_model
from lrm_ident.fitting.parameter_sets import TABLE_4_5
from lrm_math.arm.arm import Arm
from lrm_math.errors import UnknownName
from lrm_math.model.model import Model, model_of

OPTION_NAMES = ("option1", "option2", "option3", "option4", "option5", "option1_2", "option3_2")
NOMINAL = "nominal"

PARAMETERS = """
α2  -6.12e-3 -7.26e-3        0 -2.66e-3       0 -4.69e-3       0 | -6.30e-3 -6.64e-3       0 -3.10e-3       0
α3   1.32e-2  1.77e-2        0  1.59e-2       0  1.65e-2       0 |  1.33e-2  1.74e-2       0  1.52e-2       0
α4   8.71e-3  1.22e-2        0  1.90e-3       0 -2.03e-3       0 |  7.60e-3  1.00e-2       0  3.52e-4       0
α5  -2.82e-2 -1.23e-1        0 -3.79e-5       0  1.74e-2       0 | -4.07e-2 -1.25e-1       0 -2.39e-2       0
k0   1.93e-2        0  2.23e-2        0       0  1.81e-2 2.40e-2 |  2.09e-2        0 2.29e-2        0       0
k1   7.57e-2        0  7.76e-2  7.88e-2 9.32e-2  7.71e-2 7.75e-2 |  7.11e-2        0 7.36e-2  7.34e-2 8.85e-2
k2   6.70e-2        0  8.24e-2  8.66e-2 9.55e-2  7.25e-2 8.04e-2 |  5.96e-2        0 7.45e-2  7.73e-2 8.70e-2
k3   7.68e-2        0  9.32e-2  8.94e-2 1.14e-1  8.22e-2 9.05e-2 |  6.56e-2        0 8.16e-2  7.88e-2 9.83e-2
k4   1.24e-1        0  1.48e-1  1.27e-1 1.41e-1  1.21e-1 1.40e-1 |  1.14e-1        0 1.35e-1  1.19e-1 1.32e-1
k5   1.04e-1        0 -4.84e-3  3.69e-1 5.42e-1  2.17e-1 9.51e-2 |  1.29e-1        0 3.06e-2  3.83e-1 5.58e-1
k6  -7.40e-3        0  6.27e-1  1.96e-1 6.23e-1  8.06e-3 5.08e-1 |  1.20e-1        0 4.39e-1  1.92e-1 5.09e-1
a3   1.27e-1 -6.87e-1        0 -2.82e-2       0  4.87e-1       0 | -8.26e-2    -1.08       0 -8.53e-2       0
a4     -5.34     3.31        0    -2.19       0    -3.85       0 |    -5.75     4.93       0    -1.63       0
a5   4.09e-2 -6.71e-1        0 -1.22e-1       0  2.60e-2       0 |  1.15e-1 -8.21e-1       0 -2.80e-1       0
θ1  -3.45e-3 -1.87e-2        0 -5.70e-3       0 -4.82e-3       0 | -2.78e-3 -2.02e-2       0 -5.43e-3       0
θ2  -2.32e-2 -1.30e-2        0 -2.30e-2       0 -2.44e-2       0 | -2.34e-2 -1.43e-2       0 -2.29e-2       0
θ3  -2.96e-3  5.30e-4        0  5.42e-4       0 -1.86e-3       0 | -5.71e-3 -5.11e-4       0 -7.42e-4       0
θ4  -1.11e-2  3.62e-2        0  3.65e-3       0 -3.81e-3       0 | -1.45e-2  4.35e-2       0  5.50e-3       0
θ5  -2.32e-2 -4.92e-2        0 -1.94e-2       0 -2.56e-2       0 | -1.52e-2 -5.27e-2       0 -1.04e-2       0
θ6  -1.83e-2 -4.27e-2        0 -2.43e-2       0 -2.65e-2       0 | -2.05e-2 -4.57e-2       0 -2.49e-2       0
d4     -1.66    -2.45        0  2.73e-1       0  5.84e-1       0 |    -1.49    -2.06       0  5.75e-1       0
d5     -1.90  7.48e-1        0    -1.42       0    -1.79       0 |    -1.77  7.24e-1       0    -1.45       0
xb     -1.24     3.96        0     1.52       0 -2.07e-1       0 |    -1.70     4.20       0     1.46       0
yb     -1.30  4.70e-1        0    -1.23       0    -1.40       0 |    -1.11  8.86e-1       0    -1.00       0
zb     -5.31    -25.9        0    -6.44       0    -4.78       0 |    -5.43    -29.4       0    -7.43       0
yt     -2.64    -7.86        0 -5.54e-3       0  5.28e-1       0 |    -3.54    -7.87       0    -1.24       0
zt      1.55 -6.47e-1        0     1.39       0     1.51       0 |     1.60 -6.58e-1       0     1.42       0
dd2     4.70        0        0     2.64       0     3.73       0 |     4.81        0       0     2.92       0
"""
"""Tables B.1 | B.2: identified parameters in the order and units of `TABLE_4_5`, a column per option."""


@dataclass(frozen=True)
class PublishedError:
    """Mean, maximum and standard deviation of the error (mm)."""

    mean_mm: float
    max_mm: float
    sd_mm: float


@dataclass(frozen=True)
class Campaign:
    """One of the thesis's two measurement campaigns, of 393 poses each.

    Attributes:
        parameters: option -> key -> nonzero value in the unit of the key.
        on_all, on_rest: errors by option, over all poses and over the 343 validation poses.
    """

    name: str
    payload_g: float
    parameters: Mapping[str, Mapping[str, float]]
    on_all: Mapping[str, PublishedError]
    on_rest: Mapping[str, PublishedError]

    def model(self, arm: Arm, option: str) -> Model:
        """The model of an arm with a published parameter vector. Raises `UnknownName`."""
        if option not in self.parameters:
            raise UnknownName(f"option of the campaign {self.name}", option, self.parameters)
        empty = nominal_model(arm)
        values = {k: v * empty.parameter(k).si for k, v in self.parameters[option].items()}
        return model_of(arm, empty.effects, values)


def _campaign(name: str, payload_g: float, table: int, errors: str) -> Campaign:
    """`table`: side of `PARAMETERS`; `errors`: mean, maximum, SD over all poses, then over the validation poses."""
    columns = zip(*(line[4:].split("|")[table].split() for line in PARAMETERS.strip().splitlines()), strict=True)
    parameters = {
        option: {key: float(value) for key, value in zip(TABLE_4_5, column, strict=True) if float(value) != 0.0}
        for option, column in zip(OPTION_NAMES, columns, strict=False)
    }
    rows = {option: list(map(float, cells)) for option, *cells in map(str.split, errors.strip().splitlines())}
    on_all, on_rest = ({option: PublishedError(*row[i : i + 3]) for option, row in rows.items()} for i in (0, 3))
    return Campaign(name, payload_g, parameters, on_all, on_rest)


NO_LOAD = _campaign(
    "no-load",
    0.0,
    0,
    """
nominal   28.7 57.3 12.3  28.7 57.3 12.3
option1   5.42 16.4 2.59  5.51 16.4 2.64
option2   16.9 36.4 6.05  17.1 36.4 6.12
option3   9.92 30.0 5.26  9.80 30.0 5.38
option4   6.50 16.4 3.46  6.78 16.4 3.52
option5   10.9 26.0 5.25  11.0 26.0 5.29
option1_2 5.54 15.6 2.49  5.64 15.6 2.55
option3_2 9.80 29.5 5.26  9.70 29.5 5.39""",
)
LOADED = _campaign(
    "loaded",
    66.3,
    1,
    """
nominal 32.9 66.3 13.8  32.9 66.3 13.8
option1 5.65 14.1 2.65  5.77 14.1 2.72
option2 19.0 38.4 6.81  19.2 38.4 6.92
option3 10.0 30.1 5.49  9.95 30.1 5.60
option4 6.97 18.3 4.01  7.26 18.3 4.09
option5 11.4 28.1 5.77  11.5 28.1 5.86""",
)

TABLE_6_8 = {
    ("no-load", "no-load"): (5.64, 15.6),
    ("no-load", "loaded"): (6.14, 13.7),
    ("loaded", "no-load"): (5.50, 17.4),
    ("loaded", "loaded"): (5.77, 14.1),
}
"""(identified on, measured on) -> mean and maximum error (mm); option 1₂ without load, option 1 with it."""


def campaign_named(name: str) -> Campaign:
    """The campaign of that name. Raises `UnknownName`."""
    by_name = {campaign.name: campaign for campaign in (NO_LOAD, LOADED)}
    if name not in by_name:
        raise UnknownName("campaign of the thesis", name, list(by_name))
    return by_name[name]
