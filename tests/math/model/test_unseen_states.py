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
from lrm_math.model.model import Model, model_of
from lrm_math.model.session_state import StateAfterSession
from lrm_math.model.unseen_states import beyond_session

LAB = load_arm("lrm-lab")
SIZE, CONSTANT_S, LAST_S = 0.02, 1800.0, 600.0
ANGLES = tuple((joint.lower, joint.upper) for joint in LAB.joints)
WITHIN = MeasuredRange(ANGLES, (0.0, 0.0), t=(0.0, LAST_S), running=(0.0, LAST_S))


def warming(**sizes: float) -> Model:
    """Joints that warm up by so much (rad), after their session."""
    ends = {joint: float(size * (1.0 - np.exp(-LAST_S / CONSTANT_S))) for joint, size in sizes.items()}
    values = {f"drift.{joint}.A_rad": size for joint, size in sizes.items()}
    effects = [*effects_at(LAB, "offsets"), *(one for joint in sizes for one in effects_at(LAB, f"drift@{joint}"))]
    state = StateAfterSession(
        {f"drift@{joint}": "last" for joint in sizes},
        {f"offsets.{joint}.theta_rad": end for joint, end in ends.items()},
        {f"drift@{joint}": end for joint, end in ends.items()},
    )
    return model_of(LAB, effects, values | {f"drift.{joint}.T_s": CONSTANT_S for joint in sizes}).with_state(state)


FREE = warming(joint2=SIZE)
MODEL = replace(FREE, within=WITHIN)
"""Measured for ten minutes, a third of the time constant."""


def since_power_on(seconds: float) -> Poses:
    time = np.array([seconds])
    return replace(poses_of(np.full((1, LAB.dof), 0.3)), t=time, running=time)


@pytest.mark.parametrize("seconds", [0.0, 0.5 * LAST_S, LAST_S])
def test_the_session_showed_what_happens_within_its_time(seconds: float) -> None:
    (apart,) = beyond_session(MODEL, since_power_on(seconds))
    assert not apart.any()


@pytest.mark.parametrize("seconds", [1.1 * LAST_S, 1e4])
def test_what_goes_on_after_it_counts_as_far_as_the_law_moves_the_tip(seconds: float) -> None:
    tips = [
        solve_equilibrium(as_deployed_at(MODEL, poses), poses).tcp[0]
        for poses in map(since_power_on, (seconds, LAST_S))
    ]
    (apart,) = beyond_session(MODEL, since_power_on(seconds))
    assert apart == pytest.approx(tips[0] - tips[1], abs=1e-9)
    assert np.linalg.norm(apart) > 1e-4


def test_where_the_time_is_not_known_nothing_is_followed() -> None:
    assert not beyond_session(MODEL, poses_of(np.full((1, LAB.dof), 0.3)))
    (apart,) = beyond_session(FREE, since_power_on(1e4))
    assert not apart.any()


def test_laws_that_move_the_tip_against_each_other_count_each() -> None:
    """Before: their sum, near zero here, as if one could not be wrong without the other."""
    now, sizes = since_power_on(1e4), {"joint2": SIZE, "joint4": -SIZE}
    alone = [beyond_session(replace(warming(**{name: size}), within=WITHIN), now)[0] for name, size in sizes.items()]
    both = beyond_session(replace(warming(**sizes), within=WITHIN), now)
    assert alone[0] @ alone[1] < 0.0
    assert len(both) == 2
    for together, single in zip(both, alone, strict=True):
        assert np.linalg.norm(together - single) < 0.05 * np.linalg.norm(single)
