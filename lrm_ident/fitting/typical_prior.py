"""The prior that every fit has by default: each parameter is about as large as the size that is declared beside it.

Offsets and compliances have a Gaussian of one typical size, the position and the attitude of the base a wide one. A
parameter of a further effect has a Cauchy distribution of three typical sizes, whose heavy tails let a large effect be
as large as the data say, while a Gaussian would hide it (Gelman et al. 2008). It is the mode of the posterior that is
fitted, by iterative reweighting: the Cauchy distribution is replaced by the Gaussian of equal slope at the estimate
(Holland & Welsch 1977). The coefficients of free forms have their penalties instead (`smoothness`), the place of the
measuring instrument has none.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lrm_ident.fitting.priors import Prior, load_prior, of_the_set_up
from lrm_math.arrays import Array
from lrm_math.effects import CATALOGUE, Effect, ParameterRef
from lrm_math.effects.reference import BASE_OFFSETS
from lrm_math.effects.tracker_errors import MeasurementFrame, TouchedBoard, TouchedPoint
from lrm_math.model.model import Model
from lrm_math.model.model_file import ModelFile

TYPICAL = "typical"
"""Name of the prior, as in a model file."""
DIMENSIONS = ("offsets", "compliance", TouchedPoint.id, TouchedBoard.id)
"""Effects that every arm has, and the place of what was touched: their parameters' prior is Gaussian."""
HELD = 1e-6
"""m, rad: standard deviation of what is a convention: the base where touched points stand anywhere, and the length that
then gives the scale."""
TOGETHER = (MeasurementFrame.id,)
"""Effects whose parameters are of one cause and have one multivariate distribution. A tracker's scale along all axes
together is an arm that is longer: tails of each axis alone would put all of it on as few axes as possible, and a wrong
choice is an arm of wrong lengths."""
EFFECT_SIZES = 3.0
"""Typical sizes, half the width at half the height of an effect's Cauchy distribution."""
FLAT = 100.0
"""Where an effect's parameter is zero, its prior is so many times wider at first."""
BASE_SD = {"mm": 0.05, "rad": 0.2}
"""m, rad: how well it is known where an arm's base stands in the tracker's frame."""


@dataclass(frozen=True, eq=False)
class TypicalPrior(Prior):
    """The default prior.

    `tail`: (P,), half width of the Cauchy distributions, SI; zero where it is Gaussian. `block`: (P,), number of the
    distribution of each parameter; those of one number have a multivariate Cauchy distribution together.
    """

    tail: Array
    block: NDArray[np.int64]

    @property
    def heavy_tailed(self) -> bool:
        """Whether some parameter's prior is no Gaussian."""
        return bool(self.tail.any())

    def reweighted(self, model: Model) -> TypicalPrior:
        """The prior with the Gaussians that have the slope of its Cauchy distributions at the values of a model."""
        value = np.array([model.value(key) for key in self.keys])
        variance = np.where(self.tail > 0.0, _equal_slope(value, self.tail, self.block), np.diag(self.covariance))
        return replace(self, covariance=np.diag(variance))


def _equal_slope(value: Array, tail: Array, block: NDArray[np.int64]) -> Array:
    """(P,), variances of the Gaussians that have the slope of multivariate Cauchy distributions at some values.

    The density of d parameters is that of Student's t with one degree of freedom, (1 + Σ v²/tail²)^(−(d + 1)/2).
    """
    scaled = np.divide(value, tail, out=np.zeros_like(value), where=tail > 0.0)
    together, count = np.bincount(block, scaled**2)[block], np.bincount(block)[block]
    return np.asarray(tail**2 * (1.0 + together) / (count + 1.0))


def typical_prior(model: Model) -> TypicalPrior:
    """The default prior of a model's free parameters, as it is at the start of a fit."""
    forms = {key for effect in model.effects if effect.is_free_form for key in effect.keys}
    keys = tuple(
        key for key in model.free if key not in forms and not of_the_set_up(key) and model.parameter(key).fixed is None
    )
    size = np.array([_size(model, key) for key in keys])
    kinds = [ParameterRef.parse(key).id for key in keys]
    tail = EFFECT_SIZES * size * [kind not in DIMENSIONS for kind in kinds]
    row_groups = [kinds.index(kind) if kind in TOGETHER else row for row, kind in enumerate(kinds)]
    block = np.array(row_groups, dtype=np.int64)
    value = np.array([model.value(key) for key in keys])
    still = np.bincount(block, value**2)[block] == 0.0
    begun = np.where(still, (FLAT * tail) ** 2, _equal_slope(value, tail, block))
    return TypicalPrior(TYPICAL, keys, np.zeros(len(keys)), np.diag(np.where(tail > 0.0, begun, size**2)), tail, block)


def _size(model: Model, key: str) -> float:
    """Typical size of a parameter (SI); wide for where the base stands."""
    parameter = model.parameter(key)
    if key == _scale_length(model):
        return HELD
    if ParameterRef.parse(key).effect == BASE_OFFSETS and any(
        isinstance(effect, TouchedPoint) for effect in model.effects
    ):
        return HELD
    return BASE_SD[parameter.unit] if ParameterRef.parse(key).effect == BASE_OFFSETS else parameter.typical


def _scale_length(model: Model) -> str | None:
    """The arm's longest length where the model was touched to points without known distances: these fit an arm of any
    scale, and the smaller it is the smaller its residual, so that one length must be held (Hollerbach et al. 2016)."""
    kinds = {effect.id for effect in model.effects}
    if TouchedPoint.id not in kinds or TouchedBoard.id in kinds:
        return None
    lengths = {
        f"offsets.joint{number}.{name}_mm": abs(value)
        for number, joint in enumerate(model.arm.joints, start=1)
        for name, value in (("a", joint.a), ("d", joint.d))
    }
    return max(lengths, key=lambda key: lengths[key])


def prior_of_file(file: ModelFile, model: Model, catalogue: tuple[type[Effect], ...] = CATALOGUE) -> Prior | None:
    """The prior that a model file was fitted with, or None. Raises `FileError`."""
    name = None if file.provenance is None else file.provenance.prior
    if name is None:
        return None
    return typical_prior(model) if name == TYPICAL else load_prior(name, model, catalogue)
