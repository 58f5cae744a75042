"""A model is of the arm and rows that it was fitted on, whatever stands in their place; its file is compact."""

from __future__ import annotations

import re
import tomllib
from hashlib import sha256
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import tomli_w

import lrm_ident as lrm
from lrm_ident.data.measurement_file.write import measurements_csv
from lrm_ident.measuring.verification.goal_commands import ModelSolver
from lrm_ident.study import other_data
from lrm_ident.study.model_history import model_text
from lrm_ident.study.other_data import model_for_data
from lrm_math.arm.arm_digest import arm_sha256
from lrm_math.arm.arm_file import load_arm, shipped_arms
from lrm_math.errors import FileError
from lrm_math.model.model_file import ModelFile, as_tables
from lrm_math.toml_file import read_toml
from tests.support.commands import run_command, stdout_of
from tests.support.misreadings import random_arm_data

SAID = "is not as it was when the model was fitted: links, tool or masses differ"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """An arm file, measurements of it, and the model of their fit."""
    (tmp_path / "arm.toml").write_text(shipped_arms()["two-joint"].read_text())
    (tmp_path / "data.csv").write_text(measurements_csv(random_arm_data("two-joint", 5, poses=40)))
    arm = ["--arm", tmp_path / "arm.toml"]
    stdout_of("fit", tmp_path / "data.csv", *arm, "--effects", "offsets", "-o", tmp_path / "model.toml")
    return tmp_path


def change_mass(folder: Path) -> None:
    arm = folder / "arm.toml"
    arm.write_text(re.sub(r"^mass_g = .*$", "mass_g = 123.0", arm.read_text(), count=1, flags=re.MULTILINE))


def notices_of(*words: object) -> str:
    code, _, stderr = run_command(*words)
    assert code == 0, stderr
    return " ".join(stderr.split())


@pytest.mark.long
def test_the_file_keeps_the_digest_of_its_arm(folder: Path) -> None:
    text = tomllib.loads((folder / "model.toml").read_text())
    assert text["provenance"]["arm_sha256"] == arm_sha256(load_arm(folder / "arm.toml"))
    assert SAID not in notices_of("compare", folder / "model.toml", folder / "data.csv")


@pytest.mark.long
def test_another_arm_of_that_name_is_told(folder: Path) -> None:
    model, data = folder / "model.toml", folder / "data.csv"
    change_mass(folder)
    assert notices_of("compare", model, data).count(f"model.toml: two-joint {SAID}") == 1
    with pytest.raises(FileError, match=SAID):
        lrm.load_model(model)
    stdout_of("fit", data, "--arm", folder / "arm.toml", "--start", model, "-o", folder / "again.toml")
    lrm.load_model(folder / "again.toml")


@pytest.mark.long
def test_a_model_of_before_the_digest_is_read_as_ever(folder: Path) -> None:
    model = folder / "model.toml"
    before = lrm.load_model(model).values
    model.write_text(re.sub(r"^arm_sha256 = .*\n", "", model.read_text(), flags=re.MULTILINE))
    change_mass(folder)
    np.testing.assert_array_equal(lrm.load_model(model).values, before)
    assert SAID not in notices_of("compare", model, folder / "data.csv")


@pytest.mark.long
def test_goals_are_not_driven_to_by_a_model_of_another_arm_of_that_name(folder: Path) -> None:
    (folder / "elsewhere").mkdir()
    (folder / "elsewhere" / "arm.toml").write_text((folder / "arm.toml").read_text())
    change_mass(folder / "elsewhere")
    with pytest.raises(FileError, match="a model of another two-joint"):
        ModelSolver.of(folder / "model.toml", load_arm(folder / "elsewhere" / "arm.toml"), tuple)


@pytest.mark.long
def test_a_model_file_is_short_and_older_files_read_the_same(tmp_path: Path, example_study: lrm.Study) -> None:
    file = example_study.file
    long, short = tmp_path / "long.toml", tmp_path / "short.toml"
    long.write_text(tomli_w.dumps(as_tables(file)))
    short.write_text(model_text(file))
    assert read_toml(short, ModelFile) == read_toml(long, ModelFile) == file
    lines = [len(path.read_text().splitlines()) for path in (short, long)]
    assert lines[0] < 8 * len(file.parameters) < lines[1] / 4


FITTED = b"q1,x\n1,2\n"


@pytest.mark.parametrize(("now", "whole"), [(FITTED + b"3,4\n", True), (b"q1,x\n1,5\n3,4\n", False)])
def test_added_rows_leave_it_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, now: bytes, whole: bool) -> None:
    path = tmp_path / "data.csv"
    path.write_bytes(now)
    model: Any = SimpleNamespace(effects=(SimpleNamespace(name="drift@joint1"),), fitted_to=sha256(FITTED).hexdigest())
    deployed = SimpleNamespace(effects=())
    monkeypatch.setattr(other_data, "of_a_session", lambda _: True)
    monkeypatch.setattr(other_data, "as_deployed", lambda _: deployed)
    found, said = model_for_data(model, path, sha256(now).hexdigest())
    assert (found is model) is whole
    assert bool(said) is not whole
