"""The gate of plausibility that an imported arm passes, who knows better, and the file that `arm new` writes."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from lrm_ident.data.robot_files.arm_text import template
from lrm_math.arm.arm_file import read_arm
from tests.support.broken_output import closed_pipe
from tests.support.commands import run_command, stderr_of, stdout_of

LENGTH, WIDTH, DENSITY = 0.2, 0.05, 500.0


def robot(mass: float = 1.0, moments: float = 1.0, limits: str = 'lower="-2" upper="2"', efforts: str = "321") -> str:
    """Three boxes of one density on three joints; masses and moments of inertia so many times too large."""
    parts, before = ['<link name="base"/>'], "base"
    for number, effort in enumerate(efforts, start=1):
        kg = DENSITY * LENGTH * WIDTH**2
        across, along = kg * (LENGTH**2 + WIDTH**2) / 12, kg * 2 * WIDTH**2 / 12
        tensor = f'ixx="{moments * along}" iyy="{moments * across}" izz="{moments * across}" ixy="0" ixz="0" iyz="0"'
        inertial = f'<origin xyz="{LENGTH / 2} 0 0"/><mass value="{mass * kg}"/><inertia {tensor}/>'
        ends = f'<parent link="{before}"/><child link="l{number}"/><origin xyz="{LENGTH if number > 1 else 0} 0 0"/>'
        more = f'<axis xyz="0 1 0"/><limit {limits} effort="{effort}" velocity="1"/>'
        parts.append(f'<link name="l{number}"><inertial>{inertial}</inertial></link>')
        parts.append(f'<joint name="j{number}" type="revolute">{ends}{more}</joint>')
        before = f"l{number}"
    tool = f'<parent link="{before}"/><child link="tip"/><origin xyz="{LENGTH} 0 0"/>'
    return f'<robot name="r">{"".join(parts)}<link name="tip"/><joint name="t" type="fixed">{tool}</joint></robot>'


def imported(text: str, folder: Path, *more: str) -> tuple[int, str, Path]:
    path, arm = folder / "arm.urdf", folder / "arm.toml"
    path.write_text(text)
    code, _, stderr = run_command("arm", "import", path, "-o", arm, *more)
    return code, " ".join(stderr.split()), arm


BROKEN = {
    "mass": (robot(mass=10.0), "the masses look too large"),
    "mass ": (robot(mass=40.0, moments=40.0), "own weight loads j1"),
    "limits": (robot(limits='lower="-175" upper="175"'), "joint j1: limits -175 to 175 rad look like degrees"),
    "size": (re.sub(r'xyz="0\.2 0 0"', 'xyz="0.002 0 0"', robot()), "the arm is 6 mm long"),
}


@pytest.mark.long
@pytest.mark.parametrize("rule", BROKEN)
def test_what_is_implausible_is_refused_and_written_where_a_person_knows_better(rule: str, tmp_path: Path) -> None:
    """The option that the message names is the one that works, and the arm file is readable thereafter."""
    text, said = BROKEN[rule]
    code, stderr, arm = imported(text, tmp_path)
    assert code == 2
    assert said in stderr
    assert not arm.exists()
    option = re.findall(r"--accept ([\w-]+)", stderr)
    assert set(option) == {rule.strip()}
    code, stderr, arm = imported(text, tmp_path, "--accept", option[0])
    assert code == 0, stderr
    assert f'accepted = ["{rule.strip()}"]' in arm.read_text()
    stdout_of("arm", "show", arm)


def test_a_plausible_arm_is_not_suspected(tmp_path: Path) -> None:
    code, stderr, arm = imported(robot(), tmp_path)
    assert (code, stderr) == (0, "")
    assert "accepted" not in arm.read_text()
    code, stderr, arm = imported(robot(), tmp_path, "--accept", "mass")
    assert "accepted" not in arm.read_text(), "what is not broken needs nobody's word"


@pytest.mark.parametrize(("moments", "efforts"), [(1e-6, "321"), (1.0, "111"), (0.0, "321")])
def test_one_sign_of_heavy_masses_is_a_notice_at_most(moments: float, efforts: str, tmp_path: Path) -> None:
    """Moments of inertia and efforts are often made up: neither keeps an arm from being read."""
    code, stderr, _ = imported(robot(moments=moments, efforts=efforts), tmp_path)
    assert code == 0
    assert ("are the masses right?" in stderr) == (moments == 1e-6)


@pytest.mark.parametrize(
    ("limit", "code", "said"),
    [
        (10000, 0, "limits -10000 to 10000 rad cut to one turn either way"),
        (0, 2, "j1: limits 0 to 0 rad; lower < upper"),
    ],
)
def test_limits_beyond_a_turn_are_cut_and_none_are_refused(limit: int, code: int, said: str, tmp_path: Path) -> None:
    ended, stderr, _ = imported(robot(limits=f'lower="{-limit}" upper="{limit}"'), tmp_path)
    assert ended == code
    assert said in stderr


def test_an_arm_file_says_how_to_accept_and_that_works(tmp_path: Path) -> None:
    _, _, arm = imported(robot(), tmp_path)
    arm.write_text(re.sub(r"mass_g = ([\d.]+)", lambda found: f"mass_g = {float(found[1]) * 1e3}", arm.read_text()))
    said = stderr_of("arm", "show", arm)
    line = said.partition("write ")[2].partition(" below name")[0]
    arm.write_text(re.sub(r"(?m)^(name = .*)$", rf"\1\n{line}", arm.read_text(), count=1))
    stdout_of("arm", "show", arm)


def test_an_unknown_rule_is_named(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(robot())
    said = stderr_of("arm", "import", tmp_path / "arm.urdf", "--accept", "weight", "-o", tmp_path / "arm.toml")
    assert "centre-of-mass" in said


@pytest.mark.long
def test_a_reader_that_leaves_takes_no_file_along(tmp_path: Path) -> None:
    """`arm import … | head` writes the arm file."""
    path, arm, pipe = tmp_path / "arm.urdf", tmp_path / "arm.toml", closed_pipe()
    path.write_text(robot())
    words = ["arm", "import", str(path), "-o", str(arm)]
    done = subprocess.run([sys.executable, "-m", "lrm_ident", *words], stdout=pipe, stderr=subprocess.PIPE, check=False)
    os.close(pipe)
    assert (done.returncode, done.stderr) == (0, b"")
    assert arm.exists()


@pytest.mark.parametrize(("said", "rule"), [("9.81,0,0", ""), ("0,0,-9810", "gravity"), ("1,2", "--gravity")])
def test_an_arm_on_a_wall_is_told_where_down_is(said: str, rule: str, tmp_path: Path) -> None:
    code, stderr, arm = imported(robot(), tmp_path, "--gravity", said)
    assert code == (2 if rule else 0)
    assert rule in stderr
    if not rule:
        assert "gravity_m_per_s2 = [9.81, 0.0, 0.0]" in arm.read_text()
        assert "gravity is 9.81, 0, 0 m/s2 along x, y, z of 'base'" in stderr


def test_the_shapes_in_its_comments_are_shapes_when_the_marks_are_taken_away(tmp_path: Path) -> None:
    text = template("my-arm")
    start = text.index("# [[capsule]]")
    shaped = text[:start] + "\n".join(line.removeprefix("#").strip() for line in text[start:].splitlines())
    for name, written, capsules, boxes in (("plain", text, 0, 0), ("shaped", shaped, 1, 1)):
        path = tmp_path / f"{name}.toml"
        path.write_text(written, encoding="utf-8")
        arm = read_arm(path)
        assert arm.name == "my-arm"
        assert (len(arm.shapes.capsules), len(arm.shapes.boxes)) == (capsules, boxes)
