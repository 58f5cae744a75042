"""What there is to try without measurements, models on unseen poses, and runs that a person interrupts."""

from __future__ import annotations

import io
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from time import monotonic
from typing import Any
from unittest.mock import Mock

import pytest
from rich.console import Console

import lrm_ident as lrm
from lrm_ident.cli import common, diagnosis
from lrm_ident.cli.common import TakesLonger, pausing_bars, timed
from lrm_ident.diagnosis.step import Step
from lrm_ident.fitting.progress import TimeOfParts
from lrm_ident.study.study import Study
from lrm_math.model.model_file import ModelFile, load_model
from lrm_math.toml_file import read_toml
from tests.conftest import EXAMPLE
from tests.support.commands import run_command, stderr_of, stdout_of

pytestmark = pytest.mark.long


@pytest.mark.slow
def test_the_demo_tells_its_story_again(tmp_path: Path, example_study: lrm.Study, better_study: lrm.Study) -> None:
    (folder := tmp_path / "story").mkdir()
    stdout_of("example", "-o", folder / "data.csv")
    for name, study in (("model", example_study), ("best", better_study)):
        study.save(folder / f"{name}.toml")
    stdout_of("report", folder / "best.toml", folder / "data.csv", "-o", folder / "report.html")
    said = stdout_of("demo", "-o", folder)
    assert "Missing from the model: backlash in joint 2" in said
    assert "lengths, angles and stiffness fitted 3.03 → with backlash in joint 2: 0.5" in " ".join(said.split()), (
        "the whole course, not its last step"
    )
    last = read_toml(folder / "best.toml", ModelFile).history[-1]
    assert last.course.shows == {"backlash@joint2": "identified cause"}
    assert {path.name for path in folder.iterdir() if not path.name.startswith(".")} == {
        "data.csv", "data.toml", "model.toml", "best.toml", "report.html",
    }  # fmt: skip


def test_the_example_can_be_fitted_where_it_is_written(tmp_path: Path) -> None:
    stdout_of("example", "-o", tmp_path / "mine.csv")
    assert "RMS error fell" in stdout_of("fit", tmp_path / "mine.csv", "-o", tmp_path / "model.toml")


def test_a_model_is_summed_up_without_its_data(tmp_path: Path, better_study: lrm.Study) -> None:
    study = better_study
    study.save(tmp_path / "best.toml")
    said = stdout_of("show", tmp_path / "best.toml", "--json", tmp_path / "best.json")
    assert said.startswith(study.summary().splitlines()[0])
    assert [step["step"] for step in json.loads((tmp_path / "best.json").read_text())["history"]] == [
        "fit", "add backlash@joint2",
    ]  # fmt: skip
    play = study.parameters["backlash.joint2.b_rad"]
    assert abs(play.value - 0.040143) < 1.96 * play.standard_error < 0.001  # hidden-play.truth.toml
    assert play.unit == "rad"


def test_an_import_leaves_the_threads_of_a_program_alone() -> None:
    code = "import os; import lrm_ident; lrm_ident.Study; print(os.environ.get('OMP_NUM_THREADS'))"
    own = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=own)
    assert done.stdout.strip() == "None"


def test_a_fit_does_not_replace_the_result_of_added_effects(tmp_path: Path, example_model: Path) -> None:
    best, fitted = tmp_path / "best.toml", Path(shutil.copy(example_model, tmp_path / "model.toml"))
    stdout_of("fit", EXAMPLE, "--parameters", "option3", "-o", fitted)  # one of as many steps
    stdout_of("add", example_model, EXAMPLE, "backlash@joint2", "-o", best)
    kept = best.read_bytes()
    assert "--force" in stderr_of("fit", EXAMPLE, "-o", best)
    assert "2 steps" in stderr_of("auto", example_model, EXAMPLE, "-o", best)
    assert best.read_bytes() == kept
    stdout_of("fit", EXAMPLE, "--parameters", "option3", "-o", best, "--force")
    assert best.read_bytes() != kept


ARM = ("--arm", "lrm-lab")


def halves(folder: Path) -> tuple[Path, Path]:
    header, *rows = EXAMPLE.read_text().splitlines()
    paths = folder / "odd.csv", folder / "even.csv"
    for path, part in zip(paths, (rows[0::2], rows[1::2]), strict=True):
        path.write_text("\n".join([header, *part]) + "\n")
    return paths


def test_on_independent_data_nothing_is_refitted(tmp_path: Path) -> None:
    ours, others = halves(tmp_path)
    model, result = tmp_path / "model.toml", tmp_path / "result.json"
    stdout_of("fit", ours, *ARM, "-o", model)
    said = stdout_of("compare", model, others, "--json", result)
    assert "saw none of these poses" in " ".join(said.split())
    assert json.loads(result.read_text())["error"]["held_out"] is None
    stdout_of("compare", model, ours, "--json", tmp_path / "own.json")
    assert json.loads((tmp_path / "own.json").read_text())["error"]["held_out"]["rms_mm"] > 0.0
    others.write_text("\n".join(others.read_text().splitlines()[:4]) + "\n")
    assert "measure at least" not in stdout_of("compare", model, others), "a few are enough"


def test_left_out_poses_can_be_compared_alone(tmp_path: Path, example_model: Path) -> None:
    model, result = tmp_path / "model.toml", tmp_path / "result.json"
    stdout_of("fit", EXAMPLE, "--leave-out", "3,10-15", "-o", model)
    stdout_of("compare", model, EXAMPLE, "--left-out", "--json", result)
    found = json.loads(result.read_text())
    assert found["poses"] == 7
    assert {pose["pose"] for pose in found["worst_poses"]} == {3, *range(10, 16)}
    assert found["error"]["held_out"] is None
    assert "no poses that the fit left out" in stderr_of("compare", example_model, EXAMPLE, "--left-out")


def test_an_interrupt_keeps_the_model(tmp_path: Path, example_model: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept, real, taken = tmp_path / "kept.toml", Study.auto, list[Study]()

    def interrupted(self: Study, _: int, rates: Any, on_step: Callable[[Step, Study], object]) -> Any:
        taken.append(real(self, 1, rates, on_step)[1])
        raise KeyboardInterrupt

    monkeypatch.setattr(Study, "auto", interrupted)
    code, _, said = run_command("auto", example_model, EXAMPLE, "-o", kept)
    assert code == 130
    assert "the model of the last step" in " ".join(said.split())
    assert load_model(kept).keys == taken[0].model.keys != load_model(example_model).keys

    def at_once(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Study, "auto", at_once)
    code, _, said = run_command("auto", example_model, EXAMPLE, "-o", tmp_path / "none.toml")
    assert (code, "no step was taken" in said) == (130, True)


def test_what_takes_long_is_asked_for(tmp_path: Path, example_model: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(diagnosis, "UNASKED_S", 0.0)
    said = " ".join(
        stdout_of("auto", example_model, EXAMPLE, "--max-effects", 0, "-o", tmp_path / "model.toml").split()
    )
    assert "ask for it with --nested" in said


def test_the_time_left_is_said_once_and_what_nobody_asked_for_ends(capsys: pytest.CaptureFixture[str]) -> None:
    """Before: nine lines in a pipe, one for each fold."""
    time = TimeOfParts(2, monotonic() - 60.0)
    with timed(time, None) as shown:
        shown("choosing anew", 0, 10)
        shown("choosing anew", 2, 10)
        shown("choosing anew", 3, 10)
    said = capsys.readouterr().err
    assert " ".join(said.split()) == "notice: choosing anew: 2 of 10 done, about 4 min left"
    with pytest.raises(TakesLonger) as longer, timed(time, 120.0) as shown:
        shown("choosing anew", 2, 10)
    assert longer.value.expected == pytest.approx(300.0, rel=0.1)
    with pytest.raises(TakesLonger), timed(TimeOfParts(2, monotonic() - 121.0), 120.0) as shown:
        shown("choosing anew", 0, 10)


def test_bars_of_a_long_work_are_gone_before_a_step_is_printed(monkeypatch: pytest.MonkeyPatch) -> None:
    """`auto` prints its steps to the same terminal."""
    terminal = Console(file=io.StringIO(), force_terminal=True, width=80)
    monkeypatch.setattr(common, "log", terminal)
    monkeypatch.setattr(common, "animated", lambda: True)
    with pausing_bars() as (tick, pause):
        for _ in range(2):
            tick("looking for what is missing", 1, 4)
            assert terminal._live_stack, "a bar is shown"
            pause()
            assert not terminal._live_stack
    shown = terminal.file.getvalue()  # type: ignore[attr-defined]
    assert "looking for what is missing" in shown
    assert "25%" in shown


def test_a_demo_that_is_interrupted_ends_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Before: the next command ran, and missed what the first had not written."""
    monkeypatch.setattr("lrm_ident.cli.fit.Study", Mock(side_effect=KeyboardInterrupt))
    code, out, _ = run_command("demo", "-o", tmp_path / "demo")
    assert code == 130
    assert "diagnose" not in out
