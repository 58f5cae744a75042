"""Files of arms as vendors write them, and forty of a generator: MuJoCo has the same poses and torques."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lrm_ident.data.robot_files.mjcf_robot import read_robot
from lrm_ident.data.robot_files.urdf import read_urdf, read_whole_urdf
from lrm_ident.data.robot_files.urdf_arm import ImportedArm, import_arm
from lrm_math.arrays import Array
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from tests.support.commands import stderr_of, stdout_of
from tests.support.many_robots import many_robots
from tests.support.mujoco_robot import MujocoRobot
from tests.support.vendor_robots import MESH, SHAPES, XACRO, vendor_parts

MUJOCO_KEEPS = '<mujoco><compiler fusestatic="false" discardvisual="true"/></mujoco>'


def mujoco_statics(parts: str, q: Array) -> tuple[Array, Array]:
    """Positions (N, 3) of the link `tip` in the world (m) and gravity's torques (N, n) at angles (N, n), by MuJoCo."""
    mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed")
    model = mujoco.MjModel.from_xml_string(f'<robot name="v">{MUJOCO_KEEPS}{parts.replace(SHAPES, "")}</robot>')
    data: Any = mujoco.MjData(model)
    joints = [model.joint(f"j{number}").qposadr[0] for number in range(1, q.shape[1] + 1)]
    tips, torques = [], []
    for angles in q:
        data.qpos[:] = 0.0
        data.qpos[joints] = angles
        mujoco.mj_forward(model, data)
        tips.append(data.body("tip").xpos.copy())
        torques.append(data.qfrc_bias[joints].copy())
    return np.array(tips), np.array(torques)


def assert_agrees(found: ImportedArm, parts: str, seed: int) -> None:
    """An arm imported from the root has MuJoCo's kinematics, its torques from whichever base (1e-9 m, N·m)."""
    q = np.random.default_rng(seed).uniform(-1.5, 1.5, (5, found.arm.dof))
    tips, torques = mujoco_statics(parts, q)
    ours = solve_equilibrium(model_of(found.arm, ()), poses_of(q))
    np.testing.assert_allclose(np.abs(ours.joint_torque), np.abs(torques), atol=1e-9)
    assert np.abs(torques).max() > 0.01
    if found.base == "world":
        np.testing.assert_allclose(ours.tcp, tips, atol=1e-9)


WRITTEN: dict[str, Callable[[str], bytes]] = {
    "plain": lambda parts: f'<robot name="v">{parts}</robot>'.encode(),
    "blank lines first": lambda parts: f'\n \r\n<?xml version="1.0"?>\n<robot name="v">{parts}</robot>'.encode(),
    "latin-1": lambda parts: f'<?xml version="1.0" encoding="ISO-8859-1"?><robot name="Ärmel">{parts}</robot>'.encode(
        "latin-1"
    ),
    "undeclared latin-1": lambda parts: f'<robot name="v"><!-- © -->{parts}</robot>'.encode("latin-1"),
    "utf-16": lambda parts: f'<?xml version="1.0" encoding="UTF-16"?>\n<robot name="v">{parts}</robot>'.encode(
        "utf-16"
    ),
    "utf-16 without a mark": lambda parts: f'\n<?xml version="1.0"?><robot name="v">{parts}</robot>'.encode(
        "utf-16-be"
    ),
    "utf-8 with a mark": lambda parts: f'<?xml version="1.0"?><robot name="v">{parts}</robot>'.encode("utf-8-sig"),
    "says utf-16, is not": lambda parts: (
        f'<?xml version="1.0" encoding="utf-16"?><robot name="v">{parts}</robot>'.encode()
    ),
    "xacro in a comment": lambda parts: f'<robot name="v"{XACRO}><!-- <xacro:gripper/> -->{parts}</robot>'.encode(),
    "dead property": lambda parts: (
        f'<robot name="v"{XACRO}><xacro:property name="w" value="${{2*pi}}"/>{parts}</robot>'.encode()
    ),
    "dead macro, no namespace": lambda parts: (
        f'<robot name="v"><xacro:macro name="m"><xacro:insert_block name="b"/></xacro:macro>{parts}</robot>'.encode()
    ),
    "xacro in shapes": lambda parts: (
        f'<robot name="v">{parts.replace(MESH, "$(find none)/${part}.stl")}</robot>'.encode()
    ),
}


@pytest.mark.parametrize("suffix", [".urdf", ".xacro"])
@pytest.mark.parametrize("written", WRITTEN)
def test_a_vendors_file_is_read(written: str, suffix: str, tmp_path: Path) -> None:
    """Parts that kinematics and masses do not need keep no arm from being read, whatever the file's ending."""
    seed = list(WRITTEN).index(written) + 20 * (suffix == ".xacro")
    parts = vendor_parts(seed)
    path = tmp_path / f"arm{suffix}"
    path.write_bytes(WRITTEN[written](parts))
    found = import_arm(read_urdf(path), base=("base", None)[seed % 2], tip="tip")
    assert_agrees(found, parts, seed)
    assert any("Latin-1" in notice for notice in found.notices) == (written == "undeclared latin-1")


@pytest.mark.long
@pytest.mark.parametrize("suffix", [".urdf", ".xacro"])
def test_xacro_is_expanded_without_what_shapes_refer_to(suffix: str, tmp_path: Path) -> None:
    """Elements decide, not the ending; packages of meshes need not exist, in included files neither."""
    pytest.importorskip("xacrodoc", reason="xacrodoc is not installed (extra 'xacro')")
    parts = vendor_parts(7, SHAPES.replace(MESH, "$(find some_arm)/meshes/${part}.stl"))
    macro = f'<robot{XACRO}><xacro:macro name="arm">{parts}</xacro:macro></robot>'
    (tmp_path / "arm_macro.xacro").write_text(f'\n<?xml version="1.0"?>{macro}')
    path = tmp_path / f"arm{suffix}"
    plugin = '<gazebo><plugin filename="$(find no_such_package)/x.yaml"/></gazebo>'
    path.write_text(f'<robot name="v"{XACRO}><xacro:include filename="arm_macro.xacro"/><xacro:arm/>{plugin}</robot>')
    assert_agrees(import_arm(read_urdf(path), tip="tip"), vendor_parts(7), 7)


@pytest.mark.long
def test_an_export_of_a_xacro_keeps_its_meshes(tmp_path: Path) -> None:
    pytest.importorskip("xacrodoc", reason="xacrodoc is not installed (extra 'xacro')")
    path = tmp_path / "arm.xacro"
    parts = vendor_parts(3).replace('effort="50"', 'effort="${25*2}"')
    path.write_text(f'<robot name="v"{XACRO}>{parts}</robot>')
    arm, out = tmp_path / "arm.toml", tmp_path / "out.urdf"
    stdout_of("arm", "import", path, "--tip", "tip", "-o", arm)
    stdout_of("arm", "export", arm, "--urdf", path, "--tip", "tip", "-o", out)
    assert out.read_text().count(MESH) == parts.count(MESH) > 0
    assert len(read_whole_urdf(out).links) == parts.count("<link")


def test_the_remedy_for_a_package_that_is_not_found_works(tmp_path: Path) -> None:
    pytest.importorskip("xacrodoc", reason="xacrodoc is not installed (extra 'xacro')")
    folder = tmp_path / "copied" / "urdf"
    folder.mkdir(parents=True)
    (folder / "parts.xacro").write_text(f"<robot{XACRO}>{vendor_parts(4)}</robot>")
    path = folder / "arm.xacro"
    include = '<xacro:include filename="$(find own_arm)/urdf/parts.xacro"/>'
    path.write_text(f'<robot name="v"{XACRO}>{include}</robot>')
    assert "package.xml of own_arm" in stderr_of("arm", "import", path, "--tip", "tip", "-o", tmp_path / "arm.toml")
    (tmp_path / "copied" / "package.xml").write_text("<package><name>own_arm</name></package>")
    stdout_of("arm", "import", path, "--tip", "tip", "-o", tmp_path / "arm.toml")


@pytest.mark.parametrize("manifest", ["resources/package.xml", "stack/resources/package.xml", None])
def test_a_package_beside_the_files_own_is_found(manifest: str | None, tmp_path: Path) -> None:
    """As in a workspace of ROS: by its package.xml, whatever its folder is called; else by the folder's name."""
    pytest.importorskip("xacrodoc", reason="xacrodoc is not installed (extra 'xacro')")
    urdf, beside = tmp_path / "arm" / "urdf", (tmp_path / (manifest or "other_arm/x")).parent
    urdf.mkdir(parents=True)
    beside.mkdir(parents=True)
    (tmp_path / "arm" / "package.xml").write_text("<package><name>arm</name></package>")
    if manifest:
        (tmp_path / manifest).write_text("<package><name> other_arm </name></package>")
    (beside / "parts.xacro").write_text(f"<robot{XACRO}>{vendor_parts(4)}</robot>")
    include = '<xacro:include filename="$(find other_arm)/parts.xacro"/>'
    (urdf / "arm.xacro").write_text(f'<robot name="v"{XACRO}>{include}</robot>')
    assert_agrees(import_arm(read_urdf(urdf / "arm.xacro"), tip="tip"), vendor_parts(4), 4)


def test_arguments_of_xacro_are_given_by_an_option(tmp_path: Path) -> None:
    pytest.importorskip("xacrodoc", reason="xacrodoc is not installed (extra 'xacro')")
    path, arm = tmp_path / "arm.xacro", tmp_path / "arm.toml"
    head = f'<robot name="v"{XACRO}>'
    path.write_text(f"{head}{vendor_parts(2)}</robot>".replace('"l1"', '"l1_$(arg side)$(arg far)"'))
    said = stderr_of("arm", "import", path, "-o", arm)
    option = re.search(r"--xacro NAME:=VALUE", said)
    assert option, said
    stdout_of("arm", "import", path, "-o", arm, "--xacro", "side:=left", "--xacro", "far:=_arm")
    assert "l1_left" in arm.read_text()
    assert "should be NAME:=VALUE" in stderr_of(
        "arm", "import", path, "-o", tmp_path / "b.toml", "--xacro", "side=left"
    )


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b'<?xml version="1.0" encoding="klingon"?><robot/>', "its encoding is 'klingon', which is unknown"),
        (b'<robot name="v"><link name="a"></robot>', "not valid XML: mismatched tag"),
        (b"", "not valid XML"),
        ("<robot/>".encode("utf-16")[:-1], "its encoding is not 'utf-16'"),
        (b"<robot><link name='a'/><xacro:nothing/></robot>", "xacro"),
        (b"<robot><xacro:arg name='x'/><link name='$(arg x)'/></robot>", "give it a default"),
    ],
)
def test_what_cannot_be_read_is_one_line(content: bytes, said: str, tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_bytes(content)
    assert said in stderr_of("arm", "import", path, "-o", tmp_path / "arm.toml")


ROBOTS = many_robots()


def test_there_are_forty() -> None:
    assert len(ROBOTS) == 40


@pytest.mark.long
@pytest.mark.parametrize("name", ROBOTS)
def test_an_imported_arm_moves_and_sags_as_in_mujoco(name: str, tmp_path: Path) -> None:
    pytest.importorskip("mujoco", reason="mujoco is not installed")
    robot, ending = ROBOTS[name], ROBOTS[name].ending
    written, plain = tmp_path / f"written{ending}", tmp_path / ("plain.xml" if ending == ".xml" else "plain.urdf")
    written.write_bytes(robot.content)
    plain.write_text(robot.plain)
    found = import_arm(read_robot(written), base=robot.base, tip="tip")
    peer = MujocoRobot.of(plain, read_robot(plain), found)
    q = np.random.default_rng(len(name)).uniform(-1.2, 1.2, (5, found.arm.dof))
    ours = solve_equilibrium(model_of(found.arm, ()), poses_of(q))
    tips, torques = map(np.array, zip(*(peer.moved(angles) for angles in q), strict=True))
    np.testing.assert_allclose(ours.tcp, tips, atol=1e-9)
    np.testing.assert_allclose(ours.joint_torque, torques, atol=1e-9)
    assert np.abs(torques).max() > 0.01
