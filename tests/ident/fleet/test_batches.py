"""A batch of arms with a softer joint, and one arm that is broken: both are found, each as what it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lrm_ident.data.measurements import Measurements
from lrm_ident.fleet.fleet_report import FleetResult, fleet_result
from lrm_ident.fleet.identify_arm import ArmRecord, evidence_of
from lrm_ident.fleet.manifest import FleetMember
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import effects_at
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of

ARM, ARMS, POSES, BROKEN = "lrm-lab", 18, 20, 4
SOFT, LOOSE = "compliance.joint3.k_rad_per_Nm", "compliance.joint2.k_rad_per_Nm"


def fleet(softer: float, folder: Path) -> FleetResult:
    """Arms of two batches in turn; joint 3 of the second is so many times as soft; joint 2 of one arm five times."""
    arm = load_arm(ARM)
    effects = effects_at(arm, "compliance")
    members, records = list[FleetMember](), list[ArmRecord]()
    for number in range(ARMS):
        rng, second = np.random.default_rng([11, number]), number % 2 == 1
        values = {f"compliance.joint{k}.k_rad_per_Nm": 0.03 * (1 + 0.08 * rng.normal()) for k in range(1, 7)}
        values[SOFT] *= softer if second else 1.0
        values[LOOSE] *= 5.0 if number == BROKEN else 1.0
        equilibrium = solve_equilibrium(
            model_of(arm, effects, values), poses_of(rng.uniform(-0.8, 0.8, (POSES, arm.dof)))
        )
        pose = np.arange(1, POSES + 1)
        tcp = equilibrium.tcp + rng.normal(0, 3e-4, (POSES, 3))
        data = Measurements(equilibrium.poses, pose, tcp, None, None, pose, Path("made.csv"), "", arm=arm)
        name, tags = f"arm{number}", (("batch", "AB"[second]), ("screwdriver", "xy"[number // 2 % 2]))
        evidence = evidence_of(model_of(arm, effects), data, ARM)
        members.append(FleetMember(name, Path(f"{name}.csv"), ARM, tags))
        records.append(ArmRecord(name=name, sha256="made", poses=POSES, evidence=evidence))
    return fleet_result(members, records, folder)


@pytest.fixture(scope="module")
def two_batches(tmp_path_factory: pytest.TempPathFactory) -> FleetResult:
    return fleet(1.8, tmp_path_factory.mktemp("batches"))


@pytest.mark.slow
def test_the_softer_joint_goes_with_the_batch_and_nothing_else_does(two_batches: FleetResult) -> None:
    assert [(link.what, link.tag) for link in two_batches.links] == [(SOFT, "batch")]
    medians = {level: float(words.split()[-1]) for level, words in two_batches.links[0].levels}
    assert medians["B"] / medians["A"] == pytest.approx(1.8, rel=0.15)


def test_the_broken_arm_is_named_and_the_batch_is_no_outlier(two_batches: FleetResult) -> None:
    assert [(one.arm, one.key) for one in two_batches.outliers] == [(f"arm{BROKEN}", LOOSE)]
    assert two_batches.outliers[0].sentence.startswith(f"arm{BROKEN}: joint2's compliance")


@pytest.mark.slow
def test_where_no_batch_differs_none_is_named(tmp_path: Path) -> None:
    found = fleet(1.0, tmp_path)
    assert not found.links
    assert [one.arm for one in found.outliers] == [f"arm{BROKEN}"]
