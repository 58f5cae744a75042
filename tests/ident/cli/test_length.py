"""What a command prints fits a terminal of 80 columns and 20 rows, and each command that it advises runs as it stands.

The data are the shipped example, whose missing effect these poses identify, and poses as on the thesis's rig: three
angles a joint, in the order of joint 1, no noise stated, so that its causes cannot be distinguished.
"""

from __future__ import annotations

import re
import shlex
import shutil
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from lrm_ident.cli import consoles
from lrm_ident.fitting.model_fit import nominal_model
from lrm_math.arm.arm_file import load_arm
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from tests.conftest import EXAMPLE
from tests.support.commands import stdout_of

pytestmark = pytest.mark.long

COLUMNS, ROWS = 80, 20
RIG = "rig.csv"
COMMANDS = [
    "example -o other.csv",
    "fit DATA.csv -o m.toml",
    "compare model.toml DATA.csv",
    "undo better.toml -o back.toml",
    "show better.toml",
    "report better.toml DATA.csv -o report.html",
    "predict better.toml DATA.csv -o predicted.csv",
    "effects",
    "effects backlash",
    "explain",
    "explain RMS",
    "design lrm-lab --model model.toml --separate backlash@joint2,servo_gain@joint2 --have DATA.csv -n 10 -o next.csv",
    "design two-joint -n 10 -o poses.csv",
    "identify-parameters two-joint designed.csv",
    "transfer better.toml --to lrm-rover -o rover.toml",
    "align fixture.csv --known-mm 245,0,40",
    "stiffness one-servo.csv",
    "arm show lrm-lab",
    "arm new -o my-arm.toml",
    "arm export lrm-lab -o lab.urdf",
    "arm import drawn.urdf -o imported.toml",
    "camera board -o board.pdf",
    "sockets board -o sockets.stl",
    "motion effects",
    "fit rig.csv --arm lrm-lab -o rigged.toml",
    "compare rig.toml rig.csv",
    "show rig.toml",
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Data and models that the commands name."""
    here = tmp_path_factory.mktemp("length")
    for path in EXAMPLE.parent.glob("*.*"):
        shutil.copy(path, here / path.name.replace(EXAMPLE.stem, "DATA"))
    _rig(here / RIG)
    stdout_of("fit", here / "DATA.csv", "-o", here / "model.toml")
    stdout_of("add", here / "model.toml", here / "DATA.csv", "backlash@joint2", "-o", here / "better.toml")
    stdout_of("fit", here / RIG, "--arm", "lrm-lab", "-o", here / "rig.toml")
    stdout_of("design", "two-joint", "-n", "10", "-o", here / "designed.csv")
    stdout_of("arm", "export", "lrm-lab", "-o", here / "drawn.urdf")
    return here


def _rig(path: Path) -> None:
    """Poses at three angles a joint in the order of joint 1, with two effects of it and of joint 2."""
    arm, rng = load_arm("lrm-lab"), np.random.default_rng(3)
    levels = [(-50.0, 0.0, 50.0)] * 4 + [(-50.0, 50.0), (0.0,)]
    degrees = np.array(list(product(*levels)))
    names = ("offsets", "compliance", "cable_spring@joint1", "eccentricity@joint2", "hysteresis@joint3")
    start = nominal_model(arm, names)
    truth = model_of(arm, start.effects, {key: rng.normal(0.0, start.parameter(key).typical) for key in start.free})
    tcp = solve_equilibrium(truth, poses_of(np.radians(degrees))).tcp * 1e3 + rng.normal(0.0, 0.5, (len(degrees), 3))
    head = ",".join([*(f"q{i + 1}_deg" for i in range(6)), "x_mm", "y_mm", "z_mm"])
    np.savetxt(path, np.hstack([degrees, tcp]), "%.4f", ",", header=head, comments="")


@pytest.fixture
def terminal(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder, and a terminal of 80 columns."""
    monkeypatch.chdir(folder)
    monkeypatch.setattr(consoles.out, "soft_wrap", False)
    monkeypatch.setattr(consoles.out, "_width", COLUMNS)
    return folder


def rows_of(text: str) -> int:
    """Rows of a terminal that a text takes; a command to copy goes on in the next one."""
    return sum(max(1, -(-len(line.rstrip()) // COLUMNS)) for line in text.rstrip("\n").splitlines())


def assert_fits(said: str) -> None:
    """A text of at most a terminal's rows and columns; a command to copy may be wider."""
    assert said.strip()
    assert rows_of(said) <= ROWS, said
    too_wide = [line for line in said.splitlines() if len(line.rstrip()) > COLUMNS and "lrm-ident" not in line]
    assert not too_wide


@pytest.mark.usefixtures("terminal")
@pytest.mark.parametrize("command", COMMANDS)
def test_the_output_fits_a_terminal(command: str) -> None:
    assert_fits(stdout_of(*shlex.split(command)))


ADVISED = re.compile(r"(?:^     |^  [a-z1-9].*: )(lrm-ident .*)$", re.M)


@pytest.mark.slow
@pytest.mark.parametrize("model", ["model", "better", "rig"])
def test_printed_advice_runs(model: str, terminal: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data = "rig.csv" if model == "rig" else "DATA.csv"
    for name in (data, f"{data[:-4]}.toml", f"{model}.toml"):
        if (terminal / name).exists():
            shutil.copy(terminal / name, tmp_path / name)
    monkeypatch.chdir(tmp_path)
    told = stdout_of("diagnose", f"{model}.toml", data)
    assert_fits(told)
    advised = [command for command in ADVISED.findall(told) if " verify " not in command]  # it needs an arm
    assert advised
    for command in advised:
        words = shlex.split(command)[1:]
        said = stdout_of(*words, *(("--no-nested", "--max-effects", "1") if words[0] == "auto" else ()))
        assert_fits(said)
