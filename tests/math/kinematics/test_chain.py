"""The chain against plain 4 x 4 link matrices, for arms of one to ten joints."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_math.arm.arm import MOST_JOINTS, Arm
from lrm_math.kinematics.chain import chain_of, pull_back, trig
from lrm_math.kinematics.forward import chain_geometry, frames
from lrm_math.kinematics.statics import carried_along
from lrm_math.model.derivatives import slot_jacobian
from tests.support.central_differences import stepped
from tests.support.link_matrices import link_matrices
from tests.support.random_arms import arms, random_arm


@pytest.mark.slow
@given(arms, st.integers(0, 1000))
def test_frames_are_products_of_link_matrices(arm: Arm, seed: int) -> None:
    q = np.random.default_rng(seed).uniform(-2, 2, (3, arm.dof))
    chain = chain_of(arm)
    values = chain.values(list(q.T.copy()))
    ours = frames(chain, values, 3)
    for pose in range(3):
        np.testing.assert_allclose(ours[pose], link_matrices(arm, q[pose]), atol=1e-13)


@pytest.mark.slow
@given(arms, st.integers(0, 1000))
def test_one_pose_in_scalar_python_equals_the_batch(arm: Arm, seed: int) -> None:
    q = np.random.default_rng(seed).uniform(-2, 2, (4, arm.dof))
    chain = chain_of(arm)
    batch = chain.values(list(q.T.copy()))
    together = np.stack(np.broadcast_arrays(*pull_back(chain, batch, trig(chain, batch))), axis=-1)
    for pose in range(4):
        values = chain.values(q[pose].tolist())
        alone = pull_back(chain, values, trig(chain, values))
        assert all(isinstance(component, float) for component in alone)
        np.testing.assert_allclose(alone, together[pose], atol=1e-14)


@pytest.mark.slow
@given(arms, st.integers(0, 1000))
def test_slot_jacobian_against_central_differences(arm: Arm, seed: int) -> None:
    q = np.random.default_rng(seed).uniform(-2, 2, (2, arm.dof))
    chain = chain_of(arm)
    values = chain.values(list(q.T.copy()))
    J = carried_along(chain, slot_jacobian(chain, chain_geometry(chain, values, 2)))
    h = 1e-6
    every = range(len(chain.slots))
    up, down = (chain_geometry(chain, stepped(values, every, 2, s), 2 * len(every)).tcp for s in (h, -h))
    for k in every:
        difference = (up - down)[..., 2 * k : 2 * k + 2] / (2 * h)
        np.testing.assert_allclose(J[k], difference, atol=1e-9)


@given(arms, st.integers(0, 1000))
def test_rotations_stay_rotations(arm: Arm, seed: int) -> None:
    q = np.random.default_rng(seed).uniform(-2, 2, (2, arm.dof))
    chain = chain_of(arm)
    R = frames(chain, chain.values(list(q.T.copy())), 2)[..., :3, :3]
    np.testing.assert_allclose(R @ R.swapaxes(-1, -2), np.broadcast_to(np.eye(3), R.shape), atol=1e-13)
    np.testing.assert_allclose(np.linalg.det(R), 1.0, atol=1e-12)


def test_any_number_of_joints() -> None:
    for joints in range(1, MOST_JOINTS + 1):
        assert chain_of(random_arm(1, joints)).dof == joints


def test_home_of_the_lab_arm_by_hand(lab: Arm) -> None:
    # stretched: base + R_y(60 deg) times all lengths along z
    chain = chain_of(lab)
    values = chain.values([0.0] * 6)
    x, y, z = pull_back(chain, values, trig(chain, values))
    reach = (46.905 + 103.505 + 43.06953 + 107.75 + 43.25 + 73.27) * 1e-3
    assert x == pytest.approx(0.04598 + np.sin(np.pi / 3) * reach, abs=1e-12)
    assert y == pytest.approx(0.0, abs=1e-12)
    assert z == pytest.approx(0.082012391 + np.cos(np.pi / 3) * reach, abs=1e-12)
