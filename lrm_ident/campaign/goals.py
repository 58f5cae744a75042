"""Goals of a verification: drawn by a seed, or from a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lrm_ident.campaign.verification import draw_goals
from lrm_ident.data.csv_table import read_csv
from lrm_ident.design.candidate_poses import ClearanceRules, violated_rules
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import MM
from lrm_math.arrays import Array

RULES = ClearanceRules(0.035, 0.1, 0.05)
"""Of the angles that goals are drawn from: a little more than the daemon wants."""


def goals_named(text: str, arm: Arm, seed: int) -> Array:
    """(N, 3), goals in m: as many random ones, or those of a CSV with `x_mm, y_mm, z_mm`. Raises `LrmError`."""
    if text.isdecimal() and 0 < int(text) <= 1000:
        return draw_goals(arm, int(text), seed, lambda q: ~np.any([*violated_rules(arm, q, RULES).values()], axis=0))
    table = read_csv(Path(text), ["x_mm", "y_mm", "z_mm"])
    return np.stack([table.numbers(name) for name in ("x_mm", "y_mm", "z_mm")], axis=1) * MM
