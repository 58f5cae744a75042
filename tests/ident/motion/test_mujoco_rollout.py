"""MuJoCo as an oracle: the exported MJCF, rolled out on random moves, goes where the model of motion predicts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lrm_ident.data.robot_files.mjcf import mjcf
from lrm_ident.data.wording import joint_labels
from lrm_ident.measuring.motion.joint_dynamics import with_dynamics
from lrm_ident.measuring.motion.moves import moves_of
from lrm_ident.measuring.recordings.lerobot import LeRobotFrames
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.model.model import model_of
from lrm_math.motion.motion_model import MotionModel, effect_of
from validation.lerobot_dataset import FPS
from validation.motion.world import hand

mujoco = pytest.importorskip("mujoco", reason="extra mujoco")
pytestmark = pytest.mark.slow

ARM, POSES = load_arm("so101"), model_of(load_arm("so101"), ())
SUBSTEPS, EPISODES = 256, 2
STEP_S = 1.0 / FPS / SUBSTEPS
"""s, of MuJoCo: its error is of first order in the step, 0.05 deg at 2 ms."""
APART_DEG = 0.01
"""deg RMS; the arm lags its commands by 2 to 5 deg RMS. MuJoCo's default friction creeps, and is 0.3 to 0.5 deg off."""


def random_model(rng: np.random.Generator) -> MotionModel:
    """Servos that all yield to gravity, so that their torques are known; one of them rubs."""
    model, rubs = MotionModel.nominal(ARM), int(rng.integers(ARM.dof))
    for joint, place in enumerate(ARM.joint_names):
        values = {
            f"servo_response.{place}.frequency_Hz": rng.uniform(3.0, 6.0),
            f"servo_response.{place}.damping_ratio": rng.uniform(0.6, 1.2),
            f"rest_offset.{place}.b_rad": 0.0,
            f"gravity_sag.{place}.k_rad_per_Nm": rng.uniform(0.005, 0.02),
        }
        more = [effect_of(ARM, f"gravity_sag@{place}")]
        if joint == rubs:
            more.append(effect_of(ARM, f"coulomb_friction@{place}"))
            values[f"coulomb_friction.{place}.c_rad"] = rng.uniform(0.005, 0.02)
        model = model.with_joint((*model.of_joint(joint), *more), values, {})
    return model


def rolled_out(model: MotionModel, told: Array) -> Array:
    """(N, n), rad, joints of the exported arm in MuJoCo at frames of commands (N, n), rad, from equilibrium."""
    spec = mujoco.MjSpec.from_string(with_dynamics(mjcf(POSES), Path("arm.xml"), model, POSES).text)
    spec.option.timestep = STEP_S
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    built: Any = spec.compile()
    data, labels = mujoco.MjData(built), joint_labels(ARM)
    q = [built.joint(label).qposadr[0] for label in labels]
    motor = {int(built.actuator_trnid[k, 0]): k for k in range(built.nu)}
    ctrl = [motor[built.joint(label).id] for label in labels]
    data.qpos[q] = told[0]
    out = []
    for frame in (*[told[0]] * FPS, *told):
        out.append(data.qpos[q].copy())
        data.ctrl[ctrl] = frame
        mujoco.mj_step(built, data, SUBSTEPS)
    return np.array(out[FPS:])


@pytest.mark.parametrize("seed", range(2))
def test_mujoco_moves_the_exported_arm_as_the_model_predicts(seed: int) -> None:
    rng = np.random.default_rng(seed)
    model, episodes = random_model(rng), [hand(rng) for _ in range(EPISODES)]
    told, q = np.concatenate(episodes), np.concatenate([rolled_out(model, one) for one in episodes])
    number = np.repeat(np.arange(EPISODES), len(episodes[0]))
    frames = LeRobotFrames(told, q, np.tile(np.arange(len(episodes[0])) / FPS, EPISODES), number)
    moves = moves_of(frames, ARM, Path("rolled out")).along(model)
    for joint, data in enumerate(moves.measured(model, range(ARM.dof))):
        effects = model.of_joint(joint)
        values = np.array([[model.values[key] for effect in effects for key in effect.keys]])
        off = np.degrees(np.sqrt(np.mean(data.error(data.missed(effects, values)) ** 2)))
        assert off < APART_DEG, f"joint {joint + 1}: {[effect.name for effect in effects]}"
