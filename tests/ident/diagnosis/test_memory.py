"""Causes with a memory, and gears that ripple, are named with their constants in independent worlds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import lrm_ident as lrm
from lrm_ident.data.measurements import Measurements
from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport
from lrm_math.arm.arm_file import shipped_arms
from tests.support.sweep import soak
from validation import synthetic
from validation.hidden_effects.case import LAB
from validation.hidden_effects.data import dataset
from validation.hidden_effects.memory import WORLDS
from validation.synthetic.hidden_memory import ViscoelasticJoint

pytestmark = [pytest.mark.usefixtures("one_step_folds"), pytest.mark.long]

POSES = 100
by_name = {world.name: world for world in WORLDS}


def data_of(world: str, folder: Path, seed: int = 0) -> tuple[Measurements, synthetic.Dataset]:
    seen = dataset(by_name[world], seed, POSES)
    return lrm.load(synthetic.write(folder / "measured", seen, world)[0], LAB), seen


def diagnosed(data: Measurements) -> DiagnosisReport:
    return lrm.Study.of(data).fit().diagnose()


def test_creep_is_named_with_its_size_and_its_time_constant(tmp_path: Path) -> None:
    data, seen = data_of("creep3 90 s", tmp_path)
    study = lrm.Study.of(data).fit()
    found = study.diagnose()
    assert found.first.name == "creep@joint3"
    added = study.add("creep@joint3")
    [hidden] = seen.truth.effects
    assert isinstance(hidden, ViscoelasticJoint)
    assert added.model.value("creep.joint3.k_rad_per_Nm") == pytest.approx(hidden.compliance_rad_per_nm, rel=0.1)
    assert added.model.value("creep.joint3.T_s") == pytest.approx(hidden.constants_s[0], rel=0.2)
    # without its past the deployed arm keeps the memory's mean, and the spring that each load has made by itself
    assert {"offsets.joint3.theta_rad", "compliance.joint3.k_rad_per_Nm"} == {*added.model.state.offsets}


@pytest.mark.parametrize("waits", ["uneven", *soak("breaks")])
def test_an_arm_without_memory_has_none_whatever_it_waits(waits: str, tmp_path: Path) -> None:
    found = diagnosed(data_of(f"nothing, {waits}", tmp_path)[0])
    assert found.verdict == "nothing_missing"


def test_a_ripple_is_named_with_its_frequency(tmp_path: Path) -> None:
    arm = synthetic.load_arm(shipped_arms()[LAB])
    hidden = synthetic.ToothRipple(2, 11, 0.004, 0.4)
    truth = synthetic.GroundTruth.random(arm, 5, (hidden,))
    truth = synthetic.base_displacement_to_deviations(arm, truth)
    q = synthetic.random_poses(arm, POSES, 3)
    seen = synthetic.simulate(arm, truth, q, 0.0, 3e-4, 1)
    study = lrm.Study.of(lrm.load(synthetic.write(tmp_path / "measured", seen, "a ripple")[0], LAB)).fit()
    found = study.diagnose()
    assert found.first.name == "gear_ripple@joint2"
    model = study.add("gear_ripple@joint2").model
    assert model.value("gear_ripple.joint2.n_per_turn") == pytest.approx(11.0, abs=0.1)
    size = np.hypot(*(model.value(f"gear_ripple.joint2.{name}_rad") for name in "ab"))
    assert size == pytest.approx(0.004, rel=0.15)
