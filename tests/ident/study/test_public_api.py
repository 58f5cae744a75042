"""The public API: its doctest, the notebook of the docs, and the names that it promises."""

from __future__ import annotations

import doctest
import inspect
import runpy
from pathlib import Path

import pytest
from pdoc import pdoc

import lrm_ident as lrm
from lrm_ident.data.measurements import Measurements
from lrm_ident.study import api
from lrm_math.errors import LrmError
from tests.conftest import ROOT


@pytest.mark.slow
def test_the_doctest_of_the_api_holds() -> None:
    assert doctest.testmod(api, verbose=False) == doctest.TestResults(failed=0, attempted=4)


@pytest.mark.slow
def test_the_notebook_of_the_docs_names_the_hidden_effect(capsys: pytest.CaptureFixture[str]) -> None:
    told = runpy.run_path(str(ROOT / "docs" / "example.py"))
    assert told["diagnosis"].first.scored.name == "backlash@joint2"
    assert told["second"].held_out.error.mean < 0.25 * told["first"].held_out.error.mean
    assert {"where.png", "why.png", "model.toml"} <= {path.name for path in told["folder"].iterdir()}
    assert "backlash" in (told["folder"] / "model.toml").read_text()
    assert "nothing_missing" in capsys.readouterr().out
    shown = {name: told[name]._repr_html_() for name in ("study", "first", "diagnosis", "page")}
    assert all("<table" in html for name, html in shown.items() if name != "page")
    assert "backlash@joint2" in shown["diagnosis"]
    assert "data:image/png" in shown["diagnosis"]
    assert "data:image/png" in shown["first"]
    assert shown["page"].startswith("<iframe")


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
