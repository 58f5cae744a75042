"""Covariance of the parameters: from the fit to the model file and back."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from hypothesis import given
from hypothesis import strategies as st

from lrm_ident.data.measurement_file.load import load_measurements
from lrm_ident.data.measurements import Measurements
from lrm_ident.diagnosis.add_effect import add_effects
from lrm_ident.fitting import cross_validation
from lrm_ident.fitting.levenberg_marquardt import Fit, fit
from lrm_ident.fitting.parameter_sets import select_parameters
from lrm_ident.residual.error_breakdown import HeldOutResidual
from lrm_ident.study.model_history import model_file, model_text, undo_step
from lrm_math.arm.arm import Arm
from lrm_math.effects import effects_at
from lrm_math.errors import FileError, LrmError
from lrm_math.model.covariance import covariance_table, to_covariance
from lrm_math.model.model import Model, model_of
from lrm_math.model.model_file import ModelFile, load_covariance, load_model
from lrm_math.model.step_name import ADD, FIT, StepName
from lrm_math.toml_file import read_toml
from tests.conftest import EXAMPLE
from tests.support.commands import part_of_example, stdout_of


@pytest.fixture(scope="module")
def measured(lab: Arm) -> Measurements:
    """The shipped example."""
    return load_measurements(EXAMPLE, lab)


@pytest.fixture(scope="module")
def fitted(lab: Arm, measured: Measurements) -> Fit:
    """The thesis's option 1 of the shipped example."""
    model = model_of(lab, effects_at(lab, "offsets") + effects_at(lab, "compliance"))
    return fit(Model(lab, model.effects, model.values, select_parameters(model, "option1")), measured)


def written(fit: Fit, data: Measurements, path: Path) -> ModelFile:
    file = model_file(fit, data, HeldOutResidual(None, "not asked for"), "lrm-lab", StepName(FIT))
    path.write_text(model_text(file))
    return file


@pytest.mark.long
@given(seed=st.integers(0, 1000), size=st.integers(1, 12))
def test_covariance_table_round_trip(lab: Arm, seed: int, size: int) -> None:
    rng = np.random.default_rng(seed)
    model = model_of(lab, effects_at(lab, "offsets") + effects_at(lab, "compliance"))
    keys = [model.keys[i] for i in np.sort(rng.choice(len(model.keys), size, replace=False))]
    units = np.array([model.parameter(key).si for key in keys])
    root = rng.normal(size=(size, size + 2)) * 10 ** rng.uniform(-6, 0, (size, 1))
    matrix = root @ root.T
    sigma = dict(zip(keys, (np.sqrt(np.diag(matrix)) / units).tolist(), strict=True))
    back = to_covariance(covariance_table(keys, matrix), sigma, model)
    assert back.keys == tuple(keys)
    scale = np.sqrt(np.outer(np.diag(matrix), np.diag(matrix)))
    np.testing.assert_allclose(back.matrix / scale, matrix / scale, atol=1e-8)


def test_the_fits_covariance_is_in_its_file(fitted: Fit, measured: Measurements, tmp_path: Path) -> None:
    written(fitted, measured, tmp_path / "model.toml")
    covariance = load_covariance(tmp_path / "model.toml")
    told = [j for j, key in enumerate(fitted.model.free) if key not in fitted.at_bound]
    assert covariance.keys == tuple(fitted.model.free[j] for j in told)
    error = fitted.standard_error[told]
    ours = fitted.covariance[np.ix_(told, told)] / np.outer(error, error)
    np.testing.assert_allclose(covariance.matrix / np.outer(error, error), ours, atol=1e-8)


def test_undo_restores_every_byte(fitted: Fit, measured: Measurements, lab: Arm, tmp_path: Path) -> None:
    before = written(fitted, measured, tmp_path / "model.toml")
    more = add_effects(fitted.model, measured, effects_at(lab, "servo_gain@joint2"))
    after = model_file(more, measured, HeldOutResidual(None, ""), "lrm-lab", StepName(ADD), before.history)
    (tmp_path / "after.toml").write_text(model_text(after))
    read = read_toml(tmp_path / "after.toml", ModelFile)
    assert read.covariance.keys != before.covariance.keys
    assert model_text(undo_step(read)) == (tmp_path / "model.toml").read_text()
    with pytest.raises(LrmError, match="nothing to undo"):
        undo_step(before)


def test_files_without_covariance_still_load(fitted: Fit, measured: Measurements, tmp_path: Path) -> None:
    tables = tomllib.loads(model_text(written(fitted, measured, tmp_path / "model.toml")))
    del tables["covariance"], tables["history"][0]["covariance"]
    (tmp_path / "old.toml").write_text(tomli_w.dumps(tables))
    assert load_covariance(tmp_path / "old.toml") is None
    np.testing.assert_array_equal(load_model(tmp_path / "old.toml").values, fitted.model.values)


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        (lambda t: t["correlation"].pop(), "should be 378"),
        (lambda t: t["keys"].__setitem__(0, t["keys"][1]), "stands twice"),
        (lambda t: t["keys"].__setitem__(0, "offsets.joint9.a_mm"), "unknown parameter"),
        (lambda t: t["keys"].__setitem__(0, "offsets.joint1.a_mm"), "no standard error"),
        (lambda t: t["correlation"].__setitem__(slice(None), [-0.9] * 378), "contradict"),
        (lambda t: t["correlation"].__setitem__(0, 1.5), "contradict"),
    ],
)
def test_bad_covariance_is_error(fitted: Fit, measured: Measurements, tmp_path: Path, fault: object, said: str) -> None:
    path = tmp_path / "model.toml"
    tables = tomllib.loads(model_text(written(fitted, measured, path)))
    fault(tables["covariance"])  # type: ignore[operator]
    path.write_text(tomli_w.dumps(tables))
    with pytest.raises(FileError, match=said) as error:
        load_covariance(path)
    assert "model.toml: covariance" in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.slow
def test_every_command_that_fits_writes_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cross_validation, "MOST_REFITTED", 0)
    data = part_of_example(tmp_path, 90)
    stdout_of("fit", data, "--parameters", "option4", "-o", tmp_path / "a.toml")
    stdout_of("add", tmp_path / "a.toml", data, "servo_gain@joint2", "-o", tmp_path / "b.toml")
    stdout_of("auto", tmp_path / "a.toml", data, "--max-effects", 1, "--no-nested", "-o", tmp_path / "c.toml")
    stdout_of("undo", tmp_path / "b.toml", "-o", tmp_path / "back.toml")
    assert (tmp_path / "back.toml").read_bytes() == (tmp_path / "a.toml").read_bytes()
    for name in ("a", "b", "c"):
        covariance = load_covariance(tmp_path / f"{name}.toml")
        assert np.linalg.eigvalsh(covariance.matrix)[0] > 0
    added = load_covariance(tmp_path / "b.toml")
    assert any(key.startswith("servo_gain.joint2") for key in added.keys)
