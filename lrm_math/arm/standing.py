"""Whether an arm can stand where its encoders say that it stands, asked before it is driven."""

from __future__ import annotations

import numpy as np

from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.errors import LrmError

FAR = float(np.radians(20.0))
"""rad beyond a limit: no zero that was set by hand is off by so much."""


def beyond_limits(arm: Arm, angles: Array) -> Array:
    """(…, n), how far angles (…, n) are beyond the nearer limit of their joint (rad); negative within the limits."""
    low, high = np.array([(joint.lower, joint.upper) for joint in arm.joints]).T
    return np.asarray(np.maximum(low - angles, angles - high))


def require_standing(arm: Arm, angles: Array) -> None:
    """Raises `LrmError`: an encoder reads no number, or an angle (n,), rad, so far beyond the limits that zeros differ.

    A seam, zeros of another convention, another unit or another arm show so before anything moves.
    """
    beyond = beyond_limits(arm, angles)
    for number, (joint, at, far) in enumerate(zip(arm.joints, angles.tolist(), beyond.tolist(), strict=True), 1):
        name = joint.name or f"joint {number}"
        if not np.isfinite(at):
            raise LrmError(f"{name}: its encoder reads {at}; should be an angle")
        if far > FAR:
            at, far, low, high = np.degrees([at, far, joint.lower, joint.upper])
            what = f"{name} stands at {at:.0f} deg by its encoder, {far:.0f} deg beyond its limits in {arm.name}"
            right = "calibrate it anew about the zeros of the arm file, or correct limits_deg"
            raise LrmError(f"{what} ({low:.0f} to {high:.0f} deg): are these its zeros, its unit and its arm? {right}")
