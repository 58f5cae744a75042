"""A model of motion deployed to a running daemon: the next move is shaped and predicted by it, and nothing moves."""

from __future__ import annotations

from pathlib import Path

import pytest

from lrmd.cli import app
from lrmd.client import RequestRefused
from tests.support.daemon.daemon_harness import arm_when_ready
from tests.support.daemon.daemon_process import SLOW_BOARD, BoardProcess, DaemonProcess, DaemonSetup, wait_for
from tests.support.motion_models import motion_text, swinging

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
            assert rover.settle_s is not None
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
