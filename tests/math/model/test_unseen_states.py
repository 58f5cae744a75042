"""Warm-ups that are followed beyond the time of their session."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import effects_at
from lrm_math.effects.measured_range import MeasuredRange
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.model.deployed_model import as_deployed_at
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from lrm_math.model.session_state import StateAfterSession
from lrm_math.model.unseen_states import beyond_session

LAB = load_arm("lrm-lab")
NAME, ANGLE = "drift@joint2", "offsets.joint2.theta_rad"
SIZE, CONSTANT_S, LAST_S = 0.02, 1800.0, 600.0
ENDS = float(SIZE * (1.0 - np.exp(-LAST_S / CONSTANT_S)))
FREE = model_of(
    LAB,
    [*effects_at(LAB, "offsets"), *effects_at(LAB, NAME)],
    {"drift.joint2.A_rad": SIZE, "drift.joint2.T_s": CONSTANT_S},
).with_state(StateAfterSession({NAME: "last"}, {ANGLE: ENDS}, {NAME: ENDS}))
ANGLES = tuple((joint.lower, joint.upper) for joint in LAB.joints)
MODEL = replace(FREE, within=MeasuredRange(ANGLES, (0.0, 0.0), t=(0.0, LAST_S), running=(0.0, LAST_S)))
"""Measured for ten minutes, a third of the time constant."""


def since_power_on(seconds: float) -> Poses:
    time = np.array([seconds])
    return replace(poses_of(np.full((1, LAB.dof), 0.3)), t=time, running=time)


@pytest.mark.parametrize("seconds", [0.0, 0.5 * LAST_S, LAST_S])
def test_the_session_showed_what_happens_within_its_time(seconds: float) -> None:
    assert not beyond_session(MODEL, since_power_on(seconds)).any()


@pytest.mark.parametrize("seconds", [1.1 * LAST_S, 1e4])
def test_what_goes_on_after_it_counts_as_far_as_the_law_moves_the_tip(seconds: float) -> None:
    tips = [
        solve_equilibrium(as_deployed_at(MODEL, poses), poses).tcp[0]
        for poses in map(since_power_on, (seconds, LAST_S))
    ]
    apart = beyond_session(MODEL, since_power_on(seconds))
    assert apart == pytest.approx(tips[0] - tips[1], abs=1e-9)
    assert np.linalg.norm(apart) > 1e-4


def test_where_the_time_is_not_known_nothing_is_followed() -> None:
    assert not beyond_session(MODEL, poses_of(np.full((1, LAB.dof), 0.3))).any()
    assert not beyond_session(FREE, since_power_on(1e4)).any()
