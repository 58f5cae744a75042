"""Models of motion that are deployed: checked as those of poses are, kept apart from them, and taken back."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from lrm_math.errors import FileError, LrmError
from lrmd.api.deployed_motion import ActiveMotionModel, check_comes_to_rest, predictor_of
from lrmd.api.model_reload import ActiveModel
from lrmd.config import Config, load_config
from lrmd.errors import RequestError
from lrmd.main import main
from lrmd.persistence.deployed_models import DeployedVersions, ModelKind
from lrmd.ramp.shared_memory import SharedRecords
from tests.support.daemon.in_memory_daemon import CONFIG
from tests.support.motion_models import motion_text, swinging

pytestmark = pytest.mark.long

TEXT = motion_text(swinging(joint1=(3.0, 0.03), joint2=(4.0, 0.05)))
OTHER = motion_text(swinging(joint2=(5.0, 0.05)))
SWING = '"swing.joint1.frequency_Hz" = 3.0'
INERTIAL = '"inertial_coupling.joint2.k_rad_per_Nm" = 0.02\n"link_inertia.joint2.s_ratio" = 0.4'
WRONG = {
    "another arm": (TEXT.replace("lrm-rover", "lrm-lab"), "lrm-lab"),
    "no arm of the daemon's": (TEXT.replace("lrm-rover", "/etc/passwd"), "no arm of this daemon's"),
    "an arm that changed": (TEXT.replace("effects", 'arm_sha256 = "0"\neffects', 1), "links, tool or masses differ"),
    "a model of poses": ('schema = "lrm/model/2"\narm = "lrm-rover"\neffects = []\n', "lrm/motion/2"),
    "an older fit that counts inertia twice": (
        TEXT.replace("lrm/motion/2", "lrm/motion/1")
        .replace("effects = [", 'effects = ["inertial_coupling@joint2", "link_inertia@joint2", ')
        .replace("[parameters]", f"[parameters]\n{INERTIAL}"),
        "fit it again",
    ),
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
    for _ in range(20):
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
    again = ActiveMotionModel(config, ActiveModel(config, SharedRecords.create()))
    assert again.predictor.sha256 == active.predictor.sha256
    assert in_use(config) == Path(again.predictor.path).name
    again.undo()
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
    assert main(["--config", str(file), "--check"]) == 0
    assert f"motion model {path}" in capsys.readouterr().out
    path.write_text("half a fi", "utf-8")
    assert main(["--config", str(file), "--check"]) == 2
    assert "take it back: lrmd --config FILE --undo motion" in capsys.readouterr().err
    assert main(["--config", str(file), "--undo", "motion"]) == 0
    assert main(["--config", str(file), "--check"]) == 0
