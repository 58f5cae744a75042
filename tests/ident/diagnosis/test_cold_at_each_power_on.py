"""A servo that is cold again at each power-on: its warm-up is named, and follows the time since power-on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import lrm_ident as lrm
from lrm_ident.data.measurement_file.write import measurements_csv
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import effects_at
from lrm_math.effects.session_errors import RESET
from lrm_math.effects.targets import FRAME_PLACE
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from tests.support.misreadings import random_arm_data

NOISE_M, WARM_RAD, CONSTANT_S, POSES = 0.0003, 0.02, 250.0, 120


@pytest.mark.slow
@pytest.mark.usefixtures("one_step_folds")
def test_a_warm_up_that_begins_anew_is_named(tmp_path: Path) -> None:
    """Before: drift counted from the start of the data alone, so creep of another joint was identified for it."""
    data, arm, rng = random_arm_data("two-joint", 5, poses=POSES), load_arm("two-joint"), np.random.default_rng(2)
    true = model_of(arm, effects_at(arm, "offsets"), {"offsets.joint1.theta_rad": 0.02})
    t, session = np.linspace(0.0, 12.0 * POSES, POSES), 1.0 + np.floor(3.0 * np.arange(POSES) / POSES)
    since = t - np.array([t[session == one][0] for one in session])
    q = data.poses.q.copy()
    q[:, 1] += WARM_RAD * (1.0 - np.exp(-since / CONSTANT_S))
    data.tcp[:] = solve_equilibrium(true, poses_of(q)).tcp + rng.normal(0.0, NOISE_M, data.tcp.shape)
    timed = replace(data, poses=replace(data.poses, t=t, session=session))
    path = tmp_path / "data.csv"
    path.write_text(measurements_csv(timed))
    path.with_suffix(".toml").write_text('schema = "lrm/measurements/1"\nnoise_sd_mm = 0.3\n')

    run, after = lrm.Study.of(lrm.load(path, arm="two-joint")).fit().auto()
    assert [step.added for step in run.steps] == ["", "drift@joint2"]
    assert run.verdict.quiet
    assert after.model.value(f"drift.joint2.{RESET}") == pytest.approx(1.0, abs=0.1)
    assert after.model.value("drift.joint2.T_s") == pytest.approx(CONSTANT_S, rel=0.25)
    held_out = run.steps[-1].held_out
    assert held_out.deployed.now.rms == pytest.approx(run.steps[-1].held_out_rms)


@given(st.floats(0.0, 5e3), st.floats(30.0, 3e3))
def test_a_joint_warms_up_from_its_power_on_and_a_stand_from_the_first_pose(lead: float, constant: float) -> None:
    """Whenever measuring begins, a joint's drift is that of the same arm measured from its power-on."""
    arm, t = load_arm("two-joint"), np.linspace(0.0, 600.0, 20)
    late = replace(poses_of(np.zeros((20, 2))), t=t, running=t + lead, powered=t + lead)
    whole = replace(late, t=t + lead)
    shapes = 0.01, 0.0, constant
    for reset in (0.0, 1.0):
        [joint], [seen] = effects_at(arm, "drift@joint2"), effects_at(arm, f"drift@{FRAME_PLACE}")
        np.testing.assert_allclose(
            joint.amounts(late, (), (*shapes, reset)), joint.amounts(whole, (), (*shapes, reset))
        )
        assert RESET not in joint.shapes_to_try(late)
    np.testing.assert_allclose(seen.amounts(late, (), (*shapes, 0.0))[0][0], 0.0)


def test_one_session_leaves_its_beginning_open(lab: Arm) -> None:
    [drift] = effects_at(lab, "drift@joint2")
    t = np.linspace(0.0, 600.0, 20)
    once = replace(poses_of(np.zeros((20, lab.dof))), t=t, running=t)
    twice = replace(once, running=np.where(t < 300.0, t, t - 300.0))
    assert RESET not in drift.shapes_to_try(once)
    assert drift.shapes_to_try(twice)[RESET] == (0.0, 1.0)
    same = (0.01, 0.0, 200.0)
    np.testing.assert_array_equal(drift.amounts(once, (), (*same, 0.0)), drift.amounts(once, (), (*same, 1.0)))
    apart = np.array(drift.amounts(twice, (), (*same, 0.0))) - np.array(drift.amounts(twice, (), (*same, 1.0)))
    assert np.ptp(apart) > 0.001
