"""Models of poses and of motion deployed over zenoh: checked, kept, used at once and after a restart, taken back."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path

import pytest

from lrmd.cli import app
from lrmd.client import GoalEntry, IkRequest, NoReply, RequestRefused, Rover
from tests.conftest import ROOT
from tests.support.daemon.daemon_harness import arm_when_ready
from tests.support.daemon.daemon_process import (
    SLOW_BOARD,
    BoardProcess,
    DaemonProcess,
    DaemonSetup,
    running_daemon,
    wait_for,
)
from tests.support.motion_models import motion_text, swinging

MODEL = (ROOT / "tests" / "models" / "thesis-table-b2-option-1.toml").read_text(encoding="utf-8")
OTHER = MODEL + "\n# another file of the same model\n"
FIELD = MODEL.replace('"compliance"]', '"compliance", "residual_field"]').replace(
    "[parameters]\n", '[parameters]\n"residual_field.tool.u000001_mm" = 0.4\n'
)
STATE = '\n[deployed]\ncarried = { "drift@joint2" = "last" }\n'
DRIFTING = MODEL.replace('"compliance"]', '"compliance", "drift@joint2"]') + STATE


def sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def answered_with(rover: Rover) -> str:
    """The hash of the model in a reply of the ik process; empty as long as there is none."""
    try:
        return rover.ik(IkRequest(goals=[GoalEntry(position_m=[0.25, 0.05, 0.3])])).model_sha256
    except (NoReply, RequestRefused):
        return "none"


@pytest.fixture(scope="module")
def daemon(
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[tuple[DaemonSetup, BoardProcess, DaemonProcess, Rover]]:
    setup = DaemonSetup.make(tmp_path_factory.mktemp("deploy"), SLOW_BOARD)
    with running_daemon(setup) as (board, process), setup.rover() as rover:
        wait_for(lambda: answered_with(rover) == "", "the nominal arm answers")
        yield setup, board, process, rover


Started = tuple[DaemonSetup, BoardProcess, DaemonProcess, Rover]


def test_deployed_undone_and_each_hash_in_every_reply(daemon: Started) -> None:
    _, _, _, rover = daemon
    for text in (MODEL, OTHER):
        reply = rover.deploy(text)
        assert reply.model_sha256 == sha256(text) == answered_with(rover) == rover.info().model_sha256
    assert rover.undeploy().model_sha256 == sha256(MODEL) == answered_with(rover)
    assert rover.undeploy().model_sha256 == "" == answered_with(rover)
    with pytest.raises(RequestRefused) as caught:
        rover.undeploy()
    assert caught.value.code == "nothing_to_undo"


def test_a_model_that_cannot_be_used_leaves_everything_as_it_was(daemon: Started) -> None:
    setup, _, _, rover = daemon
    rover.deploy(MODEL)
    files = sorted((setup.state / "models").iterdir())
    wrong = MODEL.replace('arm = "lrm-rover"', 'arm = "lrm-lab"'), "no model", MODEL.replace("offsets", "magic")
    for text in wrong:
        with pytest.raises(RequestRefused) as caught:
            rover.deploy(text)
        assert caught.value.code == "model"
        assert "\n" not in str(caught.value)
    assert sorted((setup.state / "models").iterdir()) == files
    assert answered_with(rover) == sha256(MODEL)
    rover.undeploy()


def test_unusable_effects_are_named(daemon: Started, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    setup, _, _, _ = daemon
    path = tmp_path / "model.toml"
    path.write_text(DRIFTING)
    assert app.main(["--connect", setup.endpoint, "deploy", str(path)]) == 0
    said = capsys.readouterr().out
    assert sha256(DRIFTING)[:12] in said
    assert "drift" in said.splitlines()[-1]
    assert "The deployed model keeps the last state of drift@joint2." in said.splitlines()
    assert any(line.startswith("expected at the tip: ") for line in said.splitlines())
    assert app.main(["--connect", setup.endpoint, "deploy", "--undo"]) == 0
    assert app.main(["--connect", setup.endpoint, "deploy"]) == 2
    assert app.main(["--connect", setup.endpoint, "deploy", str(tmp_path / "missing.toml")]) == 2


def test_a_field_is_said_to_be_no_cause(daemon: Started, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    setup, _, _, rover = daemon
    path = tmp_path / "field.toml"
    path.write_text(FIELD)
    assert app.main(["--connect", setup.endpoint, "deploy", str(path)]) == 0
    said = capsys.readouterr().out.splitlines()[-1]
    assert said.startswith("residual_field@tool (not a cause) is compensated")
    assert "where it speaks: not known (the file has no covariance)" in said
    assert rover.undeploy().field is None


def test_a_deployed_model_is_there_after_a_restart(tmp_path: Path) -> None:
    setup = DaemonSetup.make(tmp_path, SLOW_BOARD)
    with BoardProcess(setup):
        with DaemonProcess(setup) as first, first.ready(), setup.rover() as rover:
            rover.deploy(MODEL)
        with DaemonProcess(setup) as second, second.ready(), setup.rover() as rover:
            assert rover.info().model_sha256 == sha256(MODEL)
            wait_for(lambda: answered_with(rover) == sha256(MODEL), "the deployed model answers")
            assert rover.undeploy().model_sha256 == ""


TEXT = motion_text(swinging(joint1=(3.0, 0.03), joint2=(4.0, 0.05)))
HOME = {f"joint{i}": 0.0 for i in range(1, 7)}
SHAPED = {"\n[state]\n": '\n[motion]\nshaping = "zv"\n\n[state]\n'}


def test_deployed_used_kept_and_taken_back(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    setup = DaemonSetup.make(tmp_path, SLOW_BOARD | SHAPED)
    path = tmp_path / "motion.toml"
    path.write_text(TEXT, encoding="utf-8")
    with BoardProcess(setup) as board:
        with DaemonProcess(setup) as first, first.ready(), setup.rover() as rover, rover.control("test"):
            assert "no_motion_model" in [event.code for event in rover.events()]
            arm_when_ready(rover, "given", HOME)
            plain = rover.move({"joint1": 0.1})
            assert rover.settle_s is None
            with pytest.raises(RequestRefused, match="lrm deploy"):
                rover.move({"joint1": 0.2}, shaping="zv")
            before, mode = board.pulses(), rover.mode()
            assert app.main(["--connect", setup.endpoint, "deploy", str(path)]) == 0
            said = capsys.readouterr().out
            assert "moves are shaped from the next one on: zv" in said
            assert "joint1 3.00 Hz, joint2 4.00 Hz" in said
            assert board.pulses() == before, "nothing moved"
            assert (rover.mode().mode, rover.mode().stops) == (mode.mode, mode.stops)
            shaped = rover.move({"joint1": 0.2}, wait=False)
            assert shaped > plain + 0.05
            assert rover.settle_95_s >= rover.settle_s
            rover.deploy(TEXT + "\n", kind="motion")  # under way
            wait_for(lambda: not rover.joints().moving, "the motion ends")
            assert rover.mode().mode == "armed"
            assert rover.joints().q_rad[0] == pytest.approx(0.2, abs=1e-6)
            with pytest.raises(RequestRefused) as caught:
                rover.deploy(TEXT.replace("lrm-rover", "lrm-lab"), kind="motion")
            assert caught.value.code == "model"
            known = rover.info()
            assert known.model_sha256 == ""
        with DaemonProcess(setup) as second, second.ready(), setup.rover() as rover:
            assert rover.info().motion_sha256 == known.motion_sha256 != ""
            assert rover.info().motion_model == known.motion_model
            assert rover.undeploy("motion").motion_model is not None
            assert app.main(["--connect", setup.endpoint, "deploy", "--undo", "motion"]) == 0
            assert "no motion model" in capsys.readouterr().out
            with pytest.raises(RequestRefused) as caught:
                rover.undeploy("motion")
            assert caught.value.code == "nothing_to_undo"
