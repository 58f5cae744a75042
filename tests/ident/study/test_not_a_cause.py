"""What names no cause says so at every door that lists effects, by one mark."""

from __future__ import annotations

from pathlib import Path

import pytest

from lrm_ident.report.history import provenance_table
from lrm_ident.report.model_report import quick_report
from lrm_ident.report.names.plain_names import plain_name, step_title
from lrm_ident.study.model_history import model_text
from lrm_ident.study.study import Study
from lrm_math.effects import ALL_EFFECTS, NOT_A_CAUSE, marked
from lrm_math.model.model_file import load_model
from tests.support.commands import stdout_of
from validation.residual_field.nameless_arm import measured


@pytest.fixture(scope="module")
def study() -> Study:
    return Study.of(measured(1, 3e-3)).fit("option1").add_field()


@pytest.fixture(scope="module")
def file(study: Study, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("field") / "field.toml"
    study.save(path)
    return path


@pytest.mark.parametrize("kind", ALL_EFFECTS, ids=lambda kind: kind.id)
def test_the_catalogue_decides(kind: type) -> None:
    """Every name of an effect, short, long or plain, is marked where its class names no cause, and only there."""
    for words in (
        marked(kind.id),
        marked(f"{kind.id}@tool"),
        plain_name(f"{kind.id}@tool"),
        step_title(f"add {kind.id}"),
    ):
        assert (NOT_A_CAUSE in words) is not kind.names_a_cause


def test_the_model_file_says_it_and_reads_the_same(study: Study, file: Path) -> None:
    assert f"# residual_field ({NOT_A_CAUSE})" in file.read_text().splitlines()
    assert f"add residual_field@tool, {NOT_A_CAUSE}" in study.file.history[-1].step
    assert load_model(file).free == study.model.free
    assert "#" not in model_text(study.undo().file), "causes alone need no mark"


def test_the_report_and_its_card_say_it(study: Study) -> None:
    found = quick_report(study)
    effects = dict(provenance_table(found.file).text())["effects"]
    assert marked("residual_field") in effects
    (card,) = found.cards
    assert NOT_A_CAUSE in card.title
    assert "no cause" in card.claim
    assert card.estimates == (), "no coefficient means anything alone"


@pytest.mark.parametrize("name", ["arm.urdf", "arm.xml"])
def test_exports_list_it_as_no_cause(file: Path, tmp_path: Path, name: str) -> None:
    out = " ".join(stdout_of("arm", "export", file, "-o", tmp_path / name).split())
    assert marked("residual_field@tool") in out.split("Not in it:")[1]


def test_the_list_of_effects_says_it() -> None:
    assert marked("residual_field") in stdout_of("effects")
