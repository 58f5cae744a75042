"""The commands of `lrm-ident motion` on a small recording, and what they refuse of others: one line each."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lrm_ident.cli import consoles
from lrm_ident.measuring.recordings.lerobot import LeRobotFrames
from tests.ident.cli.test_length import COLUMNS, assert_fits
from tests.ident.motion.arm_in_motion import JOINT, recording
from tests.support.commands import stderr_of, stdout_of

pytestmark = pytest.mark.long

BETWEEN_S = 0.9
"""s between episodes in the file."""


def write_recording(path: Path, frames: LeRobotFrames) -> None:
    """Commands and encoders as `motion play` writes them."""
    t = frames.t + frames.episode * (frames.t.max() + BETWEEN_S)
    n = frames.command.shape[1]
    head = ["t_s", *(f"q{j}_deg" for j in range(1, n + 1)), *(f"q{j}_meas_deg" for j in range(1, n + 1))]
    rows = np.column_stack([t, np.degrees(frames.command), np.degrees(frames.feedback)])
    np.savetxt(path, rows, "%.5f", ",", header=",".join(head), comments="")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a recording of a joint that acts two frames late, and a model that was fitted to it."""
    here = tmp_path_factory.mktemp("motion")
    write_recording(here / "rec.csv", recording(late=2))
    stdout_of("motion", "fit", here / "rec.csv", "-o", here / "motion.toml", "--json", here / "fit.json")
    stdout_of("motion", "add", here / "motion.toml", here / "rec.csv", "dead_time@joint2", "-o", here / "better.toml")
    (here / "poses.csv").write_text("q1_deg,q2_deg,q3_deg,q4_deg,q5_deg\n0,0,0,0,0\n10,20,-20,0,0\n0,-20,10,0,30\n")
    return here


@pytest.fixture
def folder(made: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The same as the working directory, and a terminal of 80 columns."""
    monkeypatch.chdir(made)
    monkeypatch.setattr(consoles.out, "soft_wrap", False)
    monkeypatch.setattr(consoles.out, "_width", COLUMNS)
    return made


def test_fit_writes_a_model_and_its_errors(folder: Path) -> None:
    assert_fits(stdout_of("motion", "fit", "rec.csv", "-o", "again.toml"))
    found = json.loads((folder / "fit.json").read_text())
    assert found["schema"] == "lrm/motion-fit/1"
    joint = found["joints"][JOINT]
    assert joint["command_deg"] > 4.0 > 0.3 > joint["held_out_deg"] > 4.0 * joint["noise_deg"]
    assert "--all" in stdout_of("motion", "fit", "rec.csv", "-o", "once-more.toml")


@pytest.mark.usefixtures("folder")
def test_compare_says_where_the_model_fails() -> None:
    told = stdout_of("motion", "compare", "motion.toml", "rec.csv")
    assert_fits(told)
    assert "joint 2 faster than" in told
    assert "nowhere much more than elsewhere" in stdout_of("motion", "compare", "better.toml", "rec.csv")


@pytest.mark.usefixtures("folder")
def test_diagnose_names_what_is_missing_and_add_ends_at_the_noise() -> None:
    told = stdout_of("motion", "diagnose", "motion.toml", "rec.csv")
    assert told.startswith("Missing from the model: dead time of joint 2")
    assert "lrm-ident motion add motion.toml rec.csv dead_time@joint2 -o better.toml" in told
    assert_fits(told)
    told = stdout_of("motion", "add", "motion.toml", "rec.csv", "dead_time@joint2", "-o", "added.toml")
    assert_fits(told)
    assert "delay of the command  66." in told


def test_auto_adds_it_and_draws_what_changed(folder: Path) -> None:
    words = ("motion", "auto", "motion.toml", "rec.csv", "-o", "auto.toml", "--figure", "auto.png", "--json", "a.json")
    told = stdout_of(*words)
    assert_fits(told)
    assert told.startswith("Identified: dead time of joint 2")
    assert (folder / "auto.png").stat().st_size > 10_000
    found = json.loads((folder / "a.json").read_text())
    assert [(one["effect"], one["identified"]) for one in found["effects"]] == [("dead_time@joint2", True)]


def test_report_is_one_page_without_a_network(folder: Path) -> None:
    stdout_of("motion", "report", "better.toml", "rec.csv", "-o", "page.html")
    page = (folder / "page.html").read_text()
    assert "dead time of joint 2" in page
    assert 'src="http' not in page


def test_settle_states_a_time_for_every_move(folder: Path) -> None:
    told = stdout_of("motion", "settle", "better.toml", "poses.csv", "--json", "settle.json")
    assert_fits(told)
    found = json.loads((folder / "settle.json").read_text())
    assert [one["pose"] for one in found["moves"]] == [2, 3]
    assert found["longest_s"] == max(one["settle_s"] for one in found["moves"]) > 0.0


@pytest.mark.usefixtures("folder")
def test_effects_lists_and_explains() -> None:
    assert_fits(stdout_of("motion", "effects", "dead_time"))
    assert "unknown effect of motion 'dead'" in stderr_of("motion", "effects", "dead")


MISTAKES: list[tuple[str, Callable[[LeRobotFrames], LeRobotFrames], str]] = [
    ("still", lambda f: replace(f, command=np.zeros_like(f.command)), "no joint is commanded over more than 0 deg"),
    ("radians", lambda f: replace(f, command=np.radians(f.command)), "or are the angles in rad"),
    ("copied", lambda f: replace(f, feedback=f.command), "encoders that read exactly what is commanded"),
    ("six", lambda f: replace(f, command=f.command[:, :4], feedback=f.feedback[:, :4]), "missing column q5_deg"),
]


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(("name", "mistaken", "said"), MISTAKES, ids=[name for name, *_ in MISTAKES])
def test_a_recording_that_shows_no_motion_is_refused(
    name: str, mistaken: Callable[[LeRobotFrames], LeRobotFrames], said: str
) -> None:
    write_recording(Path(f"{name}.csv"), mistaken(recording(late=2)))
    assert said in stderr_of("motion", "fit", f"{name}.csv", "-o", "refused.toml")
    assert not Path("refused.toml").exists()


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("command", "said"),
    [
        ("fit missing.csv -o refused.toml", "missing.csv: no such file"),
        ("fit . -o refused.toml", "is no LeRobot dataset"),
        ("fit rec.csv --arm lrm-rover -o refused.toml", "missing column q6_deg"),
        ("fit rec.csv --prefix left_ -o refused.toml", "--prefix: has no use for a recording of this kind"),
        ("fit rec.csv --topic commands -o refused.toml", "--topic: has no use for a recording of this kind"),
        ("fit rec.csv --rest better.toml -o refused.toml", "--rest: has no use for a recording of this kind"),
        ("fit rec.csv --tip missing.csv -o refused.toml", "missing.csv: no such file"),
        ("fit rec.csv --angle-unit grad -o refused.toml", "should be 'deg' or 'rad'"),
        ("fit rec.csv --angle-unit rad -o refused.toml", "is beyond the limits of joint 2"),
        ("compare . rec.csv", "cannot be read"),
        ("compare rec.csv motion.toml", "do the arguments stand in another order?"),
        ("diagnose missing.toml rec.csv", "missing.toml: no such file"),
        ("add motion.toml rec.csv dead_time@joint9 -o refused.toml", "unknown place of dead_time 'joint9'"),
        ("add motion.toml rec.csv dead_tim@joint2 -o refused.toml", "did you mean dead_time?"),
        ("add better.toml rec.csv dead_time@joint2 -o refused.toml", "is in the model already"),
        ("auto motion.toml rec.csv -o motion.toml", "motion.toml"),
        ("report motion.toml missing.csv -o page2.html", "missing.csv: no such file"),
        ("settle motion.toml missing.csv", "missing.csv: no such file"),
    ],
)
def test_a_mistake_is_one_line(command: str, said: str) -> None:
    assert said in stderr_of("motion", *command.split())
    assert not Path("refused.toml").exists()
