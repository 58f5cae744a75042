"""Readings before the arm had settled: what they do to positions, and that the arm does not keep it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lrm_math.arm.arm import Arm
from lrm_math.effects import effects_at
from lrm_math.kinematics.history import history_of
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.model.deployed_model import as_deployed, as_deployed_when_read
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from lrm_math.model.state_after_session import state_after_session

SHARE = 0.012


def campaign(arm: Arm, session: tuple[int, ...] | None = None, shuffle: bool = False) -> Poses:
    """40 poses in an order; shuffled rows keep their times."""
    rng = np.random.default_rng(3)
    q, t, number = rng.uniform(-1.0, 1.0, (40, arm.dof)), np.linspace(0.0, 390.0, 40), np.arange(1, 41)
    rows = rng.permutation(40) if shuffle else np.arange(40)
    sessions = None if session is None else np.array(session)
    history = history_of(q[rows], np.zeros(40), t[rows], sessions, number)
    return replace(poses_of(q[rows]), t=t[rows], number=number, history=history)


def late(arm: Arm) -> Model:
    """The lab arm with springs, read too early."""
    names = ("offsets", "compliance", "settling_error@frame")
    effects = tuple(effect for name in names for effect in effects_at(arm, name))
    values = {"compliance.joint2.k_rad_per_Nm": 0.05, "settling_error.frame.e_rad_per_rad": SHARE}
    return model_of(arm, effects, values)


def stopped_short(poses: Poses) -> Poses:
    """Where the joints stood: by the rows' times, a share of the way from the pose before is missing."""
    order = np.argsort(poses.t)
    q = poses.q.copy()
    q[order[1:]] -= SHARE * (poses.q[order[1:]] - poses.q[order[:-1]])
    return poses_of(q)


@pytest.mark.parametrize("shuffle", [False, True])
def test_each_joint_lacks_a_share_of_its_last_move(lab: Arm, shuffle: bool) -> None:
    poses, model = campaign(lab, shuffle=shuffle), late(lab)
    settled = model.with_values_of(["settling_error.frame.e_rad_per_rad"], [0.0])
    np.testing.assert_allclose(
        solve_equilibrium(model, poses).tcp, solve_equilibrium(settled, stopped_short(poses)).tcp, atol=1e-8
    )


def test_the_first_pose_of_a_session_lacks_nothing(lab: Arm) -> None:
    poses = campaign(lab, (1,) * 20 + (2,) * 20)
    [effect] = effects_at(lab, "settling_error@frame")
    amounts = np.array(effect.amounts(poses, (), (1.0,)))
    assert not amounts[:, [0, 20]].any()
    np.testing.assert_allclose(amounts[:, 1], poses.q[0] - poses.q[1])


def test_the_arm_does_not_keep_it(lab: Arm) -> None:
    """Deployed is the arm at rest; with the readings of the measurement the model that was at rest nowhere counts."""
    poses, model = campaign(lab), late(lab)
    model = model.with_state(state_after_session(solve_equilibrium(model, poses)))
    rest = model.with_values_of(["settling_error.frame.e_rad_per_rad"], [0.0])
    found = [solve_equilibrium(one, poses).tcp for one in (as_deployed(model), as_deployed_when_read(model, poses))]
    np.testing.assert_allclose(found[0], solve_equilibrium(rest, poses).tcp, atol=1e-12)
    np.testing.assert_allclose(found[1], solve_equilibrium(model, poses).tcp, atol=1e-12)
