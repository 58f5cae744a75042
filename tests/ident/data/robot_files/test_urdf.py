"""URDF in and out: exact against the URDF's own kinematics, our own, and pinocchio; bad files in one line."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.data.robot_files.arm_text import arm_text
from lrm_ident.data.robot_files.urdf import Urdf, parse_urdf, read_urdf, tip_pose
from lrm_ident.data.robot_files.urdf_arm import import_arm, largest_difference
from lrm_ident.data.robot_files.urdf_export import bare_urdf, corrected_urdf, exported_difference, rigid_part
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm, read_arm
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of
from tests.support.commands import run_command, stderr_of, stdout_of
from tests.support.random_arms import arms, random_arm
from tests.support.sweep import examples

EXACT = 1e-12
TIP = "gripper_frame_link"
AXES = ((0, 0, 1), (0, 1, 0), (1, 0, 0), (0, 0, -1), (0.6, 0, -0.8), (0, 0, 1))


def random_robot(seed: int, joints: int, nearly_parallel: bool) -> str:
    """A URDF of any shape: fixed joints between, other branches, axes in any direction or a hair from parallel."""
    rng = np.random.default_rng(seed)
    lines, parent = ['<robot name="any"><link name="base"/>'], "base"
    for number in range(1, joints + 1):
        turn = rng.normal(0, 1e-6, 3) if nearly_parallel else rng.uniform(-math.pi, math.pi, 3)
        axis = (0, 0, 1) if nearly_parallel else AXES[int(rng.integers(len(AXES)))]
        lines.append(_link(f"l{number}", rng) + _joint(f"j{number}", "revolute", parent, f"l{number}", rng, turn, axis))
        parent = f"l{number}"
        if rng.random() < 0.5:
            free = rng.uniform(-1, 1, 3)
            lines.append(_link(f"f{number}", rng) + _joint(f"k{number}", "fixed", parent, f"f{number}", rng, free))
            parent = f"f{number}"
    lines.append(_link("cover", rng) + _joint("c", "fixed", "l1", "cover", rng, rng.normal(0, 1, 3)))
    lines.append('<link name="tip"/>' + _joint("t", "fixed", parent, "tip", rng, rng.normal(0, 1, 3)) + "</robot>")
    return "\n".join(lines)


def _link(name: str, rng: np.random.Generator) -> str:
    at = " ".join(map(repr, rng.normal(0, 0.05, 3).tolist()))
    mass = f'<inertial><origin xyz="{at}"/><mass value="{rng.uniform(0.01, 0.3)}"/></inertial>'
    return f'<link name="{name}">{mass}</link>'


def _joint(
    name: str, kind: str, parent: str, child: str, rng: np.random.Generator, turn: Array, axis: tuple[float, ...] = ()
) -> str:
    xyz, rpy = (" ".join(map(repr, values.tolist())) for values in (rng.uniform(-0.15, 0.15, 3), np.asarray(turn)))
    inner = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="{xyz}" rpy="{rpy}"/>'
    if axis:
        inner += f'<axis xyz="{" ".join(map(str, axis))}"/><limit lower="-2" upper="2.5" effort="1" velocity="1"/>'
    return f'<joint name="{name}" type="{kind}">{inner}</joint>'


def robot_of(text: str) -> Urdf:
    return parse_urdf(Path("robot.urdf"), text)


@pytest.fixture
def so101_urdf(shared: Path) -> Path:
    path = shared / "data" / "so101" / "so101_new_calib.urdf"
    if not path.exists():
        pytest.skip("the SO-101's URDF is not in ../shared")
    return path


def through_file(arm: Arm, folder: Path) -> Arm:
    path = folder / "arm.toml"
    path.write_text(arm_text(arm, "a test"))
    return read_arm(path)


def test_so101_round_trip(so101_urdf: Path, tmp_path: Path) -> None:
    robot = read_urdf(so101_urdf)
    found = import_arm(robot, tip=TIP)
    arm = through_file(found.arm, tmp_path)
    path = robot.chain(robot.root, TIP)
    assert largest_difference(model_of(arm, ()), path, seed=5) < EXACT
    again = import_arm(robot_of(corrected_urdf(model_of(arm, ()), robot, tip=TIP)), tip=TIP).arm
    assert largest_difference(model_of(again, ()), path, seed=6) < EXACT
    moving = sum(mass.mass for link, mass in robot.links.items() if mass and link != "base_link")
    assert sum(body.mass for body in arm.bodies) == pytest.approx(moving, abs=1e-12)


def test_the_shipped_so101_is_that_of_the_urdf(so101_urdf: Path) -> None:
    robot = read_urdf(so101_urdf)
    arm = load_arm("so101")
    assert largest_difference(model_of(arm, ()), robot.chain(robot.root, TIP)) < 2e-5
    assert [joint.name for joint in arm.joints] == [j.name for j in robot.chain(robot.root, TIP) if j.turns]
    q = poses_of(np.random.default_rng(0).uniform(-1, 1, (20, 5)))
    imported = solve_equilibrium(model_of(import_arm(robot, tip=TIP).arm, ()), q).joint_torque
    np.testing.assert_allclose(solve_equilibrium(model_of(arm, ()), q).joint_torque, imported, atol=2e-5)


@pytest.mark.parametrize("nearly_parallel", [False, True])
@pytest.mark.parametrize("seed", range(5))
def test_ten_random_robots(seed: int, nearly_parallel: bool, tmp_path: Path) -> None:
    robot = robot_of(random_robot(seed, 1 + 2 * seed % 7, nearly_parallel))
    arm = through_file(import_arm(robot, tip="tip").arm, tmp_path)
    assert largest_difference(model_of(arm, ()), robot.chain("base", "tip"), seed=9) < EXACT


@pytest.mark.long
@examples(7, 15)
@given(arms, st.integers(0, 1000))
def test_our_arms_through_urdf_and_back(arm: Arm, seed: int) -> None:
    arm = replace(arm, gravity=(0.0, 0.0, -9.81), bodies=tuple(b for b in arm.bodies if b.frame <= len(arm.links)))
    back = import_arm(bare_urdf(arm)).arm
    q = poses_of(np.random.default_rng(seed).uniform(-2, 2, (10, arm.dof)), 0.0)
    ours, theirs = (solve_equilibrium(model_of(one, ()), q) for one in (arm, back))
    np.testing.assert_allclose(theirs.tcp, ours.tcp, atol=EXACT)
    np.testing.assert_allclose(theirs.joint_torque, ours.joint_torque, atol=1e-11)


def calibrated(arm: Arm, seed: int) -> Model:
    effects = [effect for name in ("offsets", "compliance", "backlash@joint1") for effect in effects_at(arm, name)]
    rng = np.random.default_rng(seed)
    empty = model_of(arm, effects)
    sizes = {k: float(abs(rng.normal(0, 0.4)) * p.typical) for k, p in zip(empty.keys, empty.parameters, strict=True)}
    return model_of(arm, effects, {key: size for key, size in sizes.items() if "tau0" not in key})


@pytest.mark.parametrize("seed", range(4))
def test_corrected_urdf_is_our_rigid_model(seed: int) -> None:
    robot = robot_of(random_robot(seed, 3 + seed, False))
    model = calibrated(import_arm(robot, tip="tip").arm, seed)
    text = corrected_urdf(rigid_part(model), robot, tip="tip")
    corrected = robot_of(text)
    path = corrected.chain("base", "tip")
    rigid = rigid_part(model)
    q = np.random.default_rng(seed).uniform(-1.5, 2, (20, model.arm.dof))
    ours = solve_equilibrium(rigid, poses_of(q)).tcp
    theirs = np.array([tip_pose(path, angles)[:3, 3] for angles in q.tolist()])
    np.testing.assert_allclose(theirs, ours, atol=EXACT)
    assert np.abs(ours - solve_equilibrium(model_of(model.arm, ()), poses_of(q)).tcp).max() > 1e-3
    assert [(j.name, j.parent, j.child, j.axis) for j in corrected.joints.values()] == [
        (j.name, j.parent, j.child, j.axis) for j in robot.joints.values()
    ]


def test_pinocchio_loads_the_corrected_urdf(tmp_path: Path) -> None:
    pin = pytest.importorskip("pinocchio", reason="pinocchio is not installed (extra 'bench')")
    robot = robot_of(random_robot(7, 6, False))
    model = calibrated(import_arm(robot, tip="tip").arm, 7)
    path = tmp_path / "corrected.urdf"
    path.write_text(corrected_urdf(rigid_part(model), robot, tip="tip"))
    peer = pin.buildModelFromUrdf(str(path))
    data, tip = peer.createData(), peer.getFrameId("tip")
    for q in np.random.default_rng(1).uniform(-1.5, 2, (20, 6)):
        pin.framesForwardKinematics(peer, data, q)
        ours = solve_equilibrium(rigid_part(model), poses_of(q)).tcp[0]
        np.testing.assert_allclose(data.oMf[tip].translation, ours, atol=1e-9)


def test_a_tip_without_a_fixed_joint_gets_one() -> None:
    text = random_robot(3, 4, False)
    robot = robot_of(text)
    model = rigid_part(calibrated(import_arm(robot, tip="l4").arm, 3))
    written = corrected_urdf(model, robot, tip="l4")
    assert exported_difference(model, written, None, "l4") < EXACT


def test_what_is_kept_stays_as_drawn() -> None:
    model = calibrated(random_arm(1, 4), 1)
    kept = rigid_part(model, keep=("base", "tool"))
    assert all(kept.value(key) == 0.0 for key in kept.keys if key.startswith(("offsets.base", "offsets.tool")))
    assert kept.value("offsets.joint2.a_mm") == model.value("offsets.joint2.a_mm")


FAULTS = {
    "not valid XML": "<robot",
    "<sdf>": "<sdf/>",
    "no <link>": '<robot name="x"/>',
    "no link 'b'": '<robot><link name="a"/><joint name="j"><parent link="a"/><child link="b"/></joint></robot>',
    "two links of one name": '<robot><link name="a"/><link name="a"/></robot>',
    "two joints of one name: j2": random_robot(1, 3, False).replace('joint name="j3"', 'joint name="j2"', 1),
    "prismatic": random_robot(1, 3, False).replace('"revolute"', '"prismatic"', 1),
    "without <limit>": random_robot(1, 3, False).replace('<limit lower="-2" upper="2.5" effort="1" velocity="1"/>', ""),
    "no direction": random_robot(1, 1, True).replace('<axis xyz="0 0 1"/>', '<axis xyz="0 0 0"/>'),
    "should be 3 numbers": random_robot(1, 1, True).replace('<axis xyz="0 0 1"/>', '<axis xyz="0 nan 1"/>'),
    "name the measured one with --tip": random_robot(1, 3, False),
}


@pytest.mark.parametrize("words", FAULTS)
def test_a_bad_urdf_is_one_line(words: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.urdf"
    path.write_text(FAULTS[words])
    tip = ["--tip", "tip"] if 'link name="tip"' in FAULTS[words] and "--tip" not in words else []
    error = stderr_of("arm", "import", path, *tip, "-o", tmp_path / "arm.toml")
    assert words in error
    assert not (tmp_path / "arm.toml").exists()


@pytest.mark.long
def test_xacro(tmp_path: Path) -> None:
    pytest.importorskip("xacrodoc", reason="xacrodoc is not installed (extra 'xacro')")
    text = random_robot(2, 3, False).replace("<robot", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"', 1)
    path = tmp_path / "robot.urdf.xacro"
    path.write_text(text.replace("</robot>", '<xacro:property name="unused" value="1"/></robot>'))
    assert import_arm(read_urdf(path), tip="tip").arm == replace(
        import_arm(robot_of(random_robot(2, 3, False)), tip="tip").arm, name="any"
    )
    path.write_text(text.replace("</robot>", "<xacro:nothing/></robot>"))
    assert "xacro" in stderr_of("arm", "import", path, "-o", tmp_path / "arm.toml")


@pytest.mark.long
@pytest.mark.parametrize("sag", [0.0, 0.05])
def test_of_an_arm_that_sags_the_export_says_what_a_urdf_can_do(sag: float, tmp_path: Path) -> None:
    model = tmp_path / "model.toml"
    model.write_text(
        'schema = "lrm/model/1"\narm = "so101"\neffects = ["offsets", "compliance"]\n[parameters]\n'
        f'"offsets.joint2.theta_rad" = 0.02\n"compliance.joint2.k_rad_per_Nm" = {sag}\n'
    )
    code, out, said = run_command("arm", "export", model, "-o", tmp_path / "out.urdf")
    assert code == 0
    assert ("Not in it: compliance@joint2\n" in out) == (sag > 0.0), "what does nothing is not missed"
    assert ("--effects offsets" in " ".join(said.split())) == (sag > 0.0)


@pytest.mark.slow
def test_commands(so101_urdf: Path, tmp_path: Path) -> None:
    arm, out = tmp_path / "arm.toml", tmp_path / "corrected.urdf"
    assert "5 joints" in stdout_of("arm", "import", so101_urdf, "--tip", TIP, "-o", arm)
    assert "485 g" in stdout_of("arm", "show", arm, "--figure", tmp_path / "arm.png")
    stdout_of("arm", "export", "so101", "--urdf", so101_urdf, "--tip", TIP, "-o", out)
    assert out.read_text().count("<mesh") == so101_urdf.read_text().count("<mesh")
    assert "is this another arm" in stderr_of("arm", "export", "ur5", "--urdf", so101_urdf, "--tip", TIP, "-o", out)
    new = tmp_path / "new.toml"
    stdout_of("arm", "new", "-o", new)
    assert "6 joints" in stdout_of("arm", "show", new)
    assert "would overwrite" in stderr_of("arm", "new", "-o", new)


def on_the_wall(seed: int) -> str:
    """A robot whose root `world` holds the base of an arm sideways, by a bracket that turns further."""
    arm = random_robot(seed, 4, False).removeprefix('<robot name="any">').removesuffix("</robot>")
    rng = np.random.default_rng(seed)
    held = _joint("wall", "fixed", "world", "bracket", rng, rng.uniform(-math.pi, math.pi, 3))
    pan = _joint("mount", "fixed", "bracket", "base", rng, rng.uniform(-math.pi, math.pi, 3))
    return f'<robot name="any"><link name="world"/><link name="bracket"/>{held}{pan}{arm}</robot>'


@pytest.mark.long
@given(st.integers(0, 200))
def test_gravity_follows_the_link_that_the_arm_begins_at(seed: int) -> None:
    """Loads on the joints do not depend on which link the arm's frame is; gravity in it does, and that is said."""
    robot = parse_urdf(Path("wall.urdf"), on_the_wall(seed))
    whole, arm = import_arm(robot, tip="tip"), import_arm(robot, "base", "tip")
    assert whole.arm.gravity == (0.0, 0.0, -9.81)
    assert np.linalg.norm(arm.arm.gravity) == pytest.approx(9.81)
    assert any("as the file mounts it" in notice for notice in arm.notices)
    assert not any("as the file mounts it" in notice for notice in whole.notices)
    poses = poses_of(np.random.default_rng(seed).uniform(-1.0, 1.0, (5, arm.arm.dof)))
    in_world, in_base = (solve_equilibrium(model_of(one.arm, ()), poses) for one in (whole, arm))
    np.testing.assert_allclose(in_base.joint_torque, in_world.joint_torque, atol=1e-9)
    stands = robot.standing("base")
    np.testing.assert_allclose(in_base.tcp @ stands[:3, :3].T + stands[:3, 3], in_world.tcp, atol=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("gravity", [(9.81, 0.0, 0.0), (0.0, 0.0, 9.81), (1.2, -3.0, -9.0)])
def test_an_export_without_a_robot_is_mounted_alike(gravity: tuple[float, float, float], tmp_path: Path) -> None:
    """The file read back has the same loads on its joints; an upright arm's file needs no world."""
    arm = replace(load_arm("so101"), gravity=gravity)
    (tmp_path / "arm.toml").write_text(arm_text(arm, source="test"))
    stdout_of("arm", "export", tmp_path / "arm.toml", "-o", tmp_path / "out.urdf")
    robot = read_urdf(tmp_path / "out.urdf")
    assert robot.root == "world"
    again, size = import_arm(robot, "base_link").arm, np.linalg.norm(gravity)
    np.testing.assert_allclose(np.array(again.gravity) / 9.81, np.array(gravity) / size, atol=1e-12)
    assert import_arm(robot).arm.gravity == (0.0, 0.0, -9.81)
    stdout_of("arm", "export", "so101", "-o", tmp_path / "upright.urdf")
    assert read_urdf(tmp_path / "upright.urdf").root == "base_link"


LEROBOT = (*(f"q{number}" for number in range(1, 4)), "gripper")


def test_a_jaw_at_the_end_of_the_chain_is_no_joint_of_the_arm(tmp_path: Path) -> None:
    """Before: SO-100's URDF became an arm of six joints, and the jaw's percent were degrees."""
    links = "".join(
        f'<link name="l{k}"><inertial><origin xyz="0.02 0 0.03"/><mass value="0.15"/></inertial></link>'
        for k in range(5)
    )
    joints = "".join(
        f'<joint name="{name}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/>'
        f'<origin xyz="0.1 0.01 0.05"/><axis xyz="{"0 1 0" if k % 2 else "0 0 1"}"/>'
        '<limit lower="-1.5" upper="1.5" effort="5" velocity="1"/></joint>'
        for k, name in enumerate(LEROBOT)
    )
    urdf, arm = tmp_path / "arm.urdf", tmp_path / "arm.toml"
    urdf.write_text(f'<robot name="a">{links}{joints}</robot>')
    code, _, said = run_command("arm", "import", urdf, "-o", arm)
    assert code == 0
    assert "joint gripper is the gripper's: the arm ends at l3 (else: --tip l4)" in " ".join(said.split())
    imported = load_arm(arm)
    assert [joint.name for joint in imported.joints] == ["q1", "q2", "q3"]
    assert sum(body.mass for body in imported.bodies) == pytest.approx(0.6)  # the jaw's mass is carried along
    stdout_of("arm", "import", urdf, "--tip", "l4", "-o", tmp_path / "all.toml")
    assert load_arm(tmp_path / "all.toml").dof == 4


def test_a_shape_without_a_mass_is_told() -> None:
    """Before: its link weighed nothing, without a word. A link of frames alone has no shape."""
    text = random_robot(3, 3, False)
    bare = re.sub(r'<link name="l2"><inertial>.*?</inertial>', '<link name="l2"><visual/>', text, count=1)
    assert "link 'l2' has a shape and no mass: it counts as weightless" in robot_of(bare).notices
    assert not any("weightless" in words for words in robot_of(text).notices)
