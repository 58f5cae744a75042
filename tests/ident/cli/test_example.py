"""What there is to try without measurements: the shipped example, its story, and the summary of a model."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import lrm_ident as lrm
from lrm_math.model.model_file import ModelFile
from lrm_math.toml_file import read_toml
from tests.support.commands import stdout_of

pytestmark = pytest.mark.long


@pytest.mark.slow
def test_the_demo_tells_the_story_in_a_folder_where_it_was_told_before(
    tmp_path: Path, example_study: lrm.Study, better_study: lrm.Study
) -> None:
    (folder := tmp_path / "story").mkdir()
    stdout_of("example", "-o", folder / "data.csv")
    for name, study in (("model", example_study), ("best", better_study)):
        study.save(folder / f"{name}.toml")
    stdout_of("report", folder / "best.toml", folder / "data.csv", "-o", folder / "report.html")
    said = stdout_of("demo", "-o", folder)
    assert "Missing from the model: backlash in joint 2" in said
    assert "geometry and springs 3.03 → backlash in joint 2 0.5" in " ".join(said.split()), (
        "the whole course, not its last step"
    )
    last = read_toml(folder / "best.toml", ModelFile).history[-1]
    assert last.course is not None
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
    assert play.standard_error is not None
    assert abs(play.value - 0.040143) < 1.96 * play.standard_error < 0.001  # hidden-play.truth.toml
    assert play.unit == "rad"


def test_an_import_leaves_the_threads_of_a_program_alone() -> None:
    code = "import os; import lrm_ident; lrm_ident.Study; print(os.environ.get('OMP_NUM_THREADS'))"
    own = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=own)
    assert done.stdout.strip() == "None"
