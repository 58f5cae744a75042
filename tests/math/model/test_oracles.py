"""Independent oracles: the thesis's own code, our screw-based generator, pinocchio."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import MM, read_arm
from lrm_math.effects import effects_at
from lrm_math.kinematics.chain import chain_of
from lrm_math.kinematics.forward import frames
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from tests.conftest import ROOT
from tests.support.random_arms import arms
from tests.support.sweep import examples
from tests.support.thesis_parameters import thesis_model, thesis_values
from validation import synthetic


@pytest.mark.parametrize("column", ["nominal", "v_loop"])
def test_the_thesis_published_code(shared: Path, lab: Arm, column: str) -> None:
    folder = shared / "data" / "reference"
    rows = [row for row in csv.DictReader((folder / "tcp.csv").open()) if row["set"] == column]
    assert rows
    q = [[float(row[f"q{i}_rad"]) for i in range(1, 7)] for row in rows]
    equilibrium = solve_equilibrium(thesis_model(lab, thesis_values(folder / "parameters.csv", column)), poses_of(q))
    tcp_mm = [[float(row[key]) for key in ("x_mm", "y_mm", "z_mm")] for row in rows]
    torque_nmm = [[float(row[f"tau{i}_Nmm"]) for i in range(1, 7)] for row in rows]
    np.testing.assert_allclose(equilibrium.tcp / MM, tcp_mm, atol=1e-5)
    np.testing.assert_allclose(equilibrium.joint_torque * 1e3, torque_nmm, atol=1e-4)
    np.testing.assert_allclose(equilibrium.base_moment * 1e3, [float(row["tau_base_Nmm"]) for row in rows], atol=1e-4)


def random_values(model: Model, seed: int) -> dict[str, float]:
    """Deviations of typical sizes, compliances not negative."""
    rng = np.random.default_rng(seed)
    values = {}
    for key, parameter in zip(model.keys, model.parameters, strict=True):
        size = rng.uniform(0.1, 0.6) if parameter.lower == 0.0 else rng.normal(0, 0.6)
        values[key] = size * parameter.typical
    return values


@pytest.mark.slow
@pytest.mark.parametrize("arm_name", ["lrm-lab", "lrm-rover"])
@pytest.mark.parametrize("seed", range(5))
def test_the_generator_with_screws_and_world_frame_torques(arm_name: str, seed: int) -> None:
    """Same parameters in two independent implementations: the same TCP and torques."""
    path = ROOT / "config" / "arms" / f"{arm_name}.toml"
    model = thesis_model(read_arm(path), {})
    values = random_values(model, seed)
    rig = synthetic.load_arm(path)
    names = {key.removeprefix("offsets.").replace("_mm", "_m"): v for key, v in values.items() if key.startswith("off")}
    truth = replace(
        synthetic.GroundTruth.nominal(rig),
        deviations=synthetic.Deviations.named(6, names),
        base_compliance_rad_per_nm=values["compliance.base.k_rad_per_Nm"],
        joint_compliance_rad_per_nm=tuple(values[f"compliance.joint{i}.k_rad_per_Nm"] for i in range(1, 7)),
    )
    q = np.random.default_rng(seed).uniform(-1.74, 1.74, (40, 6))
    payload = np.tile([0.0, 0.0663], 20)
    theirs = synthetic.true_state(rig, truth, q, payload)
    ours = solve_equilibrium(model_of(model.arm, model.effects, values), poses_of(q, payload), tolerance=1e-13)
    np.testing.assert_allclose(ours.tcp, theirs.tcp_m, atol=1e-9)
    np.testing.assert_allclose(ours.joint_torque, theirs.tau_nm, atol=1e-8)
    np.testing.assert_allclose(ours.base_moment, theirs.base_moment_nm, atol=1e-8)


@pytest.mark.long
@pytest.mark.parametrize(("joint", "soft"), [(2, 0.05), (3, 0.0), (4, 0.05), (5, 0.0), (6, 0.05)])
def test_axial_play_is_that_of_the_generator(joint: int, soft: float) -> None:
    """A joint that slides along its axis, as the generator shifts the end of the link before it.

    Of joints 3 and 5 it takes the motor along too, which stands before them: seen only where joints give way.
    """
    path = ROOT / "config" / "arms" / "lrm-lab.toml"
    rig = synthetic.load_arm(path)
    slides = synthetic.AxialFloat(joint - 1, 0.002, 0.5)
    truth = replace(synthetic.GroundTruth.nominal(rig), joint_compliance_rad_per_nm=(soft,) * 6, effects=(slides,))
    q, payload = np.random.default_rng(joint).uniform(-1.74, 1.74, (40, 6)), np.tile([0.0, 0.0663], 20)
    arm, play = read_arm(path), f"axial_play.joint{joint}"
    values = {f"compliance.joint{i}.k_rad_per_Nm": soft for i in range(1, 7)}
    model = model_of(
        arm,
        (*effects_at(arm, "compliance"), *effects_at(arm, play.replace(".", "@"))),
        {**values, f"{play}.b_mm": 0.004, f"{play}.F0_N": 0.5},
    )
    theirs = synthetic.true_state(rig, truth, q, payload)
    np.testing.assert_allclose(
        solve_equilibrium(model, poses_of(q, payload), tolerance=1e-13).tcp, theirs.tcp_m, atol=1e-9
    )


@examples(10, 20)
@given(arms, st.integers(0, 100))
def test_pinocchio(arm: Arm, seed: int) -> None:
    """Gravity torques and TCP of random rigid arms."""
    pin = pytest.importorskip("pinocchio", reason="pinocchio is not installed (extra 'bench')")

    def se3(parts: list[tuple[str, int, float]]) -> object:
        out = pin.SE3.Identity()
        for kind, axis, amount in parts:
            unit = np.eye(3)[axis]
            turn = pin.AngleAxis(amount, unit).toRotationMatrix() if kind == "R" else np.eye(3)
            out = out * pin.SE3(turn, np.zeros(3) if kind == "R" else amount * unit)
        return out

    robot = pin.Model()
    robot.gravity.linear = np.array(arm.gravity)
    b, t = arm.base, arm.tool
    place = se3([("T", 0, b.x), ("T", 1, b.y), ("T", 2, b.z), ("R", 0, b.alpha), ("R", 1, b.beta), ("R", 2, b.gamma)])
    parent, ends = 0, []
    for i, joint in enumerate(arm.joints):
        start = place * se3([("R", 2, joint.theta)])
        parent = robot.addJoint(parent, pin.JointModelRZ(), start, f"joint{i + 1}")
        near = se3([("T", 2, joint.d), ("T", 0, joint.a), ("R", 0, joint.alpha)])
        ends.append((near, near * se3([("T", 2, joint.extra_z or 0.0)])))
        place = ends[-1][1]
    tool = place * se3(
        [("R", 0, t.alpha), ("R", 1, t.beta), ("R", 2, t.gamma), ("T", 0, t.x), ("T", 1, t.y), ("T", 2, t.z)]
    )
    tip = robot.addFrame(pin.Frame("tcp", parent, tool, pin.FrameType.OP_FRAME))
    for body in arm.bodies:
        stands = tool if body.frame > arm.dof else ends[body.frame - 1][0 if body.near_end else 1]
        inertia = pin.Inertia(body.mass, np.array(body.com), np.zeros((3, 3)))
        robot.appendBodyToJoint(min(body.frame, arm.dof), inertia, stands)
    data = robot.createData()
    q = np.random.default_rng(seed).uniform(-2, 2, (5, arm.dof))
    equilibrium = solve_equilibrium(model_of(arm, ()), poses_of(q))
    chain = chain_of(arm)
    ours = frames(chain, chain.values(list(q.T.copy())), 5)[:, -1]
    for pose in range(5):
        torque = pin.computeGeneralizedGravity(robot, data, q[pose])
        pin.framesForwardKinematics(robot, data, q[pose])
        np.testing.assert_allclose(equilibrium.joint_torque[pose], -torque, atol=1e-10)
        np.testing.assert_allclose(ours[pose], data.oMf[tip].homogeneous, atol=1e-12)
