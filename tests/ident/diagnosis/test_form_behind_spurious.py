"""A plain effect that only resembles a structure does not hide its form, which explains it: stops that yield."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from lrm_ident.diagnosis.confirm import confirm
from lrm_ident.diagnosis.diagnose import diagnose
from lrm_ident.fitting.identifiability import fit_identifiable
from lrm_math.arrays import Array
from lrm_math.effects import variants
from tests.support.sweep import seeds
from tests.support.upright_arm import upright_measurements
from validation.synthetic import HiddenEffect, JointLoad
from validation.synthetic.hidden_effect import at_joint

pytestmark = pytest.mark.long

NOISE, COUNT = 2e-4, 160
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


@pytest.mark.parametrize("seed", seeds(1, 6))
def test_a_stop_of_an_upright_shoulder_is_a_curve_of_its_angle(tmp_path: Path, seed: int) -> None:
    """There the torque follows the joint's angle, and a free function of both took the place of every name."""
    rng = np.random.default_rng(seed)
    stop = YieldingStop(SHOULDER, rng.uniform(0.3, 0.9), rng.uniform(0.05, 0.15))
    model, data = upright_measurements(tmp_path, seed, COUNT, NOISE, (stop,))
    first = confirm(diagnose(fit_identifiable(model, data, model.keys).fit.model, data)).first
    assert first is not None
    assert f"eccentricity@joint{SHOULDER}" in (first.name, *variants(first.candidate.effect))
