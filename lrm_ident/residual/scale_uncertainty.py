"""Scale of the tracker that poses leave open: along all axes together it looks like longer links of the arm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_math.effects import EffectRef, ParameterRef
from lrm_math.effects.tracker_errors import FRAME_TYPICAL, DepthScale, MeasurementFrame

HALF = 0.5
"""Share of its variance that the scale must owe to the lengths for a known length to decide it."""

ALONG_ONE_DIRECTION = (
    "taken as right across that direction: no pose distinguishes a scale along all axes together from longer links. "
    "A known length does: measure some distances, too (distance_mm), with a string or a ball bar."
)
"""What an error of depth alone supposes."""


@dataclass(frozen=True)
class ScaleUncertainty:
    """Standard errors of the tracker's scale along all axes together.

    `sd`: its own, a ratio. `at_tip`: of the deployed tip (m), RMS over the measured poses about their centre.
    """

    sd: float
    at_tip: float

    @property
    def sentence(self) -> str:
        """What stays open, and what would decide it."""
        return (
            f"known to ± {1e3 * self.sd:.2g} mm/m along all axes together, ± {1e3 * self.at_tip:.2g} mm at the "
            f"deployed tip. That is mostly its prior (typical: {1e3 * FRAME_TYPICAL:.2g} mm/m): a worse tracker may "
            "err by more. No pose distinguishes it from longer links. A known length does: measure some distances, too "
            "(distance_mm), with a string or a ball bar."
        )


def scale_uncertainty(fitted: Fit) -> ScaleUncertainty | None:
    """The scale of a model with a distorted tracker, where its lengths being uncertain makes it so; else None."""
    free = [*map(ParameterRef.parse, fitted.model.free)]
    scales = [row for row, one in enumerate(free) if one.id == MeasurementFrame.id and one.name.startswith("scale_")]
    lengths = [
        row for row, one in enumerate(free) if one.id == "offsets" and one.place != "base" and one.name.endswith("_mm")
    ]
    if not scales or not lengths:
        return None
    mean = np.isin(np.arange(len(free)), scales) / len(scales)
    by_length, known = (fitted.covariance @ mean)[lengths], fitted.covariance[np.ix_(lengths, lengths)]
    variance = float(mean @ fitted.covariance @ mean)
    owed = float(by_length @ np.linalg.pinv(known, hermitian=True) @ by_length)
    if variance <= 0.0 or owed < HALF * variance:
        return None
    apart = fitted.equilibrium.true_tcp - fitted.equilibrium.true_tcp.mean(axis=0)
    return ScaleUncertainty(variance**0.5, (variance * float((apart**2).sum(axis=1).mean())) ** 0.5)


def scale_sentence(fitted: Fit) -> str:
    """What stays open of a tracker's scale; empty where nothing does."""
    if any(effect.id == DepthScale.id for effect in fitted.model.effects):
        return ALONG_ONE_DIRECTION
    found = scale_uncertainty(fitted)
    return "" if found is None else found.sentence


def scale_caveat(added: str, fitted: Fit) -> str:
    """The sentence of the scale that a step leaves open which adds a tracker's scale; empty for others."""
    of_scale = added and EffectRef.parse(added).id in (DepthScale.id, MeasurementFrame.id)
    return scale_sentence(fitted) if of_scale else ""
