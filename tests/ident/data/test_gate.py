"""One gate for every door: each rule of reading holds at each way in, so that a new door cannot forget one.

A rule is a name, a wrong input and the words that name it. A door takes the path of the input and gives the message.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import lrm_ident as lrm
from lrm_ident.workbench.work.run_task import run_task
from lrm_ident.workbench.work.tasks import OpenTask
from lrm_math.arm.arm_file import load_arm
from lrm_math.arrays import Array
from lrm_math.errors import LrmError
from tests.ident.data.test_remedies import NAMES, put, table, text
from tests.ident.measuring.recordings.test_lerobot import written as dataset
from tests.support.commands import run_command, stdout_of

POSES = 40
Door = Callable[[Path, Path], str]
"""Takes the path of measurements and of a model, and gives the message that refuses them."""


def by_command(*words: object) -> Door:
    """A command; `DATA`, `MODEL` and `OUT` stand for its files."""

    def door(data: Path, model: Path) -> str:
        files = {"DATA": data, "MODEL": model, "OUT": data.parent / "out.toml", "HTML": data.parent / "out.html"}
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
        arm = load_arm("so101")
        poses = by(np.random.default_rng(1).uniform(-60.0, 60.0, (14, 5)))
        return dataset(folder / "recorded", arm, poses, np.zeros_like(poses))

    return spoil


def one_beyond(poses: Array) -> Array:
    poses[3:, 1] = 115.0
    return poses


RECORDINGS: dict[str, tuple[Callable[[Path], Path], str]] = {
    "unit of angles": (moved(np.radians), "--angle-unit rad"),
    "counts": (moved(lambda poses: 2048.0 + poses * 4096.0 / 360.0), "counts of encoders"),
    "inside limits": (moved(one_beyond), "shoulder_lift rests up to 15"),
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
