"""Gaussian priors of the parameters (thesis Eq 2.66), from a file or from typical sizes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.effects import CATALOGUE, FREE_FORMS, Effect, Parameter, ParameterRef
from lrm_math.effects.measured_range import MeasuredRange
from lrm_math.effects.tracker_errors import Anchor
from lrm_math.errors import FileError, LrmError, UnknownName, name_suggestion
from lrm_math.model.covariance import CovarianceTable, correlation_matrix
from lrm_math.model.model import Model
from lrm_math.toml_file import StrictSchema, read_toml


class GaussianTable(StrictSchema):
    """`mean` and standard deviation `sd` of a parameter, in the unit of its key.

    Of a fleet also: the 95 % interval of the mean, the `spread` between arms with its interval, how many `arms`.
    """

    mean: float = 0.0
    sd: Annotated[float, Field(gt=0)]
    mean_interval: list[float] | None = None
    spread: float | None = None
    spread_interval: list[float] | None = None
    arms: int | None = None


class EffectRateTable(StrictSchema):
    """Rate of an effect among arms of a kind: `rate` (0 to 1) with its 95 % interval, found in so many of `arms`."""

    rate: Annotated[float, Field(gt=0, lt=1)]
    interval: list[float] | None = None
    found: float | None = None
    arms: int | None = None


class PriorFile(StrictSchema):
    """Prior file, schema `lrm/prior/1`.

    `[parameters]`: keys `effect.place.name_unit`, `*` and `?` allowed; the last matching key applies.
    `other_sd`: standard deviation, in typical sizes of the effect, of every parameter that no key matches.
    `[covariance]`: correlations of some of the parameters named in full; all others are independent.
    `[effects]`: how often an effect (`id@place`) is there; `other_rate`: every other one.
    """

    schema_: Literal["lrm/prior/1"] = Field(alias="schema")
    name: str
    source: str = ""
    other_sd: Annotated[float, Field(gt=0)] = 1.0
    parameters: dict[str, GaussianTable] = {}
    covariance: CovarianceTable | None = None
    effects: dict[str, EffectRateTable] = {}
    other_rate: Annotated[float, Field(gt=0, lt=1)] | None = None


@dataclass(frozen=True, eq=False)
class Prior:
    """Multivariate normal distribution of the parameters `keys`: `mean` (P,) and `covariance` (P, P), SI.

    Of an earlier fit it also has the error that this left, standard deviation per axis `noise` (m), and the range
    `within` that its poses had: a few new poses cannot tell either. None: not known, and estimated from the new poses.
    """

    name: str
    keys: tuple[str, ...]
    mean: Array
    covariance: Array
    noise: float | None = field(default=None, kw_only=True)
    within: MeasuredRange | None = field(default=None, kw_only=True)

    @property
    def heavy_tailed(self) -> bool:
        """Whether `reweighted` changes it."""
        return False

    def reweighted(self, model: Model) -> Prior:
        """The prior for the next iterations of a fit that has come to a model: a Gaussian stays as it is."""
        return self

    def mean_of(self, keys: Sequence[str]) -> Array:
        """(K,), means, SI. Raises `UnknownName`."""
        return self.mean[self._places(keys)]

    def sd_of(self, keys: Sequence[str]) -> Array:
        """(K,), standard deviations, SI. Raises `UnknownName`."""
        return np.asarray(np.sqrt(np.diag(self.covariance_of(keys))))

    def covariance_of(self, keys: Sequence[str]) -> Array:
        """(K, K), covariance, SI, the other parameters marginalised. Raises `UnknownName`."""
        places = self._places(keys)
        return self.covariance[np.ix_(places, places)]

    def _places(self, keys: Sequence[str]) -> list[int]:
        """Positions of parameters in the prior. Raises `UnknownName`."""
        place = {key: number for number, key in enumerate(self.keys)}
        for key in keys:
            if key not in place:
                raise UnknownName("parameter of the prior", key, self.keys)
        return [place[key] for key in keys]


@dataclass(frozen=True)
class EffectRates:
    """Rates of effects among arms of a kind: `named` by `effect@place`, and `other` for each that is not named."""

    named: Mapping[str, float]
    other: float

    def weights(self, names: Sequence[str]) -> dict[str, float]:
        """Weights of p values in proportion to the rates, of mean one (Genovese, Roeder & Wasserman 2006).

        Dividing p values by them keeps the error rate of all tests together, whether the rates are right or not.
        """
        rates = np.array([self.named.get(name, self.other) for name in names])
        return dict(zip(names, (rates / rates.mean()).tolist(), strict=True)) if names else {}


def load_rates(name_or_path: str) -> EffectRates | None:
    """The rates of effects in a prior file; None if it has none. Raises `FileError`."""
    file = read_toml(_prior_path(name_or_path), PriorFile)
    if not file.effects:
        return None
    named = {name: table.rate for name, table in file.effects.items()}
    return EffectRates(named, min(named.values()) if file.other_rate is None else file.other_rate)


def shipped_priors() -> dict[str, Path]:
    """Paths of the shipped priors by name."""
    here = Path(__file__).resolve()
    folders = [here.with_name("prior_files"), here.parents[2] / "config" / "priors"]
    return {path.stem: path for folder in folders for path in sorted(folder.glob("*.toml"))}


def load_prior(name_or_path: str, model: Model, catalogue: tuple[type[Effect], ...] = CATALOGUE) -> Prior:
    """The prior of all parameters of a model that can be fitted (see `to_prior`).

    Raises `FileError`: no such prior, a fault in its file, or a key that fits no parameter of any effect on this arm.
    """
    path = _prior_path(name_or_path)
    return to_prior(path, read_toml(path, PriorFile), model, catalogue)


def _prior_path(name_or_path: str) -> Path:
    """Path of a prior file. Raises `FileError`."""
    shipped = shipped_priors()
    path = shipped.get(name_or_path, Path(name_or_path))
    if not path.exists() and path.suffix != ".toml":
        right = f"give the path of a prior file, or one of: {', '.join(sorted(shipped))}"
        raise FileError(name_or_path, "", "no such prior", right)
    return path


def to_prior(path: Path, file: PriorFile, model: Model, catalogue: tuple[type[Effect], ...] = CATALOGUE) -> Prior:
    """Applies a prior file to the parameters of a model; SI units. Raises `FileError`.

    Patterns match all parameters but shapes; a shape parameter has a prior only where the file has its whole key. The
    anchor of measured distances has none, since it is no property of the arm.
    """
    possible_keys = set(model.keys) | _possible_keys(model.arm, (*catalogue, *FREE_FORMS))
    for pattern in file.parameters:
        if not any(fnmatchcase(key, pattern) for key in possible_keys):
            raise FileError(
                path, "parameters", f"'{pattern}' fits no parameter", name_suggestion(pattern, sorted(possible_keys))
            )
    every = [keyed for keyed in zip(model.keys, model.parameters, strict=True) if not of_the_set_up(keyed[0])]
    named = [(key, p) for key, p in every if p.fixed is None or key in file.parameters]
    means, sds = np.array([_gaussian(file, key, parameter) for key, parameter in named]).T
    keys = tuple(key for key, _ in named)
    return Prior(file.name, keys, means, _correlations(path, file, keys) * np.outer(sds, sds))


WEAK = "vague"
"""Name of the shipped prior that is equal to `weak_prior`."""
WEAK_SD = 3.0  # typical sizes


def of_the_set_up(key: str) -> bool:
    """Whether a parameter belongs to the measuring set-up, not to the arm."""
    return ParameterRef.parse(key).id == Anchor.id


def weak_prior(model: Model) -> Prior:
    """The shipped prior `vague` for the free parameters: a Gaussian of three typical sizes about zero."""
    typical = [model.parameter(key).typical for key in model.free]
    return Prior(WEAK, model.free, np.zeros(len(typical)), np.diag((WEAK_SD * np.array(typical)) ** 2))


def with_range_priors(prior: Prior | None, model: Model, shapes: Sequence[str]) -> Prior:
    """A prior extended by shape parameters that it lacks: independent Gaussians with the mean and the variance of a
    uniform distribution over the range in which each is searched."""
    stated = Prior("ranges", (), np.empty(0), np.empty((0, 0))) if prior is None else prior
    keys = tuple(key for key in shapes if key not in stated.keys)
    ends = np.array([(min(scan), max(scan)) for scan in (model.parameter(key).scan for key in keys)]).reshape(-1, 2)
    covariance = np.diag(np.append(np.zeros(len(stated.keys)), np.ptp(ends, axis=1) ** 2 / 12.0))
    covariance[: len(stated.keys), : len(stated.keys)] = stated.covariance
    return Prior(stated.name, (*stated.keys, *keys), np.append(stated.mean, ends.mean(axis=1)), covariance)


def prior_name_for(name_or_path: str) -> str:
    """Name of a shipped prior, or absolute path of a prior file, for the provenance of a model file."""
    return name_or_path if name_or_path in shipped_priors() else Path(name_or_path).resolve().as_posix()


def _gaussian(file: PriorFile, key: str, parameter: Parameter) -> tuple[float, float]:
    """Mean and standard deviation of a parameter, SI."""
    matching = [table for pattern, table in file.parameters.items() if fnmatchcase(key, pattern)]
    if not matching:
        return 0.0, file.other_sd * parameter.typical
    return matching[-1].mean * parameter.si, matching[-1].sd * parameter.si


def _correlations(path: Path, file: PriorFile, keys: Sequence[str]) -> Array:
    """(P, P), correlations of the parameters `keys`. Raises `FileError`."""
    correlation = np.eye(len(keys))
    if file.covariance is None:
        return correlation
    for key in file.covariance.keys:
        if key not in file.parameters:
            raise FileError(path, "covariance", f"'{key}' is not in [parameters]", "a key with mean and sd there")
    try:
        given = correlation_matrix(file.covariance)
        np.linalg.cholesky(given)
    except (LrmError, np.linalg.LinAlgError) as error:
        what = str(error) if isinstance(error, LrmError) else "some combination of parameters has no variance"
        raise FileError(path, "covariance", what) from None
    there = [(row, keys.index(key)) for row, key in enumerate(file.covariance.keys) if key in keys]
    rows, places = [row for row, _ in there], [place for _, place in there]
    correlation[np.ix_(places, places)] = given[np.ix_(rows, rows)]
    return correlation


def _possible_keys(arm: Arm, catalogue: Iterable[type[Effect]]) -> set[str]:
    """Keys of all parameters of all effects on an arm, also of the dimension `extra_z` where its links lack it."""
    arm = replace(arm, joints=tuple(replace(joint, extra_z=joint.extra_z or 0.0) for joint in arm.joints))
    return {key for kind in catalogue for place in kind.places(arm) for key in kind(arm, place).keys}
