"""A small fleet: measurements of seven arms of one kind."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lrm_ident.data.measurement_file.write import csv_text
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import effects_at
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of

ARM, POSES, ARMS, ODD = "two-joint", 40, 7, 5
SOFT = "compliance.joint1.k_rad_per_Nm"


@pytest.fixture(scope="module")
def manifest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Seven two-joint arms, one of which is ten times as soft as its sisters; and one whose data are missing."""
    folder = tmp_path_factory.mktemp("fleet")
    arm = load_arm(ARM)
    effects = effects_at(arm, "offsets") + effects_at(arm, "compliance")
    lines = ["name,data,arm,batch"]
    for number in range(ARMS):
        rng = np.random.default_rng(number)
        values = {SOFT: (0.2 if number == ODD else 0.02) * (1 + 0.05 * rng.normal())}
        values["offsets.joint1.theta_rad"] = 0.03 + 0.002 * rng.normal()
        q, load = rng.uniform(-1.2, 1.2, (POSES, arm.dof)), np.where(np.arange(POSES) % 2, 0.3, 0.0)
        tcp = solve_equilibrium(model_of(arm, effects, values), poses_of(q, load)).tcp + rng.normal(0, 2e-4, (POSES, 3))
        columns = [("pose", np.arange(1.0, POSES + 1), 0), ("payload_g", load * 1e3, 1)]
        columns += [(f"q{j + 1}_deg", np.degrees(q[:, j]), 6) for j in range(arm.dof)]
        columns += [(f"{axis}_mm", tcp[:, k] * 1e3, 4) for k, axis in enumerate("xyz")]
        (folder / f"arm{number}.csv").write_text(csv_text(columns))
        lines.append(f"arm{number},arm{number}.csv,{ARM},{'AB'[number % 2]}")
    path = folder / "manifest.csv"
    path.write_text("\n".join([*lines, f"gone,gone.csv,{ARM},A"]) + "\n")
    return path
