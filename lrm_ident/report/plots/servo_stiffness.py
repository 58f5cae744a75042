"""Figure of `stiffness`: deflection of one servo, loading and unloading (thesis Figure 5.7, left)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lrm_ident.data.servo_stiffness import StiffnessEstimate
from lrm_ident.data.wording import quantity
from lrm_ident.report.plots.style import HELD_OUT, MODEL, figure_file, finish


def draw_stiffness(estimate: StiffnessEstimate, path: Path) -> None:
    """Readings, the line, and what departs from it. Raises `FileError` for an unknown format or place."""
    test = estimate.test
    line = estimate.offset + estimate.slope * test.torque
    ends = np.array([test.torque.min(), test.torque.max()])
    with figure_file(path, 10, 4) as figure:
        left, right = figure.subplots(1, 2, width_ratios=(1.3, 1))
        left.plot(ends, np.degrees(estimate.offset + estimate.slope * ends), color="black", linewidth=1, label="line")
        branches = (test.loading, "loading", "o", MODEL), (~test.loading, "unloading", "^", HELD_OUT)
        for branch, name, marker, colour in branches:
            if branch.any():
                left.plot(test.torque[branch], np.degrees(test.angle[branch]), marker, color=colour, label=name)
                right.plot(test.torque[branch], np.degrees(test.angle - line)[branch], marker, color=colour, label=name)
        right.axhline(0, color="black", linewidth=0.8)
        compliance = f"Compliance {quantity(estimate.slope, estimate.slope_error)} rad/N·m, ± one SE"
        finish(left, "torque, N·m", "deflection, deg", compliance)
        finish(right, "torque, N·m", "departure from the line, deg", "Departure from the line: loop and curvature")
