"""Bounds of a deployment, and the way back from a damaged one without a daemon."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from lrm_math.errors import LrmError
from lrmd.api.model_reload import ActiveModel
from lrmd.config import Config, load_config
from lrmd.errors import RequestError
from lrmd.main import main
from lrmd.persistence.deployed_models import DeployedVersions
from lrmd.ramp.shared_memory import SharedRecords
from tests.support.daemon.in_memory_daemon import CONFIG

pytestmark = pytest.mark.long

LINK = """\
schema = "lrm/model/1"
arm = "lrm-rover"
effects = ["offsets@joint1"]
[parameters]
"offsets.joint1.d_mm" = {}
"""
"""The first link longer by so much (mm): the whole arm is moved by as much, whatever its pose."""


@pytest.fixture
def config(tmp_path: Path) -> Config:
    return replace(load_config(CONFIG), state=tmp_path / "state")


@pytest.fixture
def active(config: Config) -> ActiveModel:
    return ActiveModel(config, SharedRecords.create())


def test_a_model_with_a_link_of_ten_metres_is_not_deployed(config: Config, active: ActiveModel) -> None:
    for accept in ((), (True,)):
        with pytest.raises(LrmError):
            active.deploy(LINK.format(10_000.0), *accept)
        assert not list(DeployedVersions(config.state).folder.glob("*.toml"))
    with pytest.raises(RequestError, match="accepted"):
        active.deploy(LINK.format(200.0))


def test_a_damaged_deployed_file_is_taken_back_without_a_daemon(
    tmp_path: Path, config: Config, active: ActiveModel, capsys: pytest.CaptureFixture[str]
) -> None:
    text = CONFIG.read_text(encoding="utf-8").replace("/var/lib/lrmd", str(config.state))
    file = tmp_path / "lrmd.toml"
    file.write_text(text, encoding="utf-8")
    for d in (1.0, 2.0):
        active.deploy(LINK.format(d))
    versions = sorted(DeployedVersions(config.state).folder.glob("*.toml"))
    versions[-1].write_text("half a fi", encoding="utf-8")
    assert main(["--config", str(file), "--check"]) == 2
    assert "take it back: lrmd --config FILE --undo" in capsys.readouterr().err
    assert main(["--config", str(file), "--undo"]) == 0
    assert versions[-2].name in capsys.readouterr().out
    assert main(["--config", str(file), "--check"]) == 0
    (DeployedVersions(config.state).folder / "deployed.json").write_text("{", encoding="utf-8")
    assert main(["--config", str(file), "--check"]) == 2
    assert main(["--config", str(file), "--undo"]) == 0
    assert main(["--config", str(file), "--check"]) == 0


def test_the_state_folder_is_not_for_everybody(config: Config, active: ActiveModel) -> None:
    active.deploy(LINK.format(1.0))
    assert DeployedVersions(config.state).folder.stat().st_mode & 0o007 == 0
