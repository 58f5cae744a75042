"""Poses to measure on the simulated arm, as a file: random, clear of everything, with and without a load."""

from __future__ import annotations

import numpy as np

from lrm_ident.design.candidate_poses import ClearanceRules, keeps_rules
from lrm_ident.report.document import ResultTable
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array

FLOOR_M = 0.03
"""Lowest z of the joints and the tip: leaves room for sag."""
MARGIN_M = 0.031
"""Between bodies; the daemon wants the 30 mm of the arm file, also after rounding to counts."""
LOAD_G = 66.3
"""The thesis's load."""


def clear_poses(arm: Arm, count: int, rng: np.random.Generator) -> Array:
    """(count, n) joint angles (rad), uniform within the limits, of those that keep clear."""
    low, high = np.array([(joint.lower, joint.upper) for joint in arm.joints]).T
    rules = ClearanceRules(MARGIN_M, 0.1, FLOOR_M)
    found = np.empty((0, arm.dof))
    while len(found) < count:
        q = rng.uniform(low, high, size=(4 * count, arm.dof))
        found = np.concatenate([found, q[keeps_rules(arm, q, rules)]])
    return found[:count]


def pose_table(arm: Arm, count: int, repeats: int, seed: int) -> str:
    """CSV: the first half without a load, the rest with `LOAD_G`; the last `repeats` are loaded poses again."""
    q = clear_poses(arm, count - repeats, np.random.default_rng([seed, 7]))
    again = np.arange(len(q) - repeats, len(q))
    rows = np.concatenate([np.arange(len(q)), again])
    number, of = np.arange(1, count + 1), rows + 1
    load = np.where(np.arange(count) < len(q) // 2, 0.0, LOAD_G)
    columns = ["pose|d", *(f"q{i + 1}_deg|.3f" for i in range(arm.dof)), "payload_g|.3f", "repeat_of|d"]
    return ResultTable(columns, list(zip(number, *np.degrees(q[rows]).T, load, of, strict=True))).csv()
