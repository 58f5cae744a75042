"""The first pose of a file: from which side the joints came to it is not known unless it is stated."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import lrm_ident as lrm
from lrm_ident.report.diagnosis.diagnosis import diagnosis_document
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import effects_at
from lrm_math.model.model import model_of

SAID = "The direction of approach of pose 1 is not known"


@pytest.mark.slow
@pytest.mark.parametrize("stated", [False, True])
def test_a_first_pose_that_came_from_nowhere_is_said_where_it_is_far_off(stated: bool, tmp_path: Path) -> None:
    arm, rng = load_arm("so101"), np.random.default_rng(5)
    ranges = np.degrees([(joint.lower, joint.upper) for joint in arm.joints])
    q = rng.uniform(*0.7 * ranges.T, (81, arm.dof)).round(2)
    names = ",".join(f"q{number}_deg" for number in range(1, arm.dof + 1))
    np.savetxt(tmp_path / "poses.csv", q, "%.2f", ",", header=names, comments="")
    effects = [each for name in ("offsets", "hysteresis@joint2") for each in effects_at(arm, name)]
    truth = model_of(arm, effects, {"offsets.joint3.theta_rad": 0.02, "hysteresis.joint2.h_rad": -0.012})
    tcp = 1e3 * lrm.predict(truth, lrm.load_poses(tmp_path / "poses.csv", arm)) + rng.normal(0.0, 0.2, (81, 3))
    header = f"{names},x_mm,y_mm,z_mm"
    np.savetxt(tmp_path / "data.csv", np.column_stack([q, tcp])[1:], "%.3f", ",", header=header, comments="")
    start = f"start_q_deg = {q[0].tolist()}\n" if stated else ""
    beside = f'schema = "lrm/measurements/1"\narm = "so101"\nnoise_sd_mm = 0.05\n{start}'
    (tmp_path / "data.toml").write_text(beside)
    study = lrm.Study.of(lrm.load(tmp_path / "data.csv"), effects="offsets,hysteresis@joint2").fit()
    assert (SAID in str(diagnosis_document(study.diagnose()).blocks)) != stated
