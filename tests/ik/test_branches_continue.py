"""Branches of an arm that continue as a residual field grows are found with the field, whatever the arm, field, goal.

The oracle shares nothing with the kernel: Newton's method in Python from many commands finds the branches of the arm
without the field, and its scale then grows from 0 to 1 in small steps (homotopy; Allgower & Georg 1990).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bench.calibrated_ik import distinct
from lrm_math.arrays import Array
from lrm_math.effects.field.residual_field import ResidualField
from lrm_math.ik.calibrated import CalibratedSolver
from lrm_math.ik.goal import IkQuery, pose
from lrm_math.ik.methods import Direct
from lrm_math.kinematics.forward import frames
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model
from tests.ik.test_residual_field import LOWER, UPPER, commands, with_field
from tests.support.sweep import examples

pytestmark = pytest.mark.long

LEVER, REACHED = 0.1, 1e-8
"""m: of turns against distances; of the goal."""
REGULAR = 0.01
"""m/rad: a path on which some motion moves the tool more slowly passes a singularity, where branches may end."""
STARTS, STEPS, JUMP = 60, 40, 0.1


def tools(model: Model, q: Array) -> Array:
    return frames(model.chain, solve_equilibrium(model, poses_of(q), tolerance=1e-12).slots, len(q))[:, -1]


def twist(to: Array, since: Array) -> Array:
    """(N, 6), displacement and LEVER times the rotation vector, between frames (N, 4, 4)."""
    turn = Rotation.from_matrix(to[:, :3, :3] @ since[:, :3, :3].transpose(0, 2, 1)).as_rotvec()
    return np.concatenate([to[:, :3, 3] - since[:, :3, 3], LEVER * turn], axis=1)


def newton(model: Model, goal: Array, q: Array, steps: int) -> tuple[Array, Array, Array]:
    """From commands (N, n): commands, errors (m), and speeds (m/rad) of the motion that moves the tool least."""
    h, n = 1e-6, q.shape[1]
    for step in range(steps + 1):
        there = tools(model, np.concatenate([q, *(q + h * np.eye(n)[j] for j in range(n))])).reshape(n + 1, -1, 4, 4)
        J = np.stack([twist(there[j + 1], there[0]) / h for j in range(n)], axis=2)
        off = twist(np.broadcast_to(goal, there[0].shape), there[0])
        if step < steps:
            damping = 1e-3 * (off**2).sum(axis=1)[:, None, None] + 1e-14
            normal, right = J.transpose(0, 2, 1) @ J + damping * np.eye(n), J.transpose(0, 2, 1) @ off[:, :, None]
            q = np.clip(q + np.clip(np.linalg.solve(normal, right)[:, :, 0], -0.5, 0.5), LOWER - 0.3, UPPER + 0.3)
    return q, np.asarray(np.linalg.norm(off, axis=1)), np.asarray(np.linalg.svd(J, compute_uv=False)[:, -1])


def scaled(model: Model, share: float) -> Model:
    """The model with its field at a share of its size."""
    of_field = np.concatenate([[isinstance(e, ResidualField)] * len(e.parameters) for e in model.effects])
    return replace(model, values=np.where(of_field, share * model.values, model.values))


def continued(model: Model, goal: Array, q: Array) -> Array | None:
    """A branch without the field, followed to where it is with it; None if the path passes a singularity on the way."""
    for share in np.linspace(0.0, 1.0, STEPS + 1):
        there, off, speed = newton(scaled(model, share), goal, q[None], 4)
        if off[0] > REACHED or speed[0] < REGULAR or np.abs(there[0] - q).max() > JUMP:
            return None
        q = there[0]
    return q


@examples(2, 20)
@given(st.integers(0, 10**6), st.floats(0.2e-3, 1.5e-3))
def test_branches_that_continue_are_found(seed: int, size: float) -> None:
    model = with_field(("offsets", "compliance"), seed, size)
    goal = tools(scaled(model, 0.0), commands(seed + 1, 1, 0.95))[0]
    starts = np.random.default_rng(seed).uniform(LOWER, UPPER, (STARTS, len(LOWER)))
    q, off, _ = newton(scaled(model, 0.0), goal, np.concatenate([commands(seed + 1, 1, 0.95), starts]), 25)
    paths = [continued(model, goal, branch) for branch in distinct(list(q[off < REACHED]))]
    wanted = [end for end in paths if end is not None and (end > LOWER).all() and (end < UPPER).all()]
    found = Direct().find(CalibratedSolver.of(model).arm, IkQuery(pose(goal[:3, 3], goal[:3, :3])))
    rows = np.array([branch.q for branch in found.within] if found else []).reshape(-1, len(LOWER))
    for end in wanted:
        assert len(rows), "no branch was found"
        assert np.abs(rows - end).max(axis=1).min() < 1e-4
