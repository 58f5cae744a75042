"""An arm of one's own, named by its path on the computer and by another on the rover: its models are deployed, too."""

from __future__ import annotations

import json
import re
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_math.arm.arm_digest import arm_sha256
from lrm_math.arm.arm_file import load_arm
from lrm_math.errors import FileError, LrmError
from lrmd.api.model_reload import ActiveModel
from lrmd.client.model_text import text_to_deploy
from lrmd.config import Config, load_config
from lrmd.ik.deployed_model import deploy_file
from lrmd.ramp.shared_memory import SharedRecords
from tests.conftest import ROOT
from tests.support.daemon.in_memory_daemon import CONFIG

pytestmark = pytest.mark.long

MODEL = (ROOT / "tests" / "models" / "thesis-table-b2-option-1.toml").read_text(encoding="utf-8")
ARM = (ROOT / "config" / "arms" / "lrm-rover.toml").read_text(encoding="utf-8")
PROVENANCE = """
[provenance]
data = "data.csv"
data_sha256 = "0"
arm_sha256 = "{}"
poses = 50
tool = "lrm-ident"
date = "2024-07-15"
"""
NAMES = st.text(st.characters(exclude_categories=["C", "Zl", "Zp"]), min_size=1, max_size=40)


def written(folder: Path, name: str) -> tuple[Path, Path]:
    """An arm file without shapes, as `arm new` and `arm import` write it, and a model that names it by its path."""
    folder.mkdir(exist_ok=True)
    arm, model = folder / "arm.toml", folder / "model.toml"
    plain = re.split(r"\n\[\[(?:capsule|box)\]\]", ARM)[0]
    arm.write_text(plain.replace('name = "lrm-rover"', f"name = {json.dumps(name, ensure_ascii=False)}", 1), "utf-8")
    model.write_text(MODEL.replace('"lrm-rover"', '"arm.toml"'), "utf-8")
    return arm, model


def on_the_rover(folder: Path, name: str) -> Config:
    arm, _ = written(folder / "etc", name)
    config = folder / "lrmd.toml"
    config.write_text(CONFIG.read_text("utf-8").replace('arm = "lrm-rover"', f'arm = "{arm}"'), "utf-8")
    return replace(load_config(config), state=folder / "state")


@given(name=NAMES)
def test_the_text_is_that_of_the_file_with_its_arm_by_name(name: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    _, model = written(tmp_path_factory.mktemp("own"), name)
    tables = tomllib.loads(text_to_deploy(model))
    assert tables == {**tomllib.loads(model.read_text("utf-8")), "arm": name}


def test_a_model_of_a_shipped_arm_is_sent_as_it_is(tmp_path: Path) -> None:
    model = tmp_path / "model.toml"
    model.write_text(MODEL, "utf-8")
    assert text_to_deploy(model) == MODEL


def test_a_file_that_is_none_is_named_before_anything_is_sent(tmp_path: Path) -> None:
    arm, model = written(tmp_path, "my-arm")
    arm.unlink()
    for path, said in (model, "arm.toml"), (tmp_path / "none.toml", "none.toml"):
        with pytest.raises(FileError, match=said):
            text_to_deploy(path)


def test_a_model_of_the_daemons_own_arm_is_used_whatever_its_files_are_called(tmp_path: Path) -> None:
    _, model = written(tmp_path / "home", "my-arm")
    active = ActiveModel(on_the_rover(tmp_path, "my-arm"), SharedRecords.create())
    assert active.deploy(text_to_deploy(model)).model.arm.name == "my-arm"


def test_a_model_of_another_arm_is_told_which_arm_this_is(tmp_path: Path) -> None:
    _, model = written(tmp_path / "home", "another")
    active = ActiveModel(on_the_rover(tmp_path, "my-arm"), SharedRecords.create())
    with pytest.raises(LrmError, match="'another' is no arm of this daemon's; this daemon drives my-arm"):
        active.deploy(text_to_deploy(model))


def change_mass(arm: Path) -> None:
    arm.write_text(re.sub(r"^mass_g = .*$", "mass_g = 77.0", arm.read_text("utf-8"), count=1, flags=re.MULTILINE))


def test_a_model_that_was_fitted_on_another_arm_of_that_name_is_refused(tmp_path: Path) -> None:
    arm, model = written(tmp_path / "home", "my-arm")
    config = on_the_rover(tmp_path, "my-arm")
    active = ActiveModel(config, SharedRecords.create())
    of_fit = MODEL.replace('"lrm-rover"', '"my-arm"', 1) + PROVENANCE.format(arm_sha256(load_arm(arm)))
    assert active.deploy(of_fit).model.arm.name == "my-arm"
    change_mass(arm)
    other = MODEL.replace('"lrm-rover"', '"my-arm"', 1) + PROVENANCE.format(arm_sha256(load_arm(arm)))
    with pytest.raises(
        LrmError, match="my-arm is not as it was when the model was fitted: links, tool or masses"
    ) as no:
        active.deploy(other)
    assert "\n" not in str(no.value)
    with pytest.raises(FileError, match="a model of another my-arm: links, tool or masses differ"):
        deploy_file(config, model)
