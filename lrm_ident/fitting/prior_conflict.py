"""Prior–data conflict (Evans & Moshonov 2006): dimensions that the poses determine far from those of the arm file."""

from __future__ import annotations

from lrm_ident.fitting.levenberg_marquardt import Fit
from lrm_math.effects.reference import BASE_OFFSETS, ParameterRef

UNUSUAL = 3.0
"""Typical sizes of a dimension's error: where nothing is hidden, the largest of a simulated arm is below 1.3, that of
the rig 0.8; with one hidden effect 2 of 40 arms have a larger one."""
DETERMINED = 0.5  # share of the prior's variance that the poses remove


def unusual_dimensions(fit: Fit) -> tuple[str, ...]:
    """Keys of the dimensions of links and tool that differ from the arm file by more than `UNUSUAL` typical sizes.

    Where the base stands is not of the arm file. A dimension that the poses do not determine is as its prior is.
    """
    model, told = fit.model, fit.told
    return tuple(
        key
        for row, key in enumerate(model.free)
        if (ref := ParameterRef.parse(key)).id == "offsets"
        and ref.effect != BASE_OFFSETS
        and abs(model.value(key)) > UNUSUAL * model.parameter(key).typical
        and not told[row] < DETERMINED
    )
