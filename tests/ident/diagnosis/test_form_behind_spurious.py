"""A plain effect that only resembles a structure does not hide its form, which explains it: stops that yield."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from lrm_ident.data.measurements import Measurements
from lrm_ident.data.robot_files.arm_text import template
from lrm_ident.diagnosis.confirm import confirm
from lrm_ident.diagnosis.diagnose import diagnose
from lrm_ident.fitting.identifiability import fit_identifiable
from lrm_ident.fitting.model_fit import nominal_model
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.effects import variants
from lrm_math.kinematics.poses import Poses
from validation.synthetic import (
    GroundTruth,
    HiddenEffect,
    JointLoad,
    base_displacement_to_deviations,
    even_schedule,
    measure,
    random_poses,
)
from validation.synthetic import load_arm as load_description
from validation.synthetic.generate import directions
from validation.synthetic.hidden_effect import at_joint

NOISE, COUNT, JOINTS = 2e-4, 160, 6
SHOULDER = 2


@dataclass(frozen=True)
class YieldingStop(HiddenEffect):
    """A joint that turns less than it should beyond some angle."""

    joint: int
    at_rad: float
    share: float

    def added_angles(self, load: JointLoad) -> Array:
        beyond = np.maximum(load.poses.q_rad[:, self.joint - 1] - self.at_rad, 0.0)
        return at_joint(self.joint, -self.share * beyond, load.tau_nm)


@pytest.mark.parametrize("seed", range(6))
def test_a_stop_of_an_upright_shoulder_is_a_curve_of_its_angle(tmp_path: Path, seed: int) -> None:
    """There the torque follows the joint's angle, and a free function of both took the place of every name."""
    file, rng = tmp_path / "arm.toml", np.random.default_rng(seed)
    file.write_text(template("upright"))
    described, number = load_description(file), np.arange(1, COUNT + 1)
    stop = YieldingStop(SHOULDER, rng.uniform(0.3, 0.9), rng.uniform(0.05, 0.15))
    truth = base_displacement_to_deviations(described, GroundTruth.random(described, seed, (stop,)))
    q, load = random_poses(described, COUNT, seed, floor_m=-1.0), np.zeros(COUNT)
    plan = even_schedule(COUNT, JOINTS)
    tcp = measure(described, truth, q, load, NOISE, seed, plan)
    poses = Poses(q, load, directions(q, np.zeros(JOINTS)), plan.time_s)
    data = Measurements(poses, number, tcp, None, NOISE, number, Path("synthetic.csv"), "")
    model = nominal_model(load_arm(str(file)))
    first = confirm(diagnose(fit_identifiable(model, data, model.keys).fit.model, data)).first
    assert first is not None
    assert f"eccentricity@joint{SHOULDER}" in (first.name, *variants(first.candidate.effect))
