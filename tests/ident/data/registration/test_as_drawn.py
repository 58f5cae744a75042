"""Positions that a program computed from the drawing, taken for measured ones: the fit to them would look perfect."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lrm_ident.data.registration.checked import load_checked
from lrm_math.arm.arm_file import load_arm
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of


@pytest.mark.parametrize(("error_mm", "said"), [(0.0, True), (0.3, False)])
def test_positions_of_the_arm_as_drawn_are_doubted(tmp_path: Path, error_mm: float, said: bool) -> None:
    arm, rng = load_arm("lrm-lab"), np.random.default_rng(2)
    q = rng.uniform(-0.7, 0.7, (40, arm.dof))
    tcp = 1e3 * solve_equilibrium(model_of(arm, ()), poses_of(q)).tcp + rng.normal(0.0, 1.0, (40, 3)) * error_mm
    header = ",".join([*(f"q{joint}_deg" for joint in range(1, arm.dof + 1)), "x_mm,y_mm,z_mm"])
    rows = np.round(np.concatenate([np.degrees(q), tcp], axis=1), 4)
    path = tmp_path / "data.csv"
    path.write_text("\n".join([header, *(",".join(map(str, row)) for row in rows.tolist())]) + "\n")
    doubts = [one for one in load_checked(path, arm).source.notices if "as drawn" in one]
    assert bool(doubts) is said
