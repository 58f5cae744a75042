"""One gate for every door: each rule of reading holds at each way in, so that a new door cannot forget one.

A rule is a name, a wrong input and the words that name it. A door takes the path of the input and gives the message.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.main import get_command

import lrm_ident as lrm
from lrm_ident.cli.app import COMMANDS
from lrm_ident.cli.app import app as ident
from lrm_ident.measuring.campaign.plan import load_plan
from lrm_ident.workbench.work.run_task import run_task
from lrm_ident.workbench.work.tasks import OpenTask
from lrm_math.arm.arm_file import load_arm
from lrm_math.arm.plausible_arm import RULES as PLAUSIBLE
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from tests.conftest import ROOT
from tests.ident.data.robot_files.test_plausible_import import robot
from tests.ident.data.test_remedies import NAMES, put, table, text
from tests.ident.measuring.recordings.test_lerobot import written as dataset
from tests.ident.measuring.recordings.test_recordings import motive
from tests.support.commands import run_command, stdout_of
from tests.support.scaled_arm import scaled_arm

pytestmark = pytest.mark.long

POSES = 40
OUTPUTS = {"OUT": "out.toml", "CSV": "out.csv", "HTML": "out.html"}
Door = Callable[[Path, Path], str]
"""Takes the path of measurements and of a model, and gives the message that refuses them."""


def by_command(*words: object) -> Door:
    """A command; `DATA`, `MODEL` and the names of `OUTPUTS` stand for its files."""

    def door(data: Path, model: Path) -> str:
        files = {"DATA": data, "MODEL": model} | {name: data.parent / path for name, path in OUTPUTS.items()}
        code, _, said = run_command(*(files.get(str(word), word) for word in words))
        assert code == 2, said
        assert len([line for line in said.splitlines() if line.startswith("error: ")]) == 1
        return " ".join(said.split())

    return door


def refused(call: Callable[[], object]) -> str:
    with pytest.raises(LrmError) as error:
        call()
    return " ".join(str(error.value).split())


DOORS: dict[str, Door] = {
    "fit": by_command("fit", "DATA", "--arm", "two-joint", "-o", "OUT"),
    "compare": by_command("compare", "MODEL", "DATA"),
    "diagnose": by_command("diagnose", "MODEL", "DATA"),
    "auto": by_command("auto", "MODEL", "DATA", "-o", "OUT"),
    "add": by_command("add", "MODEL", "DATA", "backlash@joint2", "-o", "OUT"),
    "report": by_command("report", "MODEL", "DATA", "-o", "HTML"),
    "transfer": by_command("transfer", "MODEL", "DATA", "--to", "two-joint", "-o", "OUT"),
    "propose": by_command("propose", "MODEL", "DATA"),
    "choose-poses": by_command("choose-poses", "DATA", "-n", 20, "--arm", "two-joint", "-o", "CSV"),
    "lrm.load": lambda data, _: refused(lambda: lrm.load(data, arm="two-joint")),
    "lrm.read_study": lambda data, model: refused(lambda: lrm.read_study(model, data)),
    "workbench": lambda data, _: refused(lambda: run_task(OpenTask(data, None, "two-joint"), lambda _: None)),
}


def changed(change: Callable[[Array], object], names: tuple[str, ...] = NAMES) -> Callable[[], str | bytes]:
    """Measurements of which the rows (N, 5) are changed in place."""

    def spoil() -> str:
        rows = table(POSES)
        change(rows)
        return text(rows, names)

    return spoil


def scaled(columns: slice, by: float) -> Callable[[Array], object]:
    return lambda rows: np.multiply(rows[:, columns], by, out=rows[:, columns])


def swapped(rows: Array) -> None:
    rows[:, :2] = rows[:, [1, 0]]


RULES: dict[str, tuple[Callable[[], str | bytes], str]] = {
    "finite": (changed(lambda rows: rows.__setitem__((3, 2), np.nan)), "nan"),
    "inside limits": (changed(lambda rows: rows.__setitem__((3, 1), 150.0)), "150"),
    "unit of positions": (changed(scaled(slice(2, 5), 1e-3)), "--unit m"),
    "unit of angles": (changed(scaled(slice(0, 2), np.pi / 180.0)), "--angle-unit rad"),
    "sign": (changed(scaled(slice(1, 2), -1.0)), "--joint-sign"),
    "order": (changed(swapped), "--joint-order 2,1"),
    "names": (changed(lambda _: None, ("q1_deg", "elbow", *NAMES[2:])), "q2_deg"),
    "kind of file": (lambda: b"MATLAB 5.0 MAT-file" + bytes(99), "is a MATLAB file"),
}


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("right")
    stdout_of("fit", put(folder / "data.csv", text(table(POSES))), "--arm", "two-joint", "-o", folder / "model.toml")
    return folder / "model.toml"


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("door", DOORS)
def test_every_rule_holds_at_every_door(rule: str, door: str, model: Path, tmp_path: Path) -> None:
    spoil, said = RULES[rule]
    content = spoil()
    assert said in DOORS[door](put(tmp_path / "data.csv", content), model)
    assert {path.name for path in tmp_path.iterdir()} == {"data.csv"}  # nothing is written


def moved(by: Callable[[Array], Array]) -> Callable[[Path], Path]:
    """A LeRobot dataset of an SO-101 whose angles (deg) are changed."""

    def spoil(folder: Path) -> Path:
        poses = by(np.random.default_rng(1).uniform(-60.0, 60.0, (14, 5)))
        return dataset(folder / "recorded", poses, np.zeros_like(poses))

    return spoil


def one_beyond(poses: Array) -> Array:
    poses[3:, 1] = 115.0
    return poses


RECORDINGS: dict[str, tuple[Callable[[Path], Path], str]] = {
    "unit of angles": (moved(np.radians), "--angle-unit rad"),
    "counts": (moved(lambda poses: 2048.0 + poses * 4096.0 / 360.0), "counts of encoders"),
    "inside limits": (moved(one_beyond), "shoulder_lift stands up to 15"),
    "zeros": (moved(lambda poses: poses * [1, -1, 1, 1, 1] + [0, 90, 90, 0, 0]), "(LeRobot before June 2025): read so"),
    "folder": (lambda folder: put(folder / "recorded", "x"), "is a file, no LeRobot dataset"),
}


@pytest.mark.parametrize("rule", RECORDINGS)
@pytest.mark.parametrize("door", ["checkup", "import lerobot"])
def test_every_rule_of_recordings_holds_at_both_doors(rule: str, door: str, tmp_path: Path) -> None:
    spoil, said = RECORDINGS[rule]
    words = (*door.split(), spoil(tmp_path), *(("-o", tmp_path / "poses.csv") if door != "checkup" else ()))
    _, out, err = run_command(*words, "--arm", "so101")
    assert said in " ".join(f"{out} {err}".split())


def said_by(*words: object) -> str:
    """All that a command says, whether it refuses or warns."""
    return " ".join(" ".join(run_command(*words)[1:]).split())


def said_of(call: Callable[[], object]) -> str:
    """The error of a call, or its warnings."""
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        try:
            call()
        except LrmError as error:
            return " ".join(str(error).split())
    return " ".join(str(one.message) for one in heard)


def planned(path: Path) -> str:
    """What `measure`, and photos with `--robot`, say of their poses before they drive."""
    try:
        return " ".join(load_plan(path, load_arm("two-joint")).notices)
    except LrmError as error:
        return " ".join(str(error).split())


IN_TAKE = "--arm", "two-joint", "--tool", "Tool", "--base", "Base"
POSE_DOORS: dict[str, Door] = {
    "measure": lambda poses, _: planned(poses),
    "predict": lambda poses, model: said_by("predict", model, poses, "-o", poses.parent / "out.csv"),
    "identify-parameters": lambda poses, _: said_by("identify-parameters", "two-joint", poses),
    "selftest": lambda poses, _: said_by("selftest", "two-joint", poses, "--only", "backlash@joint1"),
    "design": lambda poses, _: said_by(
        "design", "two-joint", "--poses", poses, "-n", 12, "-o", poses.parent / "out.csv"
    ),
    "import": lambda poses, _: said_by(
        "import", motive(poses.parent / "take.csv"), poses, *IN_TAKE, "-o", poses.parent / "out.csv"
    ),
    "motion settle": lambda poses, _: planned(poses),
    "lrm.load_poses": lambda poses, _: said_of(lambda: lrm.load_poses(poses, "two-joint")),
}
"""Ways in for poses that are to be driven to, or were: the path of poses and of a model, and what is said."""


def without_positions(change: Callable[[Array], object], names: tuple[str, ...] = NAMES[:2]) -> Callable[[], str]:
    """Poses of which the angles (N, 2), deg, are changed in place."""

    def spoil() -> str:
        rows = table(STOPS)[:, :2]
        change(rows)
        return text(rows, names)

    return spoil


STOPS = 4
"""Of the tracker's recording that the tests import."""
POSE_RULES: dict[str, tuple[Callable[[], str | bytes], str]] = {
    "finite": (without_positions(lambda rows: rows.__setitem__((3, 1), np.nan)), "nan"),
    "inside limits": (without_positions(lambda rows: rows.__setitem__((3, 1), 150.0)), "150"),
    "unit of angles": (without_positions(scaled(slice(0, 2), np.pi / 180.0)), "--angle-unit rad"),
    "names": (without_positions(lambda _: None, ("q1_deg", "elbow")), "q2_deg"),
    "kind of file": RULES["kind of file"],
}


@pytest.mark.parametrize("rule", POSE_RULES)
@pytest.mark.parametrize("door", POSE_DOORS)
def test_every_rule_of_poses_holds_at_every_door(rule: str, door: str, model: Path, tmp_path: Path) -> None:
    spoil, said = POSE_RULES[rule]
    assert said in POSE_DOORS[door](put(tmp_path / "poses.csv", spoil()), model)


def spoiled_arm(key: str, by: float) -> str:
    """The file of the two-joint arm with the numbers of some keys multiplied."""
    return scaled_arm((ROOT / "config" / "arms" / "two-joint.toml").read_text(), key, by)


def at_arm_file(*words: object) -> Callable[[Path, str], str]:
    """A command that takes an arm's file, `ARM` in its words."""

    def door(folder: Path, rule: str) -> str:
        arm = put(folder / "arm.toml", ARM_RULES[rule][0])
        data = put(folder / "data.csv", text(table(POSES)))
        files = {"ARM": arm, "DATA": data} | {name: folder / path for name, path in OUTPUTS.items()}
        return said_by(*(files.get(str(word), word) for word in words))

    return door


def at_import(folder: Path, rule: str) -> str:
    """`arm import` of a URDF that breaks a rule."""
    description, *more = ARM_RULES[rule][1].split(" --", 1)
    options = f"--{more[0]}".split() if more else []
    return said_by("arm", "import", put(folder / "arm.urdf", description), "-o", folder / "arm.toml", *options)


def in_python(folder: Path, rule: str) -> str:
    data = put(folder / "data.csv", text(table(POSES)))
    return refused(lambda: lrm.load(data, arm=put(folder / "arm.toml", ARM_RULES[rule][0])))


ARM_RULES: dict[str, tuple[str, str]] = {
    "size": (spoiled_arm(r"\w+_mm", 1e-3), re.sub(r'xyz="0\.2 0 0"', 'xyz="0.002 0 0"', robot())),
    "mass": (spoiled_arm("mass_g", 1e3), robot(mass=10.0)),
    "centre-of-mass": (
        spoiled_arm("com_mm", 1e3),
        robot().replace('<origin xyz="0.1 0 0"/>', '<origin xyz="100 0 0"/>'),
    ),
    "gravity": (spoiled_arm("gravity_m_per_s2", 100.0), f"{robot()} --gravity 0,0,-981"),
    "angles": (
        spoiled_arm(r"(?:theta|alpha)_deg", np.pi / 180.0),
        robot().replace('0 0"/><axis', '0 0" rpy="90 0 0"/><axis'),
    ),
    "limits": (spoiled_arm("limits_deg", np.pi / 180.0), robot(limits='lower="-175" upper="175"')),
}
"""For each rule of an arm's plausibility, by its name: an arm file and a URDF (with options) that break it."""
ARM_DOORS: dict[str, Callable[[Path, str], str]] = {
    "arm import": at_import,
    "arm show": at_arm_file("arm", "show", "ARM"),
    "fit --arm": at_arm_file("fit", "DATA", "--arm", "ARM", "-o", "OUT"),
    "design": at_arm_file("design", "ARM", "-n", 12, "-o", "CSV"),
    "reach": at_arm_file("reach", "ARM"),
    "identify-parameters": at_arm_file("identify-parameters", "ARM", "DATA"),
    "selftest": at_arm_file("selftest", "ARM", "DATA"),
    "lrm.load": in_python,
}


def test_every_rule_of_arms_is_tried() -> None:
    assert set(ARM_RULES) == set(PLAUSIBLE)


@pytest.mark.parametrize("rule", ARM_RULES)
@pytest.mark.parametrize("door", ARM_DOORS)
def test_every_rule_of_arms_holds_at_every_door(rule: str, door: str, tmp_path: Path) -> None:
    said = ARM_DOORS[door](tmp_path, rule)
    assert re.search(rf"--accept {rule}\b|accepted = \[\"{rule}\"\]", said), said
    assert not any((tmp_path / path).exists() for path in OUTPUTS.values())


TAKES: dict[str, tuple[dict[str, Any], ...]] = {
    "DATA": (DOORS,),
    "FEW.csv": (DOORS,),
    "[MODEL] [DATA]": (DOORS,),
    "POSES": (POSE_DOORS,),
    "ARM": (ARM_DOORS,),
    "URDF": (ARM_DOORS,),
    "DATASET": (dict.fromkeys(["checkup", "import lerobot"]),),
}
"""Doors of the tests above by what commands take."""
OF_ANOTHER_KIND = {"stiffness"}
"""Takes readings of one servo on a bench, no measurements of an arm."""


def taking(command: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, str]]:
    """Name of every command, and what each of its arguments is called."""
    if hasattr(command, "get_command"):
        for name in sorted({*(() if path else COMMANDS), *command.commands}):
            yield from taking(command.get_command(None, name), (*path, name))
    else:
        yield from ((" ".join(path), one.metavar) for one in command.params if one.param_type_name == "argument")


def test_no_door_is_forgotten() -> None:
    """A command that takes measurements, poses, an arm or a dataset is among the doors of these tests."""
    every = [pair for pair in taking(get_command(ident)) if pair[1] in TAKES]
    assert len(every) > 15
    missing = [pair for pair in every if pair[0] not in {*OF_ANOTHER_KIND, *TAKES[pair[1]][0]}]
    assert not missing, missing
