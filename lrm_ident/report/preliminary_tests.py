"""What people and machines read of the preliminary tests."""

from __future__ import annotations

from typing import Any

import numpy as np
from rich.console import Console

from lrm_ident.data.servo_stiffness import Stiffness
from lrm_ident.data.tracker_alignment import Alignment
from lrm_ident.report.fit import table

SURE, SIGNIFICANT = 2.0, 0.01


def print_stiffness(console: Console, found: Stiffness) -> None:
    """Slope, linearity, loop, and the line for a prior file."""
    torque = found.test.torque
    out = table(f"{len(torque)} readings, {torque.min():.2f} to {torque.max():.2f} N·m", "", ">value", "")
    low, high = min(found.secants), max(found.secants)
    out.add_row("slope (compliance)", f"{found.slope:.4f} ± {found.slope_error:.4f}", "rad/Nm")
    out.add_row("slopes between neighbouring loads", f"{low:.4f} to {high:.4f}", "rad/Nm")
    out.add_row("largest departure from the line", f"{100 * found.departure:.1f}", "% of the deflection")
    if found.loop is not None and found.loop_error is not None:
        out.add_row("loop, unloading above loading", f"{_deg(found.loop):.3f} ± {_deg(found.loop_error):.3f}", "deg")
    out.add_row("scatter of a reading", f"{_deg(found.scatter):.3f}", "deg")
    console.print(out)
    for line in verdicts(found):
        console.print(line)
    mean, sd = prior_line(found)
    console.print("For a prior file, if this servo drives joint N (wide, as printed parts give way too):", style="bold")
    console.print(f'  "compliance.jointN.k_rad_per_Nm" = {{ mean = {mean:.4f}, sd = {sd:.4f} }}', highlight=False)


def verdicts(found: Stiffness) -> list[str]:
    """Linear or not, a loop or not, in words."""
    if found.curvature_p is None:
        linear = "Too few readings to tell whether the spring is linear."
    elif found.curvature_p < SIGNIFICANT:
        linear = f"The spring is not linear (p = {found.curvature_p:.1g}): look for nonlinear_stiffness or backlash."
    else:
        linear = f"Nothing shows that the spring is not linear (p = {found.curvature_p:.2g})."
    if found.loop is None or found.loop_error is None:
        return [linear, "It was never unloaded: whether there is play or friction cannot be told."]
    if found.loop < SURE * found.loop_error:
        return [linear, f"No loop wider than {_deg(found.loop + SURE * found.loop_error):.2f} deg."]
    return [linear, "It does not come back the way it went: play or friction; look for backlash and hysteresis."]


def prior_line(found: Stiffness) -> tuple[float, float]:
    """Mean and SD (rad/N·m) for the prior of a joint that this servo drives.

    A joint is softer than its servo: on the thesis's arm two to four times (Table 6.1 against Figure 5.7). So the SD is
    twice the slope, however well the slope is known.
    """
    return found.slope, 2.0 * found.slope


def stiffness_json(found: Stiffness) -> dict[str, Any]:
    """Result of `lrm-ident stiffness`, schema `lrm/stiffness/1`."""
    return {
        "schema": "lrm/stiffness/1",
        "readings": len(found.test.torque),
        "k_rad_per_Nm": {"value": found.slope, "se": found.slope_error},
        "secants_rad_per_Nm": list(found.secants),
        "departure_from_line": found.departure,
        "curvature_p_value": found.curvature_p,
        "loop_rad": None if found.loop is None else {"value": found.loop, "se": found.loop_error},
        "scatter_rad": found.scatter,
        "verdict": verdicts(found),
    }


def print_alignment(console: Console, found: Alignment) -> None:
    """The deviation of the targets, axis by axis."""
    out = table(f"{found.readings} readings of the fixture", "axis", ">deviation mm", ">± standard error", ">noise mm")
    for axis, *values in zip("xyz", found.deviation, found.error, found.noise, strict=True):
        deviation, error, noise = (f"{value * 1e3:.3f}" for value in values)
        out.add_row(axis, deviation, f"± {error}", noise)
    console.print(out)
    console.print(f"For the file beside the measurements: noise_sd_mm = {_noise_mm(found):.3f}", highlight=False)


def alignment_json(found: Alignment) -> dict[str, Any]:
    """Result of `lrm-ident align`, schema `lrm/alignment/1`."""
    return {
        "schema": "lrm/alignment/1",
        "readings": found.readings,
        "deviation_mm": (found.deviation * 1e3).tolist(),
        "standard_error_mm": (found.error * 1e3).tolist(),
        "noise_sd_mm": (found.noise * 1e3).tolist(),
    }


def _noise_mm(found: Alignment) -> float:
    return float(np.sqrt(np.mean(found.noise**2))) * 1e3


def _deg(radians: float) -> float:
    return float(np.degrees(radians))
