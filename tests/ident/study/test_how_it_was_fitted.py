"""The loss and the poses left out belong to the model: every later step uses them as the fit did, and says so."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import lrm_ident as lrm
from lrm_ident.data.measurement_file.write import measurements_csv
from lrm_ident.data.measurements import Measurements
from lrm_math.model.model_file import ProvenanceTable
from tests.support.commands import run_command, stdout_of
from validation.misreadings import random_arm_data

pytestmark = [pytest.mark.usefixtures("one_step_folds"), pytest.mark.long]

LEFT_OUT, WRONG = [7, 20, 21], 33
SAID = "loss huber; 3 poses left out: 7, 20, 21"


def noticed(*words: object) -> str:
    """Stderr of a command that succeeds, on one line."""
    code, _, stderr = run_command(*words)
    assert code == 0, stderr
    return " ".join(stderr.split())


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Measurements with four wrong positions, and a model fitted without three of them, by a loss that bears one."""
    folder = tmp_path_factory.mktemp("fitted")
    data = random_arm_data("two-joint", 5, poses=60)
    for number in (*LEFT_OUT, WRONG):
        data.tcp[data.pose == number] += [0.03, -0.03, 0.03]
    (folder / "data.csv").write_text(measurements_csv(data))
    how = ["--loss", "huber", "--leave-out", "7,20-21"]
    said = stdout_of("fit", folder / "data.csv", "--arm", "two-joint", *how, "-o", folder / "model.toml")
    assert SAID in " ".join(said.split()), said
    return folder


def provenance(path: Path) -> ProvenanceTable:
    return ProvenanceTable.model_validate(tomllib.loads(path.read_text())["provenance"])


@pytest.mark.slow
@pytest.mark.parametrize("command", ["compare", "diagnose", "propose"])
def test_reading_commands_say_and_do_as_the_fit(folder: Path, command: str) -> None:
    assert SAID in noticed(command, folder / "model.toml", folder / "data.csv", "--json", folder / "out.json")
    if command != "propose":
        assert json.loads((folder / "out.json").read_text())["poses"] <= 57


@pytest.mark.slow
@pytest.mark.parametrize("words", [["add", "hysteresis@joint2"], ["auto", "--no-nested", "--max-effects", "1"]])
def test_steps_keep_how_the_model_was_fitted(folder: Path, words: list[str]) -> None:
    model, data, after = folder / "model.toml", folder / "data.csv", folder / "after.toml"
    command, *rest = words
    assert SAID in noticed(command, model, data, *rest, "-o", after, "--force")
    assert provenance(after).loss == "huber"
    assert set(LEFT_OUT) <= set(provenance(after).left_out)
    if command == "add":
        assert SAID in " ".join(stdout_of("undo", after, "-o", folder / "before.toml").split())
        assert (folder / "before.toml").read_text() == model.read_text()


@pytest.mark.slow
def test_other_data_keep_the_loss_but_no_pose_is_left_out(folder: Path) -> None:
    data = lrm.load(folder / "data.csv", arm="two-joint")
    (folder / "other.csv").write_text(measurements_csv(data.take(np.arange(50))))
    said = noticed("compare", folder / "model.toml", folder / "other.csv")
    assert "loss huber" in said
    assert "left out" not in said


@pytest.fixture(scope="module")
def data(folder: Path) -> Measurements:
    return lrm.load(folder / "data.csv", arm="two-joint").without(LEFT_OUT)


@pytest.mark.slow
def test_in_python_a_fit_brings_its_loss_along(data: Measurements) -> None:
    robust, plain = lrm.fit(data, loss="huber"), lrm.fit(data)
    assert robust.weight[data.pose == WRONG] < 0.2
    assert lrm.add(robust, data, "hysteresis@joint2").loss.name == "huber"
    assert lrm.auto(robust, data, max_effects=0).steps[-1].fit.loss.name == "huber"
    assert lrm.diagnose(robust.model, data, loss="huber").diagnosis.fit.loss.name == "huber"
    assert lrm.compare(robust, data).held_out.error == lrm.compare(robust.model, data, "huber").held_out.error
    assert lrm.compare(plain.model, data).held_out.error == lrm.compare(plain, data).held_out.error


def test_poses_are_read_as_the_data_of_the_fit(tmp_path: Path) -> None:
    data = random_arm_data("two-joint", 5, poses=40)
    turned = replace(data, poses=replace(data.poses, q=data.poses.q * [1.0, -1.0]))
    right, other = tmp_path / "right.csv", tmp_path / "other.csv"
    for path, measured in ((right, data), (other, turned)):
        path.write_text(measurements_csv(measured))
    model, predicted = tmp_path / "model.toml", tmp_path / "predicted.csv"
    stdout_of("fit", other, "--arm", "two-joint", "--joint-sign", "1,-1", "-o", model)
    assert "as the options" in noticed("predict", model, other, "-o", predicted)
    as_read = predicted.read_text()
    stdout_of("predict", model, right, "--joint-sign", "1,1", "-o", predicted)
    assert predicted.read_text() == as_read
