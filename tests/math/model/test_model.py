"""A model goes to another process as it is, whatever was computed with it."""

from __future__ import annotations

import pickle

import numpy as np

from lrm_math.arm.arm_file import load_arm
from lrm_math.effects.compliance import Compliance
from lrm_math.effects.offsets import Offsets
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of


def test_a_used_model_is_pickled() -> None:
    arm = load_arm("lrm-lab")
    effects = [kind(arm, place) for kind in (Offsets, Compliance) for place in kind.places(arm)]
    model = model_of(arm, effects, {"compliance.joint2.k_rad_per_Nm": 0.05})
    poses = poses_of(np.zeros((3, arm.dof)), 0.0663)
    expected = solve_equilibrium(model, poses).tcp
    sent = pickle.loads(pickle.dumps(model))
    assert np.array_equal(solve_equilibrium(sent, poses).tcp, expected)
