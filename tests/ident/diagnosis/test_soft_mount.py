"""A mount of the tool that gives way under the load is named, against the moment of the load worked out by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import lrm_ident as lrm
from lrm_ident.data.measurement_file.write import measurements_csv
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import effects_at
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from tests.support.misreadings import random_arm_data

NOISE_M, LOAD_KG, SOFT = 0.0002, 0.2, 0.3


def test_the_mount_turns_by_the_moment_of_the_load_alone() -> None:
    """In the tool's frame: the load's weight times the lever, a spring about each axis; nothing without a load."""
    arm, names = load_arm("so101"), ("offsets", "tool_compliance@tool")
    effects = tuple(effect for name in names for effect in effects_at(arm, name))
    soft = model_of(arm, effects, {f"tool_compliance.tool.k_{axis}_rad_per_Nm": 1e-4 for axis in "xyz"})
    rigid = model_of(arm, effects)
    q = np.random.default_rng(4).uniform(-1.0, 1.0, (12, arm.dof))
    bare, loaded = poses_of(q), replace(poses_of(q), payload=np.full(12, LOAD_KG))
    np.testing.assert_allclose(solve_equilibrium(soft, bare).tcp, solve_equilibrium(rigid, bare).tcp, atol=1e-9)
    at_rest = solve_equilibrium(rigid, loaded)
    moved = solve_equilibrium(soft, loaded).tcp - at_rest.tcp
    lever = np.hypot(arm.tool.x, np.hypot(arm.tool.y, arm.tool.z))
    most = 1e-4 * LOAD_KG * 9.81 * lever**2
    assert 0.2 * most < np.linalg.norm(moved, axis=1).max() < 1.01 * most
    assert (moved @ np.array(arm.gravity) >= -1e-12).all()  # what gives way goes down


@pytest.mark.slow
@pytest.mark.usefixtures("one_step_folds")
def test_a_soft_mount_is_named(tmp_path: Path) -> None:
    """Before: the bending of links and the load's mass stood for it."""
    arm, data, rng = load_arm("so101"), random_arm_data("so101", 5, poses=90), np.random.default_rng(3)
    loaded = replace(data.poses, payload=rng.choice([0.0, 0.5 * LOAD_KG, LOAD_KG], 90))
    effects = tuple(e for name in ("offsets", "compliance", "tool_compliance@tool") for e in effects_at(arm, name))
    springs = {"tool_compliance.tool.k_x_rad_per_Nm": SOFT}
    true = model_of(arm, effects, {"compliance.joint2.k_rad_per_Nm": 0.03, **springs})
    data.tcp[:] = solve_equilibrium(true, loaded).tcp + rng.normal(0.0, NOISE_M, data.tcp.shape)
    path = tmp_path / "data.csv"
    path.write_text(measurements_csv(replace(data, poses=loaded)))
    path.with_suffix(".toml").write_text('schema = "lrm/measurements/1"\nnoise_sd_mm = 0.2\n')
    run, _ = lrm.Study.of(lrm.load(path, arm="so101")).fit().auto()
    assert [step.added for step in run.steps] == ["", "tool_compliance@tool"]
    assert run.verdict.quiet
