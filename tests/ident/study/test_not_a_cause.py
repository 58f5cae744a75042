"""Effects that name no cause say so at every door that lists effects, by one mark."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from lrm_ident.report.document import ResultTable
from lrm_ident.report.fit import comparison_document
from lrm_ident.report.model_report import provenance_table, quick_report
from lrm_ident.report.plain_names import plain_name, step_title
from lrm_ident.study.model_history import model_text
from lrm_ident.study.study import Study
from lrm_math.effects import ALL_EFFECTS, NOT_A_CAUSE, marked
from lrm_math.model.model_file import ModelFile, load_model
from lrm_math.model.step_name import ADD, StepName
from lrm_math.model.uncertainty import field_coverage
from lrm_math.toml_file import read_toml
from lrmd.cli.text import field_text
from lrmd.config import load_config
from lrmd.ik.deployed_model import deploy_file
from lrmd.messages.control import FieldPart
from tests.support.commands import stdout_of
from tests.support.daemon.in_memory_daemon import CONFIG
from tests.support.nameless_arm import WIDEST, measured


@pytest.fixture(scope="module")
def study(with_field: Study) -> Study:
    return with_field


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
        step_title(StepName(ADD, kind.id)),
    ):
        assert (NOT_A_CAUSE in words) is not kind.names_a_cause


@pytest.mark.long
def test_the_model_file_says_it_and_reads_the_same(study: Study, file: Path) -> None:
    assert f"# residual_field ({NOT_A_CAUSE})" in file.read_text().splitlines()
    assert study.file.history[-1].name == StepName(ADD, "residual_field@tool")
    assert load_model(file).free == study.model.free
    assert "#" not in model_text(study.undo().file), "causes alone need no mark"


@pytest.mark.long
def test_the_report_and_its_card_say_it(study: Study) -> None:
    found = quick_report(study)
    effects = dict(provenance_table(found.file).text())["effects"]
    assert marked("residual_field") in effects
    (card,) = found.cards
    assert NOT_A_CAUSE in card.title
    assert "no cause" in card.claim
    assert card.estimates == (), "no coefficient means anything alone"


@pytest.mark.long
@pytest.mark.parametrize("name", ["arm.urdf", "arm.xml"])
def test_exports_list_it_as_no_cause(file: Path, tmp_path: Path, name: str) -> None:
    out = " ".join(stdout_of("arm", "export", file, "-o", tmp_path / name).split())
    assert marked("residual_field@tool") in out.split("Not in it:")[1]


def test_the_list_of_effects_says_it() -> None:
    assert marked("residual_field") in stdout_of("effects")


@pytest.mark.long
def test_compare_says_it_and_where_it_speaks(study: Study) -> None:
    found = study.compare()
    assert found.speaks.all(), "at its own data"
    document = comparison_document(found)
    titles = [block.title for block in document.blocks if isinstance(block, ResultTable)]
    assert f"Where {marked('residual_field@tool')} speaks" in titles
    assert document.values["field"] == {
        "effect": "residual_field@tool",
        "names_a_cause": False,
        "does_not_speak_at": [],
    }
    plain = study.undo().compare()
    assert plain.speaks is None
    assert "field" not in comparison_document(plain).values


@pytest.mark.long
def test_poses_beyond_its_range_are_told(file: Path) -> None:
    """Reads the model from its file, on other data."""
    far = measured(5, 0.0)
    q = far.poses.q.copy()
    q[:20, 0] = 2.0 * WIDEST
    other = replace(far, poses=replace(far.poses, q=q))
    study = Study(load_model(file), other, "lrm-lab", source=read_toml(file, ModelFile))
    values = comparison_document(study.compare()).values
    assert values["field"]["does_not_speak_at"] == far.pose[:20].tolist()  # type: ignore[index]


@pytest.mark.long
def test_a_deployment_says_how_much_of_the_reach_it_covers(study: Study, file: Path) -> None:
    config = replace(load_config(CONFIG), arm=study.model.arm)
    coverage = deploy_file(config, file).field
    assert coverage == field_coverage(study.model, study.covariance)
    said = field_text(FieldPart(effect=marked(coverage.effect), speaks_share=coverage.speaks, outside_share=0.98))
    assert said.startswith(marked("residual_field@tool"))
    assert f"{100 * coverage.speaks:.0f} %" in said
    assert "98 %" in said
    assert deploy_file(config, None).field is None
