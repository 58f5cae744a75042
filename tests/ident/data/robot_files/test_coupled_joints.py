"""Joints that follow others: read, refused by name, and moved as MuJoCo moves them."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from lrm_ident.data.robot_files.arm_text import arm_text
from lrm_ident.data.robot_files.mjcf import mjcf
from lrm_ident.data.robot_files.mjcf_patch import patched_mjcf
from lrm_ident.data.robot_files.mjcf_robot import read_mjcf, read_robot
from lrm_ident.data.robot_files.urdf import parse_urdf
from lrm_ident.data.robot_files.urdf_arm import import_arm, largest_difference
from lrm_ident.data.robot_files.urdf_export import bare_urdf, corrected_urdf
from lrm_math.arm.arm import MOST_JOINTS, Arm
from lrm_math.arm.arm_file import load_arm, read_arm
from lrm_math.arrays import Array
from lrm_math.effects import effects_at
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import Equilibrium, solve_equilibrium
from lrm_math.model.model import Model, model_of
from tests.support.commands import run_command, stderr_of, stdout_of
from tests.support.mimic_robots import chain_mjcf, palletiser
from tests.support.sweep import seeds
from tests.support.vendor_robots import vendor_parts


def importing(folder: Path, text: str, name: str = "arm.urdf") -> list[object]:
    """The command that imports a robot's file with some text into `arm.toml` beside it."""
    (folder / name).write_text(text)
    return ["arm", "import", folder / name, "--tip", "tip", "-o", folder / "arm.toml"]


def imported(folder: Path, text: str, name: str = "arm.urdf") -> tuple[Arm, str]:
    """The arm of a robot's file, and what is said of it."""
    code, _, stderr = run_command(*importing(folder, text, name))
    assert code == 0, stderr
    return load_arm(folder / "arm.toml"), " ".join(stderr.split())


def following(name: str, mimic: str) -> str:
    """A vendor's robot one of whose joints follows another."""
    before, found, after = vendor_parts(1).partition(f'<joint name="{name}"')
    return f'<robot name="v">{before}{found}{after.replace("</joint>", f"<mimic {mimic}/></joint>", 1)}</robot>'


def coupled_urdf(multiplier: str) -> str:
    """A robot of five joints whose third follows its second."""
    return following("j3", f'joint="j2" {multiplier}')


@pytest.mark.parametrize(
    ("multiplier", "ratio", "offset"),
    [('multiplier="-1"', -1.0, 0.0), ('multiplier="0.5" offset="0.1"', 0.5, 0.1), ("", 1.0, 0.0)],
)
def test_a_mimic_joint_of_a_urdf_follows(multiplier: str, ratio: float, offset: float, tmp_path: Path) -> None:
    """It has no column in measurements; limits of the joint that it follows keep both within theirs."""
    arm, _ = imported(tmp_path, coupled_urdf(multiplier))
    assert (arm.dof, arm.link_places[:4]) == (3, ("joint1", "joint2", "mimic1", "joint3"))
    assert (arm.mimics[0].leader, arm.mimics[0].ratio) == (1, ratio)
    assert arm.mimics[0].offset == pytest.approx(offset)
    ends = sorted((limit - offset) / ratio for limit in (-2.0, 2.5))
    assert arm.joints[1].lower == pytest.approx(max(-2.0, ends[0]))
    assert arm.joints[1].upper == pytest.approx(min(2.5, ends[1]))


def test_a_follower_of_a_follower_follows_the_first_joint(tmp_path: Path) -> None:
    before, name, after = coupled_urdf('multiplier="-1" offset="0.2"').partition('<joint name="j4"')
    after = after.replace("</joint>", '<mimic joint="j3" multiplier="0.5"/></joint>', 1)
    arm, _ = imported(tmp_path, before + name + after)
    assert [(mimic.leader, mimic.ratio) for mimic in arm.mimics] == [(1, -1.0), (1, -0.5)]
    assert arm.mimics[1].offset == pytest.approx(0.1)


@pytest.mark.long
@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('joint="j2" ', 'joint="j9"', "joint j3: follows joint j9, which is none; valid: mount, j1"),
        ('joint="j2" ', 'joint="j3"', "joint j3: follows itself"),
        ('joint="j2" ', 'joint="mount"', "joint j3: follows joint mount, which is fixed; "),
        ('joint="j2" ', 'joint="jaw_joint"', "joint j3: follows joint jaw_joint, which is not between base and tip; "),
        ('joint="j2" ', 'joint="j2" multiplier="twice"', 'joint j3: multiplier="twice"'),
        (
            'joint="j2" ', 'joint="j2" offset="4.9"',
            "joint 2: its limits are -114.6 to 143.2 deg, those of a joint that follows it are -395.3 to -137.5",
        ),
        (
            'name="j3" type="revolute"', 'name="j3" type="prismatic"',
            "joint j3: is prismatic; an arm has revolute joints",
        ),
        ("<robot", "\n<<<<<<< HEAD\n<robot", "line 2 is a conflict that git left there: keep one of its two versions"),
    ],
)  # fmt: skip
def test_a_joint_that_cannot_be_read_is_named(old: str, new: str, said: str, tmp_path: Path) -> None:
    text = coupled_urdf("")
    assert old in text
    assert said in stderr_of(*importing(tmp_path, text.replace(old, new, 1)))


@pytest.mark.parametrize(
    ("stated", "lower", "upper"),
    [
        ((0.0, 6.283185307179586), -2.0, 2.5),  # as the description of a Dobot has it
        ((0.0, 0.0), -2.0, 2.5),
        ((-1.0, 3.0), -2.0, 1.0),
    ],
)
def test_limits_of_a_following_joint(stated: tuple[float, float], lower: float, upper: float, tmp_path: Path) -> None:
    """A whole turn, or none at all, limits nothing; else the joint that it follows stops with it, and that is told."""
    before, name, after = coupled_urdf('multiplier="-1"').partition('<joint name="j3"')
    after = after.replace('lower="-2.0" upper="2.5"', f'lower="{stated[0]}" upper="{stated[1]}"', 1)
    arm, notices = imported(tmp_path, before + name + after)
    assert (arm.joints[1].lower, arm.joints[1].upper) == pytest.approx((lower, upper))
    told = "j2: limits -114.6 to 143.2 deg become -114.6 to 57.3 deg, where j3 stops that follows it"
    assert (told in notices) == (upper < 2.0)


def test_a_rod_beside_the_arm_is_told(tmp_path: Path) -> None:
    """A body of an arm is fixed to one link; what swings with a joint beside the chain is taken as it stands."""
    _, notices = imported(tmp_path, following("jaw_joint", 'joint="j1" multiplier="-1"'))
    assert "the mass of 'jaw' beside the arm turns with joint j1: it counts as it stands at zero" in notices


@pytest.mark.parametrize("joints", [12, 17])
def test_an_arm_of_many_joints(joints: int, tmp_path: Path) -> None:
    """Up to 16; more are refused in one line."""
    path, output = tmp_path / "arm.urdf", tmp_path / "arm.toml"
    turns = '<axis xyz="0 1 0"/><limit lower="-1" upper="1"/><origin xyz="0 0.01 0.08"/>'
    parts = [
        f'<link name="l{k}"/><joint name="j{k}" type="revolute">'
        f'<parent link="l{k - 1}"/><child link="l{k}"/>{turns}</joint>'
        for k in range(1, joints + 1)
    ]
    path.write_text(f'<robot name="snake"><link name="l0"/>{"".join(parts)}</robot>')
    if joints <= MOST_JOINTS:
        stdout_of("arm", "import", path, "-o", output)
        assert load_arm(output).dof == joints
    else:
        assert "17 joints between base and tip; 1 to 16" in stderr_of("arm", "import", path, "-o", output)


BODIES = """<mujoco model="m"><compiler angle="radian"/><worldbody><body name="base" euler="0.3 0.2 0.1">
<geom type="box" size="0.03 0.03 0.03" mass="0.3"/>
<body name="a" pos="0 0 0.1"><joint name="j1" axis="0 0 1" range="-1.5 1.5" limited="true"/>
<geom type="capsule" fromto="0 0 0 0.1 0 0.05" size="0.02" mass="0.3"/>
<body name="b" pos="0.1 0.02 0.05" euler="0.1 0.4 0.2">
<joint name="j2" axis="0 1 0" pos="0.01 0 0.02" ref="0.2" range="-1 1" limited="true"/>
<joint name="j3" axis="0.3 0 1" pos="0 0.03 0.01" ref="-0.3" range="-1 1" limited="true"/>
<geom type="capsule" fromto="0 0 0 0.12 0 0.05" size="0.02" mass="0.2"/>
<body name="c" pos="0.15 0 0"><joint name="j4" axis="0 1 0" ref="0.1" range="-2 2" limited="true"/>
<geom type="capsule" fromto="0 0 0 0.05 0 0" size="0.02" mass="0.05"/><site name="tip" pos="0.05 0.01 0"/>
</body></body></body></body></worldbody>EQUALITY</mujoco>"""


def test_two_hinges_in_one_body_are_two_joints(tmp_path: Path) -> None:
    """Kinematics and gravity's torques are MuJoCo's own."""
    mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed")
    path = tmp_path / "arm.xml"
    path.write_text(BODIES.replace("EQUALITY", ""))
    arm = import_arm(read_mjcf(path).robot, tip="tip").arm
    peer = mujoco.MjModel.from_xml_path(str(path))
    data: Any = mujoco.MjData(peer)
    for q in np.random.default_rng(0).uniform(-1.0, 1.0, (10, 4)):
        data.qpos[:] = q
        mujoco.mj_forward(peer, data)
        ours = solve_equilibrium(model_of(arm, ()), poses_of(q))
        np.testing.assert_allclose(ours.tcp[0], data.site("tip").xpos, atol=1e-9)
        np.testing.assert_allclose(np.abs(ours.joint_torque[0]), np.abs(data.qfrc_bias), atol=1e-9)


def test_an_export_into_a_body_of_two_hinges_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("mujoco", reason="mujoco is not installed")
    imported(tmp_path, BODIES.replace("EQUALITY", ""), "arm.xml")
    arm, path = tmp_path / "arm.toml", tmp_path / "arm.xml"
    said = stderr_of("arm", "export", arm, "--mjcf", path, "--tip", "tip", "-o", tmp_path / "out.xml")
    assert f"{path}: joint j2: turns a body that another joint turns, too" in said


@pytest.mark.parametrize(
    ("equality", "said"),
    [
        ('<joint joint1="j4" joint2="j2" polycoef="0 0.5 0.2 0 0"/>', "joint j4: follows joint j2 by a polynomial"),
        ('<joint joint1="j4"/>', "joint j4: is held at 5.73 deg"),
        ('<joint joint1="j4" joint2="j1"/><joint joint1="j4" joint2="j2"/>', "joint j4: follows 2 joints at once"),
        ('<joint joint1="j4" joint2="j1" active="false"/>', ""),
    ],
)
def test_a_nonlinear_equality_of_joints_has_a_remedy(equality: str, said: str, tmp_path: Path) -> None:
    pytest.importorskip("mujoco", reason="mujoco is not installed")
    path, arm = tmp_path / "arm.xml", tmp_path / "arm.toml"
    words = importing(tmp_path, BODIES.replace("EQUALITY", f"<equality>{equality}</equality>"), path.name)
    if not said:
        stdout_of(*words)
        return
    error = stderr_of(*words)
    assert said in error
    assert str(path) in error
    assert not arm.exists()
    stdout_of("arm", "import", path, "--tip", error.partition("--tip ")[2].split()[0], "-o", arm)


def test_an_equality_that_closes_a_loop_is_told(tmp_path: Path) -> None:
    pytest.importorskip("mujoco", reason="mujoco is not installed")
    loop = '<equality><connect body1="c" body2="a" anchor="0 0 0"/></equality>'
    _, notices = imported(tmp_path, BODIES.replace("EQUALITY", loop), "arm.xml")
    assert "the <equality> of 1 <connect> is not read: joints that it couples count as free" in notices


@pytest.mark.parametrize("name", ["arm.xml", "arm.urdf"])
def test_meshes_need_not_exist_where_masses_are_written(name: str, tmp_path: Path) -> None:
    """Content decides what kind of file it is; where a mass is that of a mesh, its file is named."""
    pytest.importorskip("mujoco", reason="mujoco is not installed")
    mesh = '<asset><mesh name="part" file="none.stl"/></asset><worldbody>'
    text = BODIES.replace("EQUALITY", "").replace("<worldbody>", mesh, 1)
    part = '<geom type="mesh" mesh="part"/><body name="c"'
    written = '<inertial pos="0.05 0 0.02" mass="0.2" diaginertia="1e-4 1e-4 1e-4"/>'
    imported(tmp_path, text.replace('<body name="c"', written + part), name)
    (tmp_path / "arm.toml").unlink()
    said = stderr_of(*importing(tmp_path, text.replace('<body name="c"', part), name))
    assert str(tmp_path / name) in said
    assert "none.stl" in said


def test_an_mjcf_that_mujoco_does_not_open_by_its_name_is_named(tmp_path: Path) -> None:
    pytest.importorskip("mujoco", reason="mujoco is not installed")
    assert "name it .xml" in stderr_of(*importing(tmp_path, BODIES.replace("EQUALITY", ""), "arm.mjcf"))


class MujocoMechanism:
    """A robot in MuJoCo, its equalities of joints met exactly."""

    def __init__(self, model: Any, motors: list[str]) -> None:
        import mujoco

        self.mujoco, self.model, self.data = mujoco, model, mujoco.MjData(model)
        self.motors = [int(model.joint(name).qposadr[0]) for name in motors]

    def angles(self, q: Array) -> Array:
        """Angles of all joints, from those of the ones with a motor (rad)."""
        model, out = self.model, self.model.qpos0.copy()
        out[self.motors] = q
        for _ in range(model.neq):
            for first, second, data in zip(model.eq_obj1id, model.eq_obj2id, model.eq_data, strict=True):
                out[first] = model.qpos0[first] + data[0] + data[1] * (out[second] - model.qpos0[second])
        return np.asarray(out)

    def moved(self, q: Array) -> tuple[Array, Array]:
        """Position of the tip (m), and gravity's torque on the motors (N·m) by virtual work."""
        self.data.qpos[:] = self.angles(q)
        self.mujoco.mj_forward(self.model, self.data)
        at_zero = self.angles(np.zeros(len(q)))
        C = np.array([self.angles(one) - at_zero for one in np.eye(len(q))])
        tip = self.data.site("tip").xpos if self.model.nsite else self.data.body("tip").xpos
        return tip.copy(), -C @ self.data.qfrc_bias


def at_rest(arm: Arm, q: Array) -> Equilibrium:
    """The rigid arm at one pose."""
    return solve_equilibrium(model_of(arm, ()), poses_of(q))


@pytest.mark.parametrize("seed", seeds(3, 8))
def test_an_mjcf_with_joint_equalities_moves_as_in_mujoco(seed: int, tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed")
    path = tmp_path / "arm.xml"
    path.write_text(chain_mjcf(seed))
    found = import_arm(read_robot(path), tip="tip")
    peer = MujocoMechanism(mujoco.MjModel.from_xml_path(str(path)), [joint.name for joint in found.arm.joints])
    assert len(found.arm.mimics) == 1 + seed % 3
    for q in np.random.default_rng(seed).uniform(-1.0, 1.0, (5, found.arm.dof)):
        ours, (tip, torque) = at_rest(found.arm, q), peer.moved(q)
        np.testing.assert_allclose(ours.tcp[0], tip, atol=1e-9)
        np.testing.assert_allclose(ours.joint_torque[0], torque, atol=1e-9)


def test_a_palletiser_moves_as_in_mujoco() -> None:
    """The gripper stays level, and its forearm's direction is that of its own motor alone."""
    mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed")
    arm = import_arm(parse_urdf(Path("palletiser.urdf"), palletiser())).arm
    whole = palletiser().replace(
        '<link name="base"/>', '<mujoco><compiler fusestatic="false"/></mujoco><link name="base"/>'
    )
    spec = mujoco.MjSpec.from_string(whole)
    for leader, follower in (("rear", "rod"), ("front", "level")):
        spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, name1=follower, name2=leader, data=[0.0, -1.0] + [0.0] * 10)
    assert arm.link_places == ("joint1", "joint2", "mimic1", "joint3", "mimic2", "joint4")
    peer = MujocoMechanism(spec.compile(), [joint.name for joint in arm.joints])
    for q in np.random.default_rng(0).uniform(-0.3, 1.2, (5, 4)):
        ours, (tip, torque) = at_rest(arm, q), peer.moved(q)
        np.testing.assert_allclose(ours.tcp[0], tip, atol=1e-9)
        np.testing.assert_allclose(ours.joint_torque[0], torque, atol=1e-9)


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        (
            'joint = "joint2"',
            'joint = "joint9"',
            "joint 3: follow: joint = 'joint9'; should be a joint with a motor of its",
        ),
        ('joint = "joint2"', 'joint = "mimic2"', "own: joint1, joint2, joint3, joint4"),
        ("ratio = -1.0", "ratios = -1.0", "unknown key ratios"),
        ('frame = "mimic2"', 'frame = "mimic3"', "unknown frame 'mimic3'"),
    ],
)
def test_a_fault_of_a_following_joint_is_named(before: str, after: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "arm.toml"
    text = arm_text(import_arm(parse_urdf(Path("palletiser.urdf"), palletiser())).arm, "palletiser.urdf")
    path.write_text(text)
    assert read_arm(path).link_places == ("joint1", "joint2", "mimic1", "joint3", "mimic2", "joint4")
    assert before in text
    path.write_text(text.replace(before, after, 1))
    assert said in stderr_of("arm", "show", path)


def test_a_joint_is_followed_by_its_own_name_too(tmp_path: Path) -> None:
    path = tmp_path / "arm.toml"
    text = arm_text(import_arm(parse_urdf(Path("palletiser.urdf"), palletiser())).arm, "palletiser.urdf")
    path.write_text(text.replace('joint = "joint3"', 'joint = "front"'))
    assert [mimic.leader for mimic in read_arm(path).mimics] == [1, 2]


def errors_of(arm: Arm, seed: int) -> Model:
    """A model of an arm whose every dimension is a little off."""
    drawn = model_of(arm, effects_at(arm, "offsets"))
    return drawn.with_values(np.random.default_rng(seed).normal(0.0, 0.003, len(drawn.keys)))


@pytest.mark.long
@pytest.mark.parametrize("kind", ["urdf", "xml"])
@pytest.mark.parametrize("seed", range(3))
def test_what_is_exported_is_imported_again_the_same(seed: int, kind: str, tmp_path: Path) -> None:
    """Kinematics, torques and couplings, of a robot whose joints also follow at an offset."""
    pytest.importorskip("mujoco", reason="mujoco is not installed")
    path = tmp_path / "arm.xml"
    path.write_text(chain_mjcf(seed))
    arm = import_arm(read_robot(path), tip="tip").arm
    text = (
        ElementTree.tostring(bare_urdf(arm).tree, encoding="unicode")
        if kind == "urdf"
        else mjcf(model_of(arm, ())).text
    )
    path = tmp_path / f"again.{kind}"
    path.write_text(text)
    again = import_arm(read_robot(path), tip="tcp").arm
    assert again.link_places == arm.link_places
    for one, other in zip(arm.mimics, again.mimics, strict=True):
        assert (other.leader, other.after) == (one.leader, one.after)
        assert (other.ratio, other.offset) == pytest.approx((one.ratio, one.offset), abs=1e-12)
    q = np.random.default_rng(seed).uniform(-1.0, 1.0, (5, arm.dof))
    np.testing.assert_allclose(at_rest(again, q).tcp, at_rest(arm, q).tcp, atol=1e-9)
    milligrams = 1e-9 if kind == "urdf" else 2e-5  # N·m, of the bodies that MuJoCo wants to weigh something
    np.testing.assert_allclose(at_rest(again, q).joint_torque, at_rest(arm, q).joint_torque, atol=milligrams)


@pytest.mark.long
@pytest.mark.parametrize("kind", ["urdf", "xml"])
@pytest.mark.parametrize("seed", range(2))
def test_a_corrected_file_moves_as_the_model(seed: int, kind: str, tmp_path: Path) -> None:
    """Errors of joints that follow, and of those that lead them, are in the frames; its couplings stay as they were."""
    pytest.importorskip("mujoco", reason="mujoco is not installed")
    path = tmp_path / f"arm.{kind}"
    path.write_text(
        palletiser().replace("multiplier", 'offset="0.07" multiplier') if kind == "urdf" else chain_mjcf(seed)
    )
    robot = read_robot(path)
    model = errors_of(import_arm(robot).arm, seed)
    corrected = tmp_path / f"corrected.{kind}"
    if kind == "urdf":
        corrected.write_text(corrected_urdf(model, robot))
    else:
        corrected.write_text(patched_mjcf(model, read_mjcf(path), corrected).text)
    written = read_robot(corrected)
    tip = next(tip for tip in written.tips if not tip.endswith("_joint"))
    precision = 1e-9 if kind == "urdf" else 2e-5  # MuJoCo writes six digits
    assert largest_difference(model, written.chain(written.root, tip)) < precision
