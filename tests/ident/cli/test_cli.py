"""The commands, as a person runs them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from lrm_ident.data.measurement_file.number_table import numbers_of, read_csv
from lrm_ident.fitting import cross_validation
from lrm_ident.study.study import Study
from tests.conftest import EXAMPLE, ROOT
from tests.support.broken_output import full_disk_file
from tests.support.commands import part_of_example, run_command, stdout_of
from validation import synthetic


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a model that a process of its own fitted to the shipped example."""
    folder = tmp_path_factory.mktemp("work")
    words = ("fit", EXAMPLE, "-o", folder / "model.toml", "--json", folder / "fit.json")
    done = subprocess.run([sys.executable, "-m", "lrm_ident", *words], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    assert "held out" in done.stdout
    assert "Model written" in done.stdout
    return folder


@pytest.mark.slow
def test_fit_reports_fit_and_held_out(folder: Path) -> None:
    result = json.loads((folder / "fit.json").read_text())
    assert result["schema"] == "lrm/fit/1"
    error = result["error"]
    assert error["nominal"]["mean_mm"] > 20 > error["held_out"]["mean_mm"] > error["fit"]["mean_mm"]
    assert result["parameters"] == len(result["estimates"]) == len(result["correlation"]["matrix"])
    for estimate in result["estimates"].values():
        assert estimate["at_bound"] or estimate["se"] > 0


@pytest.mark.long
def test_the_command_that_a_fit_advises_runs_as_it_is_printed(tmp_path: Path) -> None:
    """Before: names with a blank stood in it unquoted."""
    data, model = part_of_example(tmp_path).rename(tmp_path / "my data.csv"), tmp_path / "my model.toml"
    printed = stdout_of("fit", data, "--arm", "lrm-lab", "-o", model)
    assert f"\nNext: lrm-ident diagnose '{model}' '{data}'\n" in printed


@pytest.mark.long
def test_the_model_file_tells_where_it_comes_from(folder: Path) -> None:
    tables = tomllib.loads((folder / "model.toml").read_text())
    assert tables["schema"] == "lrm/model/2"
    assert tables["arm"] == "lrm-lab"
    assert tables["provenance"]["data"] == "hidden-play.csv"
    assert len(tables["provenance"]["data_sha256"]) == 64
    assert [entry["step"] for entry in tables["history"]] == ["fit"]
    assert set(tables["sigma"]) <= set(tables["parameters"])


@pytest.mark.slow
def test_compare_repeats_the_fits_figures(folder: Path) -> None:
    outputs = ("--json", folder / "c.json", "--figure", folder / "c.svg")
    said = stdout_of("compare", folder / "model.toml", EXAMPLE, *outputs)
    assert "torque of joint 2" in said
    fitted = json.loads((folder / "fit.json").read_text())["error"]
    compared = json.loads((folder / "c.json").read_text())
    for kind in ("nominal", "fit", "held_out"):
        for name, value in fitted[kind].items():
            assert compared["error"][kind][name] == pytest.approx(value, rel=1e-4), (kind, name)
    kinds = {factor["kind"] for factor in compared["factors"]}
    assert kinds == {"angle", "torque", "load", "order", "region"}
    assert all(sum(g["poses"] for g in factor["groups"]) == 300 for factor in compared["factors"])
    worst = [pose["error_mm"] for pose in compared["worst_poses"]]
    assert len(worst) == 10
    assert worst == sorted(worst, reverse=True)
    assert worst[0] == pytest.approx(fitted["fit"]["max_mm"], rel=1e-6)
    assert (folder / "c.svg").read_text().lstrip().startswith("<?xml")


@pytest.mark.long
def test_predict_gives_the_residuals_of_compare(folder: Path) -> None:
    stdout_of("predict", folder / "model.toml", EXAMPLE, "-o", folder / "p.csv", "--json", folder / "p.json")
    predicted = read_csv(folder / "p.csv", ["x_mm", "tau1_Nm", "tau6_Nm", "tau_base_Nm"])
    seen = read_csv(EXAMPLE, ["x_mm"])
    away = [numbers_of(predicted, f"{axis}_mm") - numbers_of(seen, f"{axis}_mm") for axis in "xyz"]
    rms = float(np.sqrt(np.mean(np.sum(np.square(away), axis=0))))
    assert rms == pytest.approx(json.loads((folder / "fit.json").read_text())["error"]["fit"]["rms_mm"], abs=1e-4)
    assert len(json.loads((folder / "p.json").read_text())["poses"]) == 300


@pytest.mark.long
def test_predict_says_that_poses_may_be_in_radians(folder: Path) -> None:
    poses, words = folder / "radians.csv", ["predict", folder / "model.toml", folder / "radians.csv"]
    poses.write_text("q1,q2,q3,q4,q5,q6\n0.2,0.4,-0.5,0.1,1.1,0.3\n")
    code, _, said = run_command(*words, "-o", folder / "r.csv")
    assert code == 0
    assert "if they are radians: --angle-unit rad" in " ".join(said.split())
    for unit in ("deg", "rad"):
        assert "if they are" not in run_command(*words, "-o", folder / "r.csv", "--angle-unit", unit)[2]


@pytest.mark.slow
def test_a_fit_can_start_from_a_model_and_grow(folder: Path) -> None:
    grown = folder / "grown.toml"
    start = ["--start", folder / "model.toml"]
    stdout_of("fit", EXAMPLE, *start, "--effects", "offsets,compliance,backlash@joint2", "-o", grown)
    tables = tomllib.loads(grown.read_text())
    assert tables["effects"] == ["offsets", "compliance", "backlash@joint2"]
    assert "backlash.joint2.tau0_Nm" in tables["parameters"]
    assert tables["history"][-1]["held_out_rms_mm"] < 1.0


@pytest.mark.slow
def test_auto_names_the_hidden_play_and_stops(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The play of the shipped example in an arm of two joints, on which eleven selections take seconds."""
    monkeypatch.setattr(cross_validation, "MOST_REFITTED", 0)
    data, *_ = synthetic.write_example(folder, ROOT / "config" / "arms" / "two-joint.toml")
    data.write_text("\n".join(data.read_text().splitlines()[:121]) + "\n")
    stdout_of("fit", data, "-o", folder / "two-joint.toml")
    outputs = ("-o", folder / "best.toml", "--json", folder / "course.json")
    said = stdout_of("auto", folder / "two-joint.toml", data, "--nested", *outputs)
    assert "backlash@joint2 in 10 of 10 repeated searches" in " ".join(said.split())
    assert "joint 2 has" in said, "its size"
    course = json.loads((folder / "course.json").read_text())
    assert [step["added"] for step in course["steps"]] == ["", "backlash@joint2"]
    assert course["verdict"] == "nothing_missing"
    assert course["chosen_in_folds"] == {"backlash@joint2": 10}
    assert course["held_out_effects_fixed"]["rms_mm"] <= course["held_out"]["rms_mm"] + 0.01 < 1.25 * 0.3 * 3**0.5
    history = tomllib.loads((folder / "best.toml").read_text())["history"]
    assert [(entry["step"], entry["of"]) for entry in history] == [("fit", ""), ("add", "backlash@joint2")]


@pytest.mark.slow
def test_an_arm_of_ones_own(folder: Path) -> None:
    (folder / "mine.toml").write_text((ROOT / "config" / "arms" / "lrm-lab.toml").read_text())
    stdout_of("fit", EXAMPLE, "--arm", folder / "mine.toml", "--parameters", "option3", "-o", folder / "own.toml")
    assert tomllib.loads((folder / "own.toml").read_text())["arm"] == "mine.toml"
    stdout_of("compare", folder / "own.toml", EXAMPLE)


@pytest.mark.long
def test_predict_says_that_times_are_not_used(folder: Path) -> None:
    """A drift of the model would be left out without a word."""
    poses = folder / "set_clock.csv"
    poses.write_text("pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,t_s\n1,0,0,0,0,0,0,60\n2,9,0,0,0,0,0,20\n")
    _, _, said = run_command("predict", folder / "model.toml", poses, "-o", folder / "p.csv")
    assert "t_s runs backwards at pose 2, so no times are used" in " ".join(said.split())


def test_output_to_a_full_disk_is_one_line() -> None:
    """Before: a traceback. What is written with `>` is no file of the tool, so no other check sees it."""
    words = [sys.executable, "-m", "lrm_ident", "explain", "RMS"]
    done = subprocess.run(words, stdout=full_disk_file(), stderr=subprocess.PIPE, text=True, cwd=ROOT)
    assert done.returncode == 2
    assert done.stderr == "error: No space left on device\n"


@pytest.mark.slow
@pytest.mark.parametrize("encoding", ["cp1252", "ascii"])
def test_what_an_encoding_lacks_is_written_plainly(folder: Path, encoding: str) -> None:
    """As in `lrm-ident diagnose … > result.txt` on Windows. Before: a traceback."""
    words = [sys.executable, "-m", "lrm_ident", "diagnose", folder / "model.toml", EXAMPLE]
    environment = {**os.environ, "PYTHONIOENCODING": encoding}
    done = subprocess.run(words, capture_output=True, cwd=ROOT, env=environment, encoding=encoding)
    assert done.returncode == 0, done.stderr
    assert "3.03 -> 0.57 mm RMS" in done.stdout
    assert ("2.272 +- 0.020" if encoding == "ascii" else "2.272 ± 0.020°") in done.stdout


@pytest.mark.parametrize("command", ["", "fit", "compare", "predict"])
def test_help_teaches(command: str) -> None:
    said = stdout_of(*([command] if command else []), "--help")
    assert "Usage" in said
    assert len(said) > 400


def test_the_shipped_example_is_what_its_generator_makes(tmp_path: Path) -> None:
    for made in synthetic.write_example(tmp_path):
        assert made.read_text() == (EXAMPLE.parent / made.name).read_text()


@pytest.mark.slow
def test_ctrl_c_skips_the_nested_cross_validation_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Before: it ended the command with exit code 130, and the conclusion was not printed."""

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Study, "nested_held_out", interrupted)
    data, model = part_of_example(tmp_path), tmp_path / "model.toml"
    stdout_of("fit", data, "--arm", "lrm-lab", "-o", model)
    printed = stdout_of("auto", model, data, "-o", tmp_path / "best.toml", "--nested", "--max-effects", "1")
    assert "skipped by Ctrl-C" in printed
    assert "\nNext\n  1. " in printed
