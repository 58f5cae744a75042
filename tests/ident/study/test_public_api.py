"""The public API: its doctest, the notebook of the docs, and the names that it promises."""

from __future__ import annotations

import doctest
import inspect
import json
import re
import runpy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pdoc import pdoc

import lrm_ident as lrm
from lrm_ident.data.measurements import Measurements
from lrm_ident.residual.error_breakdown import NestedResidual
from lrm_ident.study import api
from lrm_math.arm.arm_file import load_arm
from lrm_math.errors import LrmError
from tests.conftest import ROOT


@pytest.mark.slow
def test_the_doctest_of_the_api_holds() -> None:
    assert doctest.testmod(api, verbose=False) == doctest.TestResults(failed=0, attempted=4)


@pytest.mark.slow
def test_the_notebook_of_the_docs_names_the_hidden_effect(capsys: pytest.CaptureFixture[str]) -> None:
    cells = json.loads((ROOT / "docs" / "example.ipynb").read_text(encoding="utf-8"))["cells"]
    told: dict[str, Any] = {}
    for cell in cells:
        if cell["cell_type"] == "code":
            assert not cell["outputs"], "what a cell printed is not kept"
            exec("".join(cell["source"]), told)
    assert told["diagnosis"].first.scored.name == "backlash@joint2"
    assert told["second"].held_out.error.mean < 0.25 * told["first"].held_out.error.mean
    assert "backlash" in (told["folder"] / "model.toml").read_text()
    assert "nothing_missing" in capsys.readouterr().out
    shown = {name: told[name]._repr_html_() for name in ("study", "first", "diagnosis")}
    assert all("<table" in html for html in shown.values())
    assert "backlash@joint2" in shown["diagnosis"]
    assert "data:image/png" in shown["diagnosis"]
    assert "data:image/png" in shown["first"]
    assert "<iframe" in told["better"].view()._repr_html_()
    for result in (told["study"], told["first"], told["diagnosis"], told["diagnosis"].first):
        assert len(repr(result)) < 200, "a notebook asks for this beside the picture, and keeps it"


@pytest.mark.slow
def test_the_recipe_of_the_docs_finds_what_it_hides(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page = (ROOT / "docs" / "your-arm.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", page, re.S)
    (tmp_path / "recipe.py").write_text(code, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    told = runpy.run_path("recipe.py")
    assert told["found"].first.scored.name == "backlash@joint2"
    better = told["study"].add("backlash@joint2").model
    assert better.value("backlash.joint2.b_rad") == pytest.approx(told["hidden"]["backlash.joint2.b_rad"], rel=0.1)
    (sentence,) = re.findall(r"\*(joint 2 has .*?)\*", page)
    assert sentence in capsys.readouterr().out


@pytest.mark.long
def test_measurements_studies_and_fits_say_in_a_line_what_they_are() -> None:
    data = lrm.load(lrm.EXAMPLE)
    begun = lrm.Study.of(data)
    study = begun.fit()
    better, known = study.add("backlash@joint2"), len(study.model.free)
    columns = "positions, payloads, times, sessions"
    assert repr(data) == f"<Measurements of lrm-lab: 300 poses, 6 joints; {columns}; hidden-play.csv>"
    count = f"{len(begun.model.free)} free parameters, 300 poses"
    assert repr(begun) == f"<Study of lrm-lab: nothing is fitted yet; {count}>"
    assert repr(study) == f"<Study of lrm-lab: fit; {known} free parameters, 300 poses>"
    assert repr(better).startswith("<Study of lrm-lab: fit, add backlash@joint2; ")
    assert repr(replace(better, source=better.file, step=None)) == repr(better)
    assert re.fullmatch(rf"<Fit of lrm-lab: {known} parameters, 300 poses, \d+\.\d+ mm RMS>", repr(study.taken.fit))
    assert repr(data.poses) == "<Poses: 300 of 6 joints>"
    effects, total = "offsets, compliance, backlash@joint2", len(better.model.keys)
    assert repr(better.model) == f"<Model of lrm-lab: {effects}; {total} parameters, {len(better.model.free)} free>"
    assert re.fullmatch(r"<HeldOutResidual: \d+\.\d+ mm mean, \d+\.\d+ mm RMS>", repr(study.held_out))
    assert len(repr(study.errors)) < 600
    assert repr(NestedResidual(None, "too few")) == "<NestedResidual: too few>"
    assert repr(begun.model.arm) == "<Arm lrm-lab: 6 joints>"
    assert repr(load_arm("two-joint")) == "<Arm two-joint: 2 joints>"
    assert repr(load_arm("so101")).startswith("<Arm so101: 5 joints (shoulder_pan, shoulder_lift, ")


def test_a_signature_names_the_catalogue_and_does_not_list_it() -> None:
    assert " = CATALOGUE, " in str(inspect.signature(lrm.Study.of))


@pytest.mark.long
def test_a_notebook_shows_what_a_step_left_out_below_the_steps() -> None:
    study = replace(lrm.Study.of(lrm.load(lrm.EXAMPLE)).fit("option3"), notices=("outliers, left out: pose 7",))
    assert "<p>outliers, left out: pose 7</p>" in study._repr_html_()


@pytest.mark.long
@pytest.mark.parametrize(
    ("columns", "word"),
    [
        ({"attitude": np.zeros((2, 3, 3))}, "orientations"),
        ({"feedback": np.zeros((2, 6))}, "joint feedback"),
        ({"distance": np.ones(2)}, "distances"),
        ({"sd": np.ones(2)}, "standard deviations"),
    ],
)
def test_measurements_name_the_columns_that_they_have(columns: dict[str, Any], word: str) -> None:
    data = lrm.load(lrm.EXAMPLE).take([0, 1])
    assert word not in repr(data)
    assert word in repr(replace(data, **columns))


@pytest.mark.slow
def test_the_reference_shows_every_public_function(tmp_path: Path) -> None:
    pdoc("lrm_ident.study.api", "lrmd.client", output_directory=tmp_path)
    page = (tmp_path / "lrm_ident" / "study" / "api.html").read_text()
    assert all(f'id="{name}"' in page for name in api.__all__)
    assert 'id="Rover.move"' in (tmp_path / "lrmd" / "client.html").read_text()


def test_every_public_name_exists_and_says_what_it_is() -> None:
    assert lrm.__all__ == sorted([*api.__all__, "plot"], key=lambda name: (not name.isupper(), name))
    assert set(lrm.__all__) <= set(dir(lrm))
    for name in lrm.__all__:
        value = getattr(lrm, name)
        assert isinstance(value, Path) or inspect.getdoc(value)
    with pytest.raises(AttributeError, match="no attribute 'fitt'"):
        _ = lrm.fitt  # type: ignore[attr-defined]


def test_what_cannot_be_plotted_or_fitted_is_one_clear_line(tmp_path: Path) -> None:
    with pytest.raises(LrmError, match="cannot plot a str"):
        lrm.plot("a model", tmp_path / "x.png")
    data = lrm.load(lrm.EXAMPLE)
    nameless = Measurements(
        data.poses, data.pose, data.tcp, data.sd, data.noise_sd, data.repeat_of, data.path, data.sha256
    )
    with pytest.raises(LrmError, match="no arm"):
        lrm.fit(nameless)


def test_a_saved_model_finds_the_file_of_its_arm(tmp_path: Path) -> None:
    own = tmp_path / "own.toml"
    own.write_text((ROOT / "config" / "arms" / "lrm-lab.toml").read_text().replace('name = "lrm-lab"', 'name = "own"'))
    data = lrm.load(lrm.EXAMPLE, arm=str(own))
    lrm.save(lrm.fit(data, parameters="option3"), data, str(tmp_path / "model.toml"))
    assert lrm.load_model(str(tmp_path / "model.toml")).arm == data.arm
