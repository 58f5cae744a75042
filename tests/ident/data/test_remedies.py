"""Every documented form goes through every command; each remedy in a message works, and names options that exist."""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.main import get_command

import lrm_ident as lrm
from lrm_ident.cli.app import COMMANDS
from lrm_ident.cli.app import app as ident
from lrm_ident.data.rigid_motion import quaternions
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_file import load_arm
from lrm_math.effects import effects_at
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from lrm_math.model.sensed import tool_rotation
from tests.conftest import ROOT
from tests.ident.measuring.recordings.test_lerobot import written as dataset
from tests.support.commands import run_command, stdout_of
from tests.support.source_files import files, syntax_tree
from tests.support.sweep import in_soak
from tests.support.vendor_robots import vendor_parts

pytestmark = [pytest.mark.usefixtures("one_step_folds"), pytest.mark.long]


Words = tuple[object, ...]
NAMES = ("q1_deg", "q2_deg", "x_mm", "y_mm", "z_mm")
SAVETXT = re.compile(r"numpy\.savetxt\('data\.csv', A, (.*?)\) writes")


def table(poses: int = 24) -> np.ndarray:
    """(N, 5), joint angles and positions of a two-joint arm."""
    every = cells(load_arm("two-joint"), poses)
    return np.stack([every[name].astype(float) for name in NAMES], axis=1)


def text(rows: np.ndarray, names: tuple[str, ...] = NAMES) -> str:
    return "\n".join([",".join(names), *(",".join(map(repr, row)) for row in rows.tolist())]) + "\n"


def fit(path: Path, *options: str) -> Words:
    return ("fit", path, "--arm", "two-joint", "-o", path.parent / "model.toml", *options)


def put(path: Path, content: str | bytes) -> Path:
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


@dataclass(frozen=True)
class Advice:
    """A wrong input.

    Attributes:
        make: writes it into a folder, and gives the words of the command that refuses it.
        follow: does what the message advises, and gives the words of the command that then works.
    """

    make: Callable[[Path], Words]
    follow: Callable[[Path, str], Words]


def with_options(*words: str) -> Callable[[Path, str], Words]:
    """Follows a message by the options in it, added to the command on the same file."""

    def follow(folder: Path, said: str) -> Words:
        options = [
            part for found in re.findall(r"--[a-z-]+(?:=| )\S+", said) for part in re.split("[= ]", found, maxsplit=1)
        ]
        assert options, said
        return fit(folder / "data.csv", *words, *(option.rstrip(";,)") for option in options))

    return follow


def by_numpy(folder: Path, said: str) -> Words:
    """Runs the line of Python that a message advises."""
    given = SAVETXT.search(said)
    assert given, said
    words = ast.parse(f"f({given[1].replace('q1_deg,…', 'q1_deg,q2_deg')})", mode="eval").body
    assert isinstance(words, ast.Call)
    options = {str(word.arg): ast.literal_eval(word.value) for word in words.keywords}
    np.savetxt(folder / "data.csv", table(), **options)
    return fit(folder / "data.csv")


def as_table(folder: Path, said: str) -> Words:
    """Writes the CSV that a message asks for."""
    assert "CSV" in said
    return fit(put(folder / "data.csv", text(table())))


def numpy_file(folder: Path) -> Words:
    np.save(folder / "data.npy", table())
    return fit(folder / "data.npy")


def numpy_archive(folder: Path) -> Words:
    np.savez(folder / "data.npz", A=table())
    return fit(folder / "data.npz")


def metres(folder: Path) -> Words:
    rows = table()
    rows[:, 2:] *= 1e-3
    return fit(put(folder / "data.csv", text(rows)))


def mirrored(folder: Path) -> Words:
    rows = table(60)
    rows[:, 4] *= -1.0
    return fit(put(folder / "data.csv", text(rows)))


def radians(folder: Path) -> Words:
    rows = table()
    rows[:, :2] = np.radians(rows[:, :2])
    return fit(put(folder / "data.csv", text(rows)))


def a_bad_cell(folder: Path) -> Words:
    lines = text(table(30)).splitlines()
    lines[4] = lines[4].replace(lines[4].split(",")[2], "lost", 1)
    return fit(put(folder / "data.csv", "\n".join(lines) + "\n"))


def a_dataset(folder: Path) -> Words:
    poses = np.random.default_rng(1).uniform(-60.0, 60.0, (12, 5))
    return fit(dataset(folder / "recorded", poses, np.zeros_like(poses)))


def imported(folder: Path, said: str) -> Words:
    words = re.search(r"lrm-ident (import lerobot \S+ -o poses\.csv)", said)
    assert words, said
    return tuple(folder / "poses.csv" if word == "poses.csv" else word for word in words[1].split())


def in_the_dataset(folder: Path) -> Words:
    return ("checkup", Path(str(a_dataset(folder)[1])) / "data")


def the_folder(folder: Path, said: str) -> Words:
    assert "name the folder with meta and data in it" in said
    return ("checkup", folder / "recorded")


def several_tips(folder: Path) -> Words:
    camera = '<link name="camera"/><joint name="c" type="fixed"><parent link="l2"/><child link="camera"/></joint>'
    put(folder / "arm.urdf", f'<robot name="v">{vendor_parts(1)}{camera}</robot>')
    return ("arm", "import", folder / "arm.urdf", "-o", folder / "arm.toml")


def one_tip(folder: Path, said: str) -> Words:
    named = re.findall(r"(\w+) \(\d joints\)", said.partition("--tip: ")[2])
    assert named, said
    return (*several_tips(folder), "--tip", next(one for one in named if one != "camera"))


def there_already(folder: Path) -> Words:
    put(folder / "data.csv", text(table()))
    put(folder / "model.toml", "mine = 1\n")
    return fit(folder / "data.csv")


def elsewhere(folder: Path, said: str) -> Words:
    assert "another" in said
    return (*fit(folder / "data.csv")[:-1], folder / "other.toml")


def no_arm(folder: Path) -> Words:
    put(folder / "data.csv", text(table()))
    return ("fit", folder / "data.csv", "-o", folder / "model.toml")


def the_arm(folder: Path, said: str) -> Words:
    assert "--arm" in said
    return fit(folder / "data.csv")


def units_in_cells(folder: Path) -> Words:
    lines = text(table()).splitlines()
    cells = [lines[0], *(",".join(f"{cell} deg" for cell in line.split(",")) for line in lines[1:])]
    return fit(put(folder / "data.csv", "\n".join(cells) + "\n"))


def numbers_alone(folder: Path, said: str) -> Words:
    assert "write numbers alone, their unit in the header" in said
    assert "--bad-rows" not in said  # no row would be left
    return fit(put(folder / "data.csv", text(table())))


def so101_table(folder: Path, angles: Callable[[np.ndarray], np.ndarray]) -> Words:
    """Positions of an SO-101, folded back at one pose at least, its angles (N, n), deg, as a recording counts them."""
    arm = load_arm("so101")
    low, high = np.degrees([(joint.lower, joint.upper) for joint in arm.joints]).T
    q = np.random.default_rng(4).uniform(0.8 * low, 0.8 * high, (30, arm.dof))
    q[0, 1:3] = 0.95 * low[1], 0.95 * high[2]
    tips = 1e3 * solve_equilibrium(model_of(arm, ()), poses_of(np.radians(q))).tcp
    names = (*(f"q{number}_deg" for number in range(1, 6)), *NAMES[2:])
    path = put(folder / "data.csv", text(np.hstack([angles(q), tips]), names))
    return ("fit", path, "--arm", "so101", "-o", folder / "model.toml")


def older_zeros(folder: Path) -> Words:
    return so101_table(folder, lambda q: q * [1, -1, 1, 1, 1] + [0, 90, 90, 0, 0])


def converted(folder: Path, said: str) -> Words:
    """Applies the formulas that a message has for joints to the numbers that were recorded."""
    names = [str(joint.name) for joint in load_arm("so101").joints]
    told = re.findall(r"(\w+) = (-?)recorded ([+-][\d.]+) deg", said)
    assert {name for name, *_ in told} == {"shoulder_lift", "elbow_flex"}

    def angles(q: np.ndarray) -> np.ndarray:
        recorded = q * [1, -1, 1, 1, 1] + [0, 90, 90, 0, 0]
        for name, sign, added in told:
            column = names.index(name)
            recorded[:, column] = float(f"{sign}1") * recorded[:, column] + float(added)
        return recorded

    return so101_table(folder, angles)


def without_history(folder: Path) -> Words:
    data, bench = put(folder / "data.csv", text(table())), folder / "bench.toml"
    assert run_command("fit", data, "--arm", "two-joint", "-o", bench)[0] == 0
    put(folder / "bare.toml", bench.read_text().partition("[[history]]")[0])
    return ("transfer", folder / "bare.toml", data, "--to", "two-joint", "-o", folder / "model.toml")


def the_noise(folder: Path, said: str) -> Words:
    assert "state it with --noise-mm" in said
    words = ("transfer", folder / "bare.toml", folder / "data.csv", "--to", "two-joint", "-o", folder / "model.toml")
    return (*words, "--noise-mm", "0.3")


def a_board_too_wide(folder: Path) -> Words:
    return ("sockets", "board", "-o", folder / "board.pdf", "--length-mm", "300", "--width-mm", "250")


def a_shorter_one(folder: Path, said: str) -> Words:
    assert "choose a shorter --length-mm or --width-mm" in said
    return ("sockets", "board", "-o", folder / "board.pdf", "--length-mm", "120", "--width-mm", "80")


KINDS: dict[str, Advice] = {
    "numpy array": Advice(numpy_file, by_numpy),
    "numpy archive": Advice(numpy_archive, by_numpy),
    "MATLAB": Advice(lambda at: fit(put(at / "a.mat", b"MATLAB 5.0 MAT-file" + bytes(200))), as_table),
    "hand-eye pairs": Advice(
        lambda at: fit(put(at / "p.json", json.dumps([{"robot_pose": np.eye(4).tolist()}]))), as_table
    ),
    "hand-eye of a ROS package": Advice(
        lambda at: fit(put(at / "p.yaml", "parameters:\n  eye_on_hand: true\n")), as_table
    ),
    "JSON": Advice(lambda at: fit(put(at / "d.json", json.dumps({"q": table().tolist()}))), as_table),
    "a LeRobot dataset": Advice(a_dataset, imported),
    "inside a dataset": Advice(in_the_dataset, the_folder),
    "metres": Advice(metres, with_options()),
    "mirrored": Advice(mirrored, with_options()),
    "radians": Advice(radians, with_options()),
    "a cell that is no number": Advice(a_bad_cell, with_options()),
    "several tips": Advice(several_tips, one_tip),
    "a file that is there": Advice(there_already, elsewhere),
    "no arm": Advice(no_arm, the_arm),
    "units in the cells": Advice(units_in_cells, numbers_alone),
    "older zeros of LeRobot": Advice(older_zeros, converted),
    "a model without its error": Advice(without_history, the_noise),
    "a board wider than the paper": Advice(a_board_too_wide, a_shorter_one),
}


@pytest.mark.parametrize("name", KINDS)
def test_a_remedy_that_is_followed_works(name: str, tmp_path: Path) -> None:
    code, _, said = run_command(*KINDS[name].make(tmp_path))
    assert code == 2, said
    error = next(line for line in said.splitlines() if line.startswith("error: "))
    assert len(error.replace(str(tmp_path), "")) < 400
    code, _, after = run_command(*KINDS[name].follow(tmp_path, error))
    assert code == 0, f"{error}\n{after}"


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"#ROSBAG V2.0\n" + bytes(50), "is a bag of ROS 1; convert it"),
        (b"SQLite format 3\x00" + bytes(50), "is a bag of ROS 2 in SQLite; convert it"),
        (b"\x89MCAP0\r\n" + bytes(50), "is an MCAP recording; lrm-ident import"),
        (b"PAR1" + bytes(50), "is a parquet file; of a LeRobot dataset: lrm-ident import lerobot"),
        (b'{"shoulder_pan": {"homing_offset": 3}}', "is a calibration of LeRobot, which has no poses"),
        (b'{"homing_offset": [1], "motor_names": ["a"]}', "is a calibration of an older LeRobot"),
    ],
)
def test_files_of_other_kinds_are_named_in_one_line(content: bytes, said: str, tmp_path: Path) -> None:
    for words in (
        fit(put(tmp_path / "file", content)),
        ("import", tmp_path / "file", tmp_path / "file", "-o", "d.csv"),
    ):
        code, _, error = run_command(*words, *(() if words[0] == "fit" else ("--arm", "two-joint")))
        assert code == 2
        assert said in error or (words[0] == "import" and b"MCAP" in content)


OPTION = re.compile(r"(?<![\w-])--[a-z][a-z0-9-]+[a-z0-9]")
OTHERS = frozenset(
    {
        "--src",
        "--dst",
        "--dst-storage",
        "--line",
        "--grid",
        "--cross-figure",
        "--frame-id",
        "--child-frame-id",
        "--rest",
        "--topic",
    }
)
"""Options of other programs that messages advise, colours of a page, and an example in a docstring."""


def options_of(command: Any) -> Iterator[str]:
    """Options of a command and of all commands below it, which are loaded one by one."""
    for parameter in command.params:
        yield from (*parameter.opts, *parameter.secondary_opts)
    if hasattr(command, "get_command"):
        names = {*COMMANDS, *command.commands}
        for own in filter(None, (command.get_command(None, name) for name in sorted(names))):
            yield from options_of(own)


def advised() -> Iterator[tuple[Path, str]]:
    """Options in texts of the packages' code, docstrings and f-strings included."""
    for package in ("lrm_ident", "lrm_math"):
        for path in sorted((ROOT / package).rglob("*.py")):
            for node in ast.walk(syntax_tree(path)):
                if isinstance(node, ast.Constant) and isinstance(node.value, str):
                    yield from ((path, option) for option in OPTION.findall(node.value))


def test_no_text_advises_an_option_that_no_command_has() -> None:
    known = {*options_of(get_command(ident)), *OTHERS, "--help", "--version"}
    lacking = {f"{path.relative_to(ROOT)}: {option}" for path, option in advised() if option not in known}
    assert not lacking


CAUSES = frozenset({"--camera", "--motion", "--on-gripper", "--physical", "--points"})
"""Options that a message names as what is wrong, to be taken away or corrected."""
TYPED = re.compile(r"(?<=[\"\' ])--[a-z][a-z0-9-]+")
AT_A_ROBOT = frozenset({"--load-command"})
"""Remedies for an arm that asks for a load while nobody is there."""


def messages(tree: ast.Module) -> Iterator[str]:
    """Texts of a module that a command may print: no docstrings, no help of options."""
    apart = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") in ("Option", "Argument"):
            apart |= {id(part) for part in ast.walk(node)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in apart:
            yield node.value


def typed_in_tests() -> set[str]:
    """Options that stand as words in the tests, as they are typed."""
    return {option for path in (ROOT / "tests").rglob("*.py") for option in TYPED.findall(path.read_text())}


def test_no_message_advises_an_option_that_no_test_follows() -> None:
    """A remedy comes with a test that types it: a kind above, or one of its own command."""
    typed = {*typed_in_tests(), *OTHERS, *CAUSES, *AT_A_ROBOT}
    lacking = {
        f"{path.relative_to(ROOT)}: {option}"
        for package in ("lrm_ident", "lrm_math", "lerobot_robot_lrm")
        for path in files(package)
        for words in messages(syntax_tree(path))
        for option in OPTION.findall(words)
        if option not in typed
    }
    assert not lacking


SD_MM = 0.1
POINT_MM = (150.0, -450.0, 50.0)
ANGLES, XYZ = ("pose", "q1_deg", "q2_deg"), ("x_mm", "y_mm", "z_mm")
STRING = ("pose", *(f"q{j}_deg" for j in range(1, 3)), "distance_mm")
POSITIONS = (*ANGLES, *XYZ)
POSITION_COVARIANCE = ("cxx_mm2", "cxy_mm2", "cxz_mm2", "cyy_mm2", "cyz_mm2", "czz_mm2")
CROSS_COVARIANCE = tuple(f"c{a}{u}_mmdeg" for a in "xyz" for u in "uvw")
TURN_COVARIANCE = ("cuu_deg2", "cuv_deg2", "cuw_deg2", "cvv_deg2", "cvw_deg2", "cww_deg2")
ORIENTATION = ("qw", "qx", "qy", "qz")
FROM = f"distance_from_mm = {list(POINT_MM)}"

FORMS: dict[str, tuple[tuple[str, ...], str, tuple[str, ...]]] = {
    "positions, poses not numbered": (POSITIONS[1:], "", ()),
    "a string from an unknown point": (STRING, "distance_sd_mm = 0.1", ()),
    "a string from a known point": (STRING, f"{FROM}\ndistance_sd_mm = 0.1", ()),
    "a string beside positions, both in part": (
        (*POSITIONS, "sd_mm", "distance_mm", "distance_sd_mm"), FROM, ("x_mm y_mm z_mm", "distance_mm"),
    ),
    "orientations": ((*POSITIONS, *ORIENTATION, "sd_mm", "srot_deg"), "", ("qw qx qy qz",)),
    "covariances": (
        (*POSITIONS, *ORIENTATION, *POSITION_COVARIANCE, *CROSS_COVARIANCE, *TURN_COVARIANCE), "", (),
    ),
    "deviations of each axis, encoders, times, sessions, loads, environment": (
        (
            *POSITIONS, "sx_mm", "sy_mm", "sz_mm", "q1_meas_deg", "q2_meas_deg", "t_s", "session", "payload_g",
            "temp_c", "supply_v", "repeat_of",
        ),
        "feedback_sd_deg = 0.05", ("q2_meas_deg",),
    ),
    "dates, gravity, one direction of approach": ((*POSITIONS, "dates", "gx", "gy", "gz", "approach"), "", ()),
    "an unknown frame, its tilt, directions of approach": (
        (*POSITIONS, "roll_deg", "pitch_deg", "approach1", "approach2"), 'noise_sd_mm = 0.1\nframe = "unknown"', (),
    ),
}  # fmt: skip
"""By name: the columns, lines of the file beside the data, and groups of cells of which every fourth is empty."""


def cells(arm: Arm, poses: int) -> dict[str, np.ndarray]:
    """(N,), cells of every column of N poses, of an arm whose second joint is 1 deg off its zero."""
    rng = np.random.default_rng(1)
    q = np.round(rng.uniform(-60.0, 60.0, (poses, arm.dof)), 3)
    model = model_of(arm, effects_at(arm, "offsets"), {"offsets.joint2.theta_rad": 0.0175})
    settled = solve_equilibrium(model, poses_of(np.radians(q)))
    tip = 1e3 * settled.tcp + rng.normal(0.0, SD_MM, (poses, 3))
    number, one = np.arange(1, poses + 1), np.ones(poses)
    columns: dict[str, np.ndarray] = {"pose": number, "repeat_of": number, "sd_mm": SD_MM * one, "srot_deg": 0.1 * one}
    columns |= {f"q{j + 1}_deg": q[:, j] for j in range(arm.dof)}
    columns |= {f"q{j + 1}_meas_deg": q[:, j] + rng.normal(0.0, 0.05, poses) for j in range(arm.dof)}
    columns |= {f"approach{j}": one for j in ("", 1, 2)} | {f"s{axis}_mm": SD_MM * one for axis in "xyz"}
    columns |= dict(zip(XYZ, tip.T, strict=True))
    columns |= dict(zip(ORIENTATION, quaternions(tool_rotation(settled)).T, strict=True))
    columns |= {name: (0.01 if name[1] == name[2] else 0.0) * one for name in POSITION_COVARIANCE + TURN_COVARIANCE}
    columns |= dict.fromkeys(CROSS_COVARIANCE, 0.0 * one)
    string = np.linalg.norm(tip - POINT_MM, axis=1)
    columns |= {"distance_mm": string, "distance_sd_mm": SD_MM * one}
    columns |= {"t_s": 10.0 * number, "session": 1 + number // 13, "payload_g": 0.0 * one, "temp_c": 20.0 + number % 5}
    columns |= {"supply_v": 12.0 * one, "gx": 0.0 * one, "gy": 0.0 * one, "gz": -one, "roll_deg": 0.0 * one}
    columns |= {"pitch_deg": 0.0 * one, "dates": np.array([f"2024-07-15T10:{n % 60:02d}:00" for n in number])}
    return columns


def written(path: Path, columns: tuple[str, ...], beside: str, in_part: tuple[str, ...]) -> Path:
    arm, poses = ("two-joint", 40) if columns == STRING else ("two-joint", 24)
    every = cells(load_arm(arm), poses)
    table = np.array([[str(cell) for cell in every[name]] for name in columns], dtype=object)
    for k, group in enumerate(in_part):
        table[np.ix_(np.array([columns.index(name) for name in group.split()]), np.arange(k, poses, 4))] = ""
    header = ",".join("t_s" if name == "dates" else name for name in columns)
    path.write_text("\n".join([header, *(",".join(row) for row in table.T)]) + "\n")
    path.with_suffix(".toml").write_text(f'schema = "lrm/measurements/1"\narm = "{arm}"\n{beside}\n')
    return path


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("form", FORMS)
def test_every_form_goes_through_every_command(form: str, tmp_path: Path) -> None:
    data, model = written(tmp_path / "data.csv", *FORMS[form]), tmp_path / "model.toml"
    assert len(lrm.load(data)) == len(data.read_text().splitlines()) - 1
    stdout_of("fit", data, "-o", model)
    stdout_of("compare", model, data)
    stdout_of("predict", model, data, "-o", tmp_path / "predicted.csv")
    diagnosing = (
        ("diagnose", model, data),
        ("auto", model, data, "-o", tmp_path / "auto.toml", "--max-effects", "0", "--no-nested"),
        ("report", model, data, "-o", tmp_path / "report.html"),
    )
    turn = list(FORMS).index(form) % len(diagnosing)  # a diagnosis is most of the time
    for command in diagnosing if in_soak() else diagnosing[turn : turn + 1]:
        stdout_of(*command)
