"""A robot's own MJCF with a model in it: MuJoCo comes to rest where our elastic equilibrium is; all else is kept."""

from __future__ import annotations

import math
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lrm_ident.data.robot_files.mjcf import mjcf
from lrm_ident.data.robot_files.mjcf_patch import patched_mjcf
from lrm_ident.data.robot_files.mjcf_robot import read_mjcf
from lrm_ident.data.robot_files.urdf_arm import import_arm
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.kinematics.poses import Poses, poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from tests.support.commands import stderr_of, stdout_of

mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed")
CORNERS = np.array([[0, 0, 0], [0.05, 0, 0], [0, 0.05, 0], [0, 0, 0.05]], dtype=np.float32)
FACES = ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))


@pytest.fixture
def own(so101: Arm, tmp_path: Path) -> Path:
    """The SO-101 as a robot's own file: a base in the world, a mesh in a folder, an angle that is not drawn at zero."""
    (tmp_path / "meshes").mkdir()
    triangles = b"".join(struct.pack("<12fH", 0, 0, 0, *CORNERS[list(face)].ravel(), 0) for face in FACES)
    (tmp_path / "meshes" / "part.stl").write_bytes(b"\0" * 80 + struct.pack("<I", len(FACES)) + triangles)
    text = mjcf(model_of(so101, ())).text
    part = '<geom name="part" type="mesh" mesh="part" mass="0.2" contype="0" conaffinity="0"/>'
    for old, new in (
        ('autolimits="true"', 'autolimits="true" meshdir="meshes"'),
        ("<worldbody>", f'<asset><mesh name="part" file="part.stl"/></asset><worldbody><body name="base_link">{part}'),
        ("</worldbody>", "</body></worldbody>"),
    ):
        text = text.replace(old, new)
    path = tmp_path / "own.xml"
    path.write_text(text)
    return path


def hidden(arm: Arm, *names: str, **more: float) -> Model:
    effects = [effect for name in names for effect in effects_at(arm, name)]
    empty, rng = model_of(arm, effects), np.random.default_rng(3)
    plain = [(k, p) for k, p in zip(empty.keys, empty.parameters, strict=True) if p.fixed is None]
    return model_of(arm, effects, {k: abs(rng.normal(0, 0.5)) * p.typical for k, p in plain} | more)


def at_rest(path: Path, q: Array, side: float = 0.0) -> Array:
    """Tip (3,) of MuJoCo's own dynamics after some seconds, each joint coming slowly from `side`."""
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.timestep, model.opt.integrator = 0.002, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    data: Any = mujoco.MjData(model)
    for number, angle in enumerate(q):
        data.joint(model.actuator(number).name).qpos[0] = angle - 0.1 * side
    for left in np.linspace(0.1, 0.0, 3000):
        data.ctrl[:] = q - side * left
        mujoco.mj_step(model, data)
    mujoco.mj_step(model, data, 1500)
    return np.array(data.site("tcp").xpos)


SOFT_AT_ITS_ROOT = {
    "lateral_compliance.link2.k_x_rad_per_Nm": 0.01,
    "lateral_compliance.link2.k_y_rad_per_Nm": 0.02,
    "lateral_compliance.link2.s_ratio": 0.2,
}


@pytest.mark.long
@pytest.mark.parametrize(
    ("names", "more"),
    [
        (("offsets", "compliance", "lateral_compliance@link2", "base_compliance"), {}),
        (("offsets", "compliance", "lateral_compliance@link2"), SOFT_AT_ITS_ROOT),
        (("offsets", "compliance", "backlash@joint3", "mass@link4"), {}),
        (("compliance", "gravity"), {}),
    ],
)
def test_mujoco_comes_to_rest_where_our_equilibrium_is(
    so101: Arm, own: Path, tmp_path: Path, names: tuple[str, ...], more: dict[str, float]
) -> None:
    model = hidden(so101, *names, **more)
    out = tmp_path / "elsewhere" / "patched.xml"
    out.parent.mkdir()
    file = patched_mjcf(model, read_mjcf(own), out, tip="tcp")
    out.write_text(file.text)
    assert file.left_out == ()
    for q in np.random.default_rng(1).uniform(-0.8, 0.8, (2, 5)):
        drawn, ours = (solve_equilibrium(m, poses_of(q)).tcp[0] for m in (model_of(so101, ()), model))
        assert np.linalg.norm(drawn - ours) > 5e-3
        assert np.linalg.norm(at_rest(out, q) - ours) < 5e-5


def test_a_joint_with_friction_stops_short_on_either_side(so101: Arm, own: Path, tmp_path: Path) -> None:
    """MuJoCo's dry friction creeps: within 0.3 mm after a few seconds, of 5 mm between the sides."""
    model = hidden(so101, "compliance", "hysteresis@joint2", **{"hysteresis.joint2.h_rad": -0.02})
    out = tmp_path / "patched.xml"
    out.write_text(patched_mjcf(model, read_mjcf(own), out, tip="tcp").text)
    q = np.array([0.2, 0.3, -0.4, 0.2, 0.1])
    tips = {side: at_rest(out, q, side) for side in (-1.0, 1.0)}
    assert np.linalg.norm(tips[1.0] - tips[-1.0]) > 3e-3
    for side, tip in tips.items():
        ours = solve_equilibrium(model, Poses(q[None], np.zeros(1), np.full((1, 5), side))).tcp[0]
        assert np.linalg.norm(tip - ours) < 3e-4


def test_what_is_not_the_arms_is_kept(so101: Arm, own: Path, tmp_path: Path) -> None:
    out = tmp_path / "patched.xml"
    model = hidden(so101, "offsets", "servo_gain@joint1", "hysteresis@joint3")
    file = patched_mjcf(model, read_mjcf(own), out, tip="tcp")
    out.write_text(file.text)
    assert file.left_out == ("hysteresis@joint3 (it overshoots)", "servo_gain@joint1")
    before, after = (mujoco.MjModel.from_xml_path(str(path)) for path in (own, out))
    assert after.nmesh == before.nmesh == 1
    np.testing.assert_array_equal(after.mesh_vert, before.mesh_vert)
    assert after.actuator("elbow_flex").gainprm[0] == before.actuator("elbow_flex").gainprm[0]


def test_an_arm_is_read_from_an_mjcf_whatever_its_joints_are_drawn_at(own: Path, so101: Arm) -> None:
    """Angles in degrees, a joint drawn at 20°, an anchor beside its body's origin: the same arm."""
    text = own.read_text().replace('angle="radian"', 'angle="degree"')
    start = text.index('<joint name="elbow_flex"')
    text = text[:start] + text[start:].replace("<joint ", '<joint ref="20" pos="0.01 -0.02 0.03" ', 1)
    own.write_text(text)
    robot = read_mjcf(own)
    found = import_arm(robot.robot, None, "tcp", "again")
    assert found.difference < 1e-9
    assert [joint.name for joint in found.arm.joints] == [joint.name for joint in so101.joints]
    data: Any = mujoco.MjData(robot.compiled)
    q = np.array([0.1, -0.4, 0.3, 0.2, 0.5])
    for joint, angle in zip(found.arm.joints, q, strict=True):
        data.joint(joint.name).qpos[0] = angle
    mujoco.mj_kinematics(robot.compiled, data)
    tip = solve_equilibrium(model_of(found.arm, ()), poses_of(q)).tcp[0]
    np.testing.assert_allclose(data.site("tcp").xpos, tip, atol=1e-9)


def test_the_command_says_what_is_wrong_in_one_line(own: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.xml"
    said = stdout_of("arm", "export", "so101", "--mjcf", own, "--tip", "tcp", "-o", out)
    assert "own.xml with the model in it" in said
    assert "is this another arm" in stderr_of("arm", "export", "ur5", "--mjcf", own, "--tip", "tcp", "-o", out)
    (tmp_path / "bad.xml").write_text("<mujoco><worldbody><body/></mujoco>")
    assert "bad.xml: MuJoCo:" in stderr_of("arm", "export", "so101", "--mjcf", tmp_path / "bad.xml", "-o", out)
    assert "no such file" in stderr_of("arm", "export", "so101", "--mjcf", tmp_path / "none.xml", "-o", out)


@pytest.mark.long
def test_variants_spread_as_the_covariance_says(own: Path, tmp_path: Path) -> None:
    sd = math.degrees(0.01)
    (tmp_path / "model.toml").write_text(
        'schema = "lrm/model/1"\narm = "so101"\neffects = ["offsets@joint2", "compliance@joint2"]\n[parameters]\n'
        '"offsets.joint2.theta_rad" = 0.03\n"compliance.joint2.k_rad_per_Nm" = 0.0\n[sigma]\n'
        '"offsets.joint2.theta_rad" = 0.01\n"compliance.joint2.k_rad_per_Nm" = 0.02\n[covariance]\n'
        'keys = ["offsets.joint2.theta_rad", "compliance.joint2.k_rad_per_Nm"]\ncorrelation = [0.5]\n'
    )
    out = tmp_path / "arm.xml"
    stdout_of("arm", "export", tmp_path / "model.toml", "--mjcf", own, "--tip", "tcp", "--draws", "40", "-o", out)
    files = sorted(tmp_path.glob("arm-*.xml"))
    assert len(files) == 40
    lifts, gains = [], []
    for path in files:
        compiled = mujoco.MjModel.from_xml_path(str(path))
        w, x, y, z = compiled.body("joint2.theta").quat
        lifts.append([w, x, y, z])
        gains.append(compiled.actuator("shoulder_lift").gainprm[0])
    turns = [2 * math.degrees(math.acos(min(1.0, abs(float(np.dot(lifts[0], other)))))) for other in lifts[1:]]
    assert 0.5 * sd < np.std(turns) + np.mean(turns) < 4.0 * sd
    assert min(gains) > 0.0
    assert "covariance" in stderr_of("arm", "export", "so101", "--draws", "2", "-o", tmp_path / "x.xml")


def test_gravity_goes_in_and_out_in_the_frame_of_the_arms_own_base(own: Path, tmp_path: Path) -> None:
    """A robot that hangs on a wall in its file; the arm begins at its base, whose gravity is then sideways."""
    own.write_text(own.read_text().replace('<body name="base_link">', '<body name="base_link" euler="0 1.5708 0">'))
    robot = read_mjcf(own).robot
    arm = import_arm(robot, "base_link", "tcp").arm
    np.testing.assert_allclose(arm.gravity, (9.81, 0.0, 0.0), atol=1e-4)
    assert import_arm(robot, tip="tcp").arm.gravity == (0.0, 0.0, -9.81)
    leaning = model_of(arm, effects_at(arm, "gravity"), {"gravity.base.y_rad": 0.1})
    out = tmp_path / "patched.xml"
    out.write_text(patched_mjcf(leaning, read_mjcf(own), out, "base_link", "tcp").text)
    again = import_arm(read_mjcf(out).robot, "base_link", "tcp").arm
    np.testing.assert_allclose(again.gravity, leaning.constant_gravity, atol=2e-5)  # MuJoCo writes six digits
    assert abs(again.gravity[2]) > 0.9


def test_a_file_without_gravity_is_said(own: Path) -> None:
    own.write_text(own.read_text().replace('gravity="0.0 0.0 -9.81"', 'gravity="0 0 0"'))
    assert any("no gravity" in notice for notice in import_arm(read_mjcf(own).robot, tip="tcp").notices)
