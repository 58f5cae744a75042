"""Scale of the tracker that poses leave open: along all axes together it looks like longer links of the arm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_math.effects import EffectRef, ParameterRef
from lrm_math.effects.tracker_errors import DepthScale, MeasurementFrame

HALF = 0.5
"""Share of its variance that the scale must owe to the lengths for a known length to decide it."""


@dataclass(frozen=True)
class ScaleUncertainty:
    """Standard errors of the tracker's scale along all axes together.

    `sd`: its own, a ratio. `at_tip`: of the deployed tip (m), RMS over the measured poses about their centre. Both None
    where it is not estimated: an error of depth alone supposes that the scale across that direction is right.
    """

    sd: float | None = None
    at_tip: float | None = None


def scale_uncertainty(fitted: Fit) -> ScaleUncertainty | None:
    """The scale of a model with a distorted tracker, where its lengths being uncertain makes it so; else None."""
    if any(effect.id == DepthScale.id for effect in fitted.model.effects):
        return ScaleUncertainty()
    free = [*map(ParameterRef.parse, fitted.model.free)]
    scales = [
        row
        for row, parameter in enumerate(free)
        if parameter.id == MeasurementFrame.id and parameter.name.startswith("scale_")
    ]
    lengths = [
        row
        for row, parameter in enumerate(free)
        if parameter.id == "offsets" and parameter.place != "base" and parameter.name.endswith("_mm")
    ]
    if not scales or not lengths:
        return None
    mean = np.isin(np.arange(len(free)), scales) / len(scales)
    by_length, of_lengths = (fitted.covariance @ mean)[lengths], fitted.covariance[np.ix_(lengths, lengths)]
    variance = float(mean @ fitted.covariance @ mean)
    owed = float(by_length @ np.linalg.pinv(of_lengths, hermitian=True) @ by_length)
    if variance <= 0.0 or owed < HALF * variance:
        return None
    return ScaleUncertainty(variance**0.5, variance**0.5 * distance_from_centre(fitted))


def distance_from_centre(fitted: Fit) -> float:
    """RMS distance of the measured tips from their centre (m): what a scale of the tracker costs, by its error."""
    apart = fitted.equilibrium.true_tcp - fitted.equilibrium.true_tcp.mean(axis=0)
    return float((apart**2).sum(axis=1).mean() ** 0.5)


def scale_left_open(added: str, fitted: Fit) -> ScaleUncertainty | None:
    """The scale that a step leaves open which adds a tracker's scale; None for others."""
    of_scale = added and EffectRef.parse(added).id in (DepthScale.id, MeasurementFrame.id)
    return scale_uncertainty(fitted) if of_scale else None
