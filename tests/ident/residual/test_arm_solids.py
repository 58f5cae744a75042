"""Links as solids stand where the collision check has them; an arm without shapes has a tube for every link."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lrm_ident.residual.picture.arm_solids import arm_solids, placed
from lrm_math.arm.arm_file import load_arm
from lrm_math.collision.scene import Scene
from lrm_math.kinematics import forward
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of

SHAPED, BARE = ("lrm-lab", "lrm-rover"), ("so101", "two-joint", "ur5")


@pytest.mark.parametrize("name", SHAPED)
def test_capsules_stand_where_the_collision_check_has_them(name: str) -> None:
    arm = load_arm(name)
    scene = Scene.of(arm)
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (5, arm.dof))
    frames = scene.frames(q)
    solids = arm_solids(arm, frames[0])
    points = np.concatenate([frames[:, :, :3, 3], placed(solids, frames)], axis=1)
    assert solids.shaped
    for (first, second, radius), one, ends in zip(solids.links, arm.shapes.capsules, scene.ends, strict=True):
        assert radius == one.radius
        for number, end in ((first, ends[0]), (second, ends[1])):
            place = frames[:, one.frame, :3, :3] @ end + frames[:, one.frame, :3, 3]
            np.testing.assert_allclose(points[:, number], place, atol=1e-12)


@pytest.mark.parametrize("name", [*SHAPED, *BARE])
def test_an_arm_without_shapes_has_tubes_from_origin_to_origin(name: str) -> None:
    arm = load_arm(name)
    arm = replace(arm, shapes=replace(arm.shapes, capsules=(), ignored=()))
    equilibrium = solve_equilibrium(model_of(arm, ()), poses_of(np.zeros(arm.dof), 0.0))
    frames = forward.frames(equilibrium.model.chain, equilibrium.slots, 1)[0]
    solids = arm_solids(arm, frames)
    lengths = np.linalg.norm(np.diff(frames[:, :3, 3], axis=0), axis=1)
    assert not solids.shaped
    assert placed(solids, frames[None]).shape == (1, 0, 3)
    assert {(i, i + 1) for i in np.flatnonzero(lengths > 0.05 * lengths.sum())} <= {link[:2] for link in solids.links}
    assert all(0 < radius < 0.05 * lengths.sum() for *_, radius in solids.links)
