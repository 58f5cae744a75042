"""Bounds of a deployment, how far it moves the tip, and the way back from a damaged one without a daemon."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lrm_math.arm.plausible_arm import reach
from lrm_math.errors import LrmError
from lrm_math.model.model import model_of
from lrmd.api.model_reload import ActiveModel
from lrmd.config import Config, load_config
from lrmd.errors import RequestError
from lrmd.ik.tip_movement import LARGE, TipMovement, check_movement, tip_movement
from lrmd.main import main
from lrmd.persistence.deployed_models import DeployedVersions
from lrmd.ramp.shared_memory import SharedRecords
from tests.support.daemon.in_memory_daemon import CONFIG

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


@pytest.mark.long
def test_a_model_with_a_link_of_ten_metres_is_not_deployed(config: Config, active: ActiveModel) -> None:
    for accept in ((), (True,)):
        with pytest.raises(LrmError):
            active.deploy(LINK.format(10_000.0), *accept)
        assert not list(DeployedVersions(config.state).folder.glob("*.toml"))
    with pytest.raises(RequestError, match="accepted"):
        active.deploy(LINK.format(200.0))


@pytest.mark.long
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


@pytest.mark.long
def test_the_state_folder_is_not_for_everybody(config: Config, active: ActiveModel) -> None:
    active.deploy(LINK.format(1.0))
    assert DeployedVersions(config.state).folder.stat().st_mode & 0o007 == 0


def test_a_longer_first_link_moves_the_tip_by_as_much(config: Config) -> None:
    arm = config.arm
    longer = replace(arm, joints=(replace(arm.joints[0], d=arm.joints[0].d + 0.03), *arm.joints[1:]))
    moved = tip_movement(model_of(arm, ()), model_of(longer, ()), arm)
    assert (moved.largest, moved.rms) == pytest.approx((0.03, 0.03), abs=1e-9)
    assert tip_movement(model_of(arm, ()), model_of(arm, ()), arm) == TipMovement(0.0, 0.0)


def test_a_large_movement_is_asked_for_and_a_larger_one_than_the_reach_refused(config: Config) -> None:
    length = reach(config.arm)
    check_movement(TipMovement(LARGE * length, 0.0), config.arm, accept=False)
    with pytest.raises(RequestError, match="has to be accepted") as refused:
        check_movement(TipMovement(1.01 * LARGE * length, 0.01), config.arm, accept=False)
    assert refused.value.code == "needs_accept"
    assert refused.value.detail["tip_moves_rms_m"] == 0.01
    check_movement(TipMovement(0.99 * length, 0.0), config.arm, accept=True)
    with pytest.raises(LrmError, match="no model of this arm: the tip moves by up to"):
        check_movement(TipMovement(1.01 * length, 0.0), config.arm, accept=True)


@pytest.mark.long
def test_a_deployment_says_how_far_the_tip_moves(active: ActiveModel) -> None:
    moved = active.deploy(LINK.format(200.0), accept=True).moved
    assert moved.largest == pytest.approx(0.2, abs=2e-3)
    assert np.isclose(active.deploy(LINK.format(210.0)).moved.largest, 0.01, atol=1e-4)
