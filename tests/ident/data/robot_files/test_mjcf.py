"""MJCF: MuJoCo's own statics are at rest where our elastic equilibrium is."""

from __future__ import annotations

import numpy as np
import pytest

from lrm_ident.data.robot_files.mjcf import mjcf
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import effects_at
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from tests.support.random_arms import random_arm


@pytest.mark.parametrize("seed", range(3))
def test_mujoco_is_at_rest_in_our_equilibrium(seed: int) -> None:
    mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed")
    arm = random_arm(seed, 4)
    names = ("offsets", "compliance", "lateral_compliance@link1", "base_compliance")
    effects = [effect for name in names for effect in effects_at(arm, name)]
    rng = np.random.default_rng(seed)
    empty = model_of(arm, effects)
    plain = [(k, p) for k, p in zip(empty.keys, empty.parameters, strict=True) if p.fixed is None]
    sizes = {k: float(abs(rng.normal(0, 0.2)) * p.typical) for k, p in plain}
    model = model_of(arm, effects, sizes)
    peer = mujoco.MjModel.from_xml_string(mjcf(model).text)
    data = mujoco.MjData(peer)
    payload = model.weights(0.0)
    assert payload
    for q in rng.uniform(-1, 1, (5, 4)):
        equilibrium = solve_equilibrium(model, poses_of(q), tolerance=1e-13)
        for j in range(peer.njnt):
            name = mujoco.mj_id2name(peer, mujoco.mjtObj.mjOBJ_JOINT, j)
            slot = model.chain.index[f"{name}.theta" if name.startswith("joint") and "." not in name else name]
            drawn = model.binding.constants[slot]
            data.qpos[j] = float(np.asarray(equilibrium.slots[slot]).item()) - drawn
        data.ctrl[:] = q
        mujoco.mj_forward(peer, data)
        left = data.qfrc_bias - data.qfrc_passive - data.qfrc_actuator
        np.testing.assert_allclose(left, 0.0, atol=2e-5)  # the milligrams that MuJoCo asks for
        np.testing.assert_allclose(data.site("tcp").xpos, equilibrium.tcp[0], atol=1e-9)


def test_play_is_a_joint_with_a_range() -> None:
    arm = random_arm(1, 3)
    model = model_of(arm, effects_at(arm, "backlash@joint2"), {"backlash.joint2.b_rad": 0.03})
    file = mjcf(model)
    assert 'name="joint2_play"' in file.text
    assert 'range="-0.015 0.015"' in file.text
    assert file.left_out == ()
    gain = model_of(arm, effects_at(arm, "servo_gain@joint1"), {"servo_gain.joint1.g_plus_rad_per_rad": 0.02})
    assert mjcf(gain).left_out == ("servo_gain@joint1",)
    assert mjcf(gain.with_values(np.zeros(len(gain.keys)))).left_out == (), "what does nothing is not missed"


def test_play_at_rest_stands_at_its_end_without_its_stops_giving_way() -> None:
    mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed")
    arm = load_arm("so101")
    effects = [effect for name in ("compliance", "backlash@joint2") for effect in effects_at(arm, name)]
    sizes = {effect.keys[0]: 0.01 for effect in effects if effect.id == "compliance"}
    model = model_of(arm, effects, {**sizes, "backlash.joint2.b_rad": 0.02})
    q = np.array([0.2, 0.3, -0.4, 0.2, 0.1])
    peer = mujoco.MjModel.from_xml_string(mjcf(model).text)
    data = mujoco.MjData(peer)
    data.ctrl[:] = q
    mujoco.mj_step(peer, data, 4000)
    np.testing.assert_allclose(data.site("tcp").xpos, solve_equilibrium(model, poses_of(q)).tcp[0], atol=5e-5)
