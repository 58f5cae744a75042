"""A model is of the arm that it was fitted on, whatever an arm file is called that stands in its place."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

import lrm_ident as lrm
from lrm_ident.data.measurement_file.write import measurements_csv
from lrm_ident.measuring.verification.goal_commands import ModelSolver
from lrm_math.arm.arm_digest import arm_sha256
from lrm_math.arm.arm_file import load_arm, shipped_arms
from lrm_math.errors import FileError
from tests.support.commands import run_command, stdout_of
from validation.misreadings import random_arm_data

pytestmark = pytest.mark.long

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


def test_the_file_keeps_the_digest_of_its_arm(folder: Path) -> None:
    text = tomllib.loads((folder / "model.toml").read_text())
    assert text["provenance"]["arm_sha256"] == arm_sha256(load_arm(folder / "arm.toml"))
    assert SAID not in notices_of("compare", folder / "model.toml", folder / "data.csv")


def test_another_arm_of_that_name_is_told(folder: Path) -> None:
    model, data = folder / "model.toml", folder / "data.csv"
    change_mass(folder)
    assert notices_of("compare", model, data).count(f"model.toml: two-joint {SAID}") == 1
    with pytest.raises(FileError, match=SAID):
        lrm.load_model(model)
    stdout_of("fit", data, "--arm", folder / "arm.toml", "--start", model, "-o", folder / "again.toml")
    lrm.load_model(folder / "again.toml")


def test_a_model_of_before_the_digest_is_read_as_ever(folder: Path) -> None:
    model = folder / "model.toml"
    before = lrm.load_model(model).values
    model.write_text(re.sub(r"^arm_sha256 = .*\n", "", model.read_text(), flags=re.MULTILINE))
    change_mass(folder)
    np.testing.assert_array_equal(lrm.load_model(model).values, before)
    assert SAID not in notices_of("compare", model, folder / "data.csv")


def test_goals_are_not_driven_to_by_a_model_of_another_arm_of_that_name(folder: Path) -> None:
    (folder / "elsewhere").mkdir()
    (folder / "elsewhere" / "arm.toml").write_text((folder / "arm.toml").read_text())
    change_mass(folder / "elsewhere")
    with pytest.raises(FileError, match="a model of another two-joint"):
        ModelSolver.of(folder / "model.toml", load_arm(folder / "elsewhere" / "arm.toml"), tuple)
