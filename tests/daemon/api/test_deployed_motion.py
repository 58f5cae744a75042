"""Deployments: models of motion, own arms, bounds, gravity, and the way back from a damaged one without a daemon."""

from __future__ import annotations

import json
import math
import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lrm_math.arm.arm_digest import arm_sha256
from lrm_math.arm.arm_file import load_arm
from lrm_math.errors import FileError, LrmError
from lrmd.api.deployed_motion import ActiveMotionModel, check_comes_to_rest, predictor_of
from lrmd.api.model_reload import ActiveModel
from lrmd.client.model_text import text_to_deploy
from lrmd.config import Config, load_config
from lrmd.errors import RequestError
from lrmd.ik.deployed_model import deploy_file
from lrmd.main import main
from lrmd.persistence.deployed_models import DeployedVersions, ModelKind
from lrmd.ramp.shared_memory import GravityRecord, SharedRecords
from lrmd.safety.collision_guard import CollisionGuard
from tests.conftest import ROOT, TABLE_B2
from tests.support.daemon.in_memory_daemon import CONFIG
from tests.support.motion_models import motion_text, swinging

pytestmark = pytest.mark.long


TEXT = motion_text(swinging(joint1=(3.0, 0.03), joint2=(4.0, 0.05)))
OTHER = motion_text(swinging(joint2=(5.0, 0.05)))
SWING = '"swing.joint1.frequency_Hz" = 3.0'
WRONG = {
    "another arm": (TEXT.replace("lrm-rover", "lrm-lab"), "lrm-lab"),
    "no arm of the daemon's": (TEXT.replace("lrm-rover", "/etc/passwd"), "no arm of this daemon's"),
    "an arm that changed": (TEXT.replace("effects", 'arm_sha256 = "0"\neffects', 1), "links, tool or masses differ"),
    "a model of poses": ('schema = "lrm/model/2"\narm = "lrm-rover"\neffects = []\n', "lrm/motion/1"),
    "no such effect": (TEXT.replace("swing@joint1", "swung@joint1"), "swung"),
    "an effect named twice": (TEXT.replace('"swing@joint1"', '"swing@joint1", "swing@joint1"'), "named twice"),
    "a joint without a servo": (TEXT.replace('"servo_response@joint3", ', ""), "servo_response@joint3 is missing"),
    "a value beyond its bounds": (TEXT.replace(SWING, '"swing.joint1.frequency_Hz" = 3000.0'), "3000"),
    "no value": (TEXT.replace(SWING, ""), "no value of swing.joint1.frequency_Hz"),
    "no number": (TEXT.replace(SWING, '"swing.joint1.frequency_Hz" = nan'), "swing.joint1.frequency_Hz"),
    "a standard error below zero": (f'{TEXT}[sigma]\n"swing.joint1.frequency_Hz" = -1.0\n', "below zero"),
    "too many effects": (TEXT.replace('"swing@joint1"', '"swing@joint1"' + ', "swing@joint1"' * 1200), "at most 1000"),
    "no TOML": ("effects = [", "not valid TOML"),
}


@pytest.fixture
def config(tmp_path: Path) -> Config:
    return replace(load_config(CONFIG), state=tmp_path / "state")


@pytest.fixture
def active(config: Config) -> ActiveMotionModel:
    return ActiveMotionModel(config, ActiveModel(config, SharedRecords.create()))


def deploy(motion: ActiveMotionModel, text: str) -> None:
    """Asks again where a busy machine had no time for the check."""
    for _ in range(5):
        try:
            return motion.deploy(text)
        except RequestError as error:
            if not error.retryable:
                raise
    raise AssertionError("never checked")


def in_use(config: Config) -> str | None:
    """The name of the file in use."""
    path = DeployedVersions.of(config, ModelKind.MOTION).in_use
    return None if path is None else path.name


def test_deployed_kept_after_a_restart_and_taken_back(config: Config, active: ActiveMotionModel) -> None:
    assert active.predictor is None
    for text in (TEXT, OTHER):
        deploy(active, text)
    assert active.predictor is not None
    again = ActiveMotionModel(config, ActiveModel(config, SharedRecords.create()))
    assert again.predictor is not None
    assert again.predictor.sha256 == active.predictor.sha256
    assert in_use(config) == Path(again.predictor.path).name
    again.undo()
    assert again.predictor is not None
    assert again.predictor.sha256 != active.predictor.sha256
    again.undo()
    assert again.predictor is None
    with pytest.raises(RequestError, match="no deployed model of motion"):
        again.undo()


@pytest.mark.parametrize("name", WRONG)
def test_a_file_that_is_no_model_of_this_arms_motion_is_refused_in_one_line(name: str, config: Config) -> None:
    """What the trial's process does, without the process."""
    text, said = WRONG[name]
    with pytest.raises(LrmError) as caught, DeployedVersions.of(config, ModelKind.MOTION).new(text) as path:
        check_comes_to_rest(config, path)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
    assert in_use(config) is None
    assert not list(DeployedVersions.of(config, ModelKind.MOTION).folder.glob("*.toml"))


def test_an_arm_that_swings_for_ever_is_refused(config: Config, tmp_path: Path) -> None:
    path = tmp_path / "motion.toml"
    path.write_text(motion_text(swinging(joint2=(2.0, 0.003))))
    with pytest.raises(FileError, match="30 s after a move the tip is not within"):
        check_comes_to_rest(config, path)
    path.write_text(TEXT)
    check_comes_to_rest(config, path)


def test_a_refused_text_leaves_the_model_in_use(config: Config, active: ActiveMotionModel) -> None:
    """Through the process that tries it."""
    deploy(active, TEXT)
    before = in_use(config), active.predictor
    with pytest.raises(LrmError, match="lrm-lab"):
        deploy(active, WRONG["another arm"][0])
    assert (in_use(config), active.predictor) == before


def test_models_of_poses_and_of_motion_are_kept_apart(config: Config) -> None:
    poses = ActiveModel(config, SharedRecords.create())
    moves = ActiveMotionModel(config, poses)
    deploy(moves, TEXT)
    poses.deploy('schema = "lrm/model/2"\narm = "lrm-rover"\neffects = []\n')
    moves.undo()
    assert poses.deployed.sha256
    poses.undo()
    with pytest.raises(RequestError, match="configuration"):
        poses.undo()


def test_the_file_of_the_configuration_is_used_while_none_is_deployed(config: Config, tmp_path: Path) -> None:
    path = tmp_path / "motion.toml"
    path.write_text(OTHER)
    named = replace(config, motion=config.motion.model_copy(update={"model": str(path)}))
    moves = ActiveMotionModel(named, ActiveModel(named, SharedRecords.create()))
    assert moves.predictor is not None
    assert moves.predictor.path == str(path)
    deploy(moves, TEXT)
    assert moves.predictor.path != str(path)
    moves.undo()
    assert moves.predictor.path == str(path)
    path.write_text(path.read_text().replace("lrm-rover", "lrm-lab"))
    with pytest.raises(FileError, match="lrm-lab"):
        predictor_of(named, path)


def test_a_damaged_file_stops_the_start_and_is_taken_back_without_a_daemon(
    tmp_path: Path, config: Config, active: ActiveMotionModel, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "lrmd.toml"
    file.write_text(CONFIG.read_text("utf-8").replace("/var/lib/lrmd", str(config.state)), "utf-8")
    deploy(active, TEXT)
    path = DeployedVersions.of(config, ModelKind.MOTION).in_use
    assert path is not None
    assert main(["--config", str(file), "--check"]) == 0
    assert f"motion model {path}" in capsys.readouterr().out
    path.write_text("half a fi", "utf-8")
    assert main(["--config", str(file), "--check"]) == 2
    assert "take it back: lrmd --config FILE --undo motion" in capsys.readouterr().err
    assert main(["--config", str(file), "--undo", "motion"]) == 0
    assert main(["--config", str(file), "--check"]) == 0


LINK = """\
schema = "lrm/model/1"
arm = "lrm-rover"
effects = ["offsets@joint1"]
[parameters]
"offsets.joint1.d_mm" = {}
"""
"""The first link longer by so much (mm): the whole arm is moved by as much, whatever its pose."""


@pytest.fixture
def active_model(config: Config) -> ActiveModel:
    return ActiveModel(config, SharedRecords.create())


def test_a_model_with_a_link_of_ten_metres_is_not_deployed(config: Config, active_model: ActiveModel) -> None:
    for accept in ((), (True,)):
        with pytest.raises(LrmError):
            active_model.deploy(LINK.format(10_000.0), *accept)
        assert not list(DeployedVersions(config.state).folder.glob("*.toml"))
    with pytest.raises(RequestError, match="accepted"):
        active_model.deploy(LINK.format(200.0))


def test_a_damaged_deployed_file_is_taken_back_without_a_daemon(
    tmp_path: Path, config: Config, active_model: ActiveModel, capsys: pytest.CaptureFixture[str]
) -> None:
    text = CONFIG.read_text(encoding="utf-8").replace("/var/lib/lrmd", str(config.state))
    file = tmp_path / "lrmd.toml"
    file.write_text(text, encoding="utf-8")
    for d in (1.0, 2.0):
        active_model.deploy(LINK.format(d))
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


def test_the_state_folder_is_not_for_everybody(config: Config, active_model: ActiveModel) -> None:
    active_model.deploy(LINK.format(1.0))
    assert DeployedVersions(config.state).folder.stat().st_mode & 0o007 == 0


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


DOWN = (math.sin(0.2), 0.0, -math.cos(0.2))


def test_the_guard_checks_the_arm_as_it_bends_there() -> None:
    shared = SharedRecords.create()
    active = ActiveModel(replace(load_config(CONFIG), model=TABLE_B2), shared)
    level, q = active.guard, np.random.default_rng(0).uniform(-1.0, 1.0, (20, 6))
    assert isinstance(level, CollisionGuard)
    assert shared.read_gravity() is None
    active.under_gravity(DOWN)
    tilted = active.guard
    assert isinstance(tilted, CollisionGuard)
    assert shared.read_gravity() == GravityRecord(True, *DOWN)
    assert active.gravity == pytest.approx([9.81 * x for x in DOWN])
    assert tilted.model is not None
    assert tilted.model.constant_gravity == pytest.approx([9.81 * x for x in DOWN])
    apart = tilted.separation(q, 0.1) - level.separation(q, 0.1)
    assert np.abs(apart).max() > 1e-4
    active.load()
    assert isinstance(active.guard, CollisionGuard)
    assert active.guard.model is not None
    assert active.guard.model.constant_gravity == tilted.model.constant_gravity
    active.under_gravity(None)
    assert shared.read_gravity() == GravityRecord()
    assert active.gravity == active.deployed.model.arm.gravity
