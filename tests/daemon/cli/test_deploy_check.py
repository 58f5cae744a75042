"""Before a model goes to the daemon: its last step alone goes along, and what the daemon leaves out is weighed."""

from __future__ import annotations

import argparse
import re
import tomllib
from dataclasses import replace
from pathlib import Path
from unittest import mock

import pytest

from lrm_math.errors import FileError, LrmError
from lrm_math.model.model_file import ModelFile, load_model
from lrm_math.toml_file import read_toml
from lrmd.cli import app
from lrmd.cli.status import deploy
from lrmd.client import RequestRefused, Rover
from lrmd.client.deployment import Deployment, left_out_differences
from lrmd.client.model_text import text_to_deploy
from lrmd.config import load_config
from lrmd.messages.codec import ErrorReply
from tests.conftest import ROOT
from tests.support.daemon.in_memory_daemon import CONFIG, SimulatedDaemon
from tests.support.daemon.in_memory_zenoh import InMemoryDaemon

MODEL = (ROOT / "tests" / "models" / "thesis-table-b2-option-1.toml").read_text(encoding="utf-8")
KEY = "compliance.joint2.k_rad_per_Nm"
COVARIANCE = f"""
[covariance]
keys = ["{KEY}"]
correlation = []
[sigma]
"{KEY}" = 0.01
"""
STEP = """
[[history]]
step = "fit"
fit_rms_mm = 1.0
held_out_rms_mm = 1.25
deployed_rms_mm = 1.5
effects = ["offsets", "compliance"]
{long}
[history.parameters]
"offsets.base.x_mm" = 1.0
[history.range]
joints_deg = [
[-90.0, 90.0],
]
payload_g = [0.0, 0.0]
[history.course]
folds = 10
[history.course.chosen_in_folds]
"backlash@joint2" = 9
"""
LAST = """
[provenance]
data = "data.csv"
data_sha256 = "0"
poses = 50
tool = "lrm-ident"
date = "2026-01-01"
"""
DRIFTING = MODEL.replace('"compliance"]', '"compliance", "drift@joint2"]').replace(
    "[parameters]\n", '[parameters]\n"drift.joint2.A_rad" = {drift}\n'
)
STATE = '\n[deployed]\ncarried = { "drift@joint2" = "last" }\noffsets = { "offsets.joint2.theta_rad" = 0.01 }\n'


def written(folder: Path, text: str) -> Path:
    path = folder / "model.toml"
    path.write_text(text, "utf-8")
    return path


def test_of_the_history_the_errors_of_the_last_step_go_along(tmp_path: Path) -> None:
    """Whatever stands before and behind it; arrays whose lines look like the begin of a table are no end of it."""
    path = written(tmp_path, MODEL + STEP.format(long="") + STEP.format(long="# one more") + LAST)
    tables, sent = tomllib.loads(path.read_text("utf-8")), text_to_deploy(path)
    last = {
        name: value
        for name, value in tables["history"][-1].items()
        if not isinstance(value, dict) or name == "parameters"
    }
    assert tomllib.loads(sent) == {**tables, "history": [last]}
    assert sent.startswith(MODEL)
    assert "course" not in sent, "an older daemon has no such key"
    residual = read_toml(path, ModelFile).residual
    assert read_toml(written(tmp_path, sent), ModelFile).residual == residual > 0.0, "verify predicts with it"


def test_a_long_history_is_no_hindrance(tmp_path: Path) -> None:
    path = written(tmp_path, MODEL + "".join(STEP.format(long="#" * 50_000) for _ in range(30)))
    assert path.stat().st_size > 1_000_000
    assert len(text_to_deploy(path)) < 100_000


def test_a_model_without_effects_of_a_session_is_deployed_as_it_is(tmp_path: Path) -> None:
    checked = Deployment.of_file(written(tmp_path, MODEL + COVARIANCE + STEP.format(long="")))
    checked.check()
    (line,) = checked.lines()
    known, alone = "1.50 mm RMS as deployed, at poses not in the fit", r"\d\.\d\d mm RMS by uncertain parameters alone"
    assert re.fullmatch(rf"expected at the tip: {re.escape(known)}, {alone}", line)


def test_the_interval_of_the_error_is_said_where_the_file_has_it(tmp_path: Path) -> None:
    known = STEP.format(long="deployed_95_mm = [1.31, 1.72]")
    (line,) = Deployment.of_file(written(tmp_path, MODEL + COVARIANCE + known)).lines()
    assert "at poses not in the fit, 1.31 to 1.72 mm (95 %) while the arm stays as it is, " in line


def test_what_is_left_out_is_weighed_by_the_standard_error(tmp_path: Path) -> None:
    slight, strong = (
        Deployment.of_file(written(tmp_path, DRIFTING.format(drift=drift) + COVARIANCE + STATE.replace("0.01", offset)))
        for drift, offset in ((1e-6, "1e-6"), (0.05, "0.03"))
    )
    slight.check()
    with pytest.raises(LrmError, match=r"otherwise by \d+\.\d\d mm RMS, more than its standard error .*--accept$"):
        strong.check()
    assert "The deployed model keeps the last state of drift@joint2." in [*strong.lines()]
    unknown = replace(strong, standard_error=None)
    with pytest.raises(LrmError, match="which is not known"):
        unknown.check()


def test_a_drift_that_follows_the_time_is_not_left_out(tmp_path: Path) -> None:
    """Its size where that time is not known is printed, and refuses nothing."""
    span = "\n[range]\njoints_deg = [[-60, 60], [-60, 60], [-60, 60], [-60, 60], [-60, 60], [-60, 60]]\n"
    known = span + "payload_g = [0, 60]\nt_s = [0, 7200]\nrunning_s = [0, 7200]\n"
    state = STATE.replace("0.01 }", '0.03 }\nwarming_rad = { "drift@joint2" = 0.03 }')
    checked = Deployment.of_file(written(tmp_path, DRIFTING.format(drift=0.05) + COVARIANCE + state + known))
    checked.check()
    lines = "\n".join(checked.lines())
    assert "left out of the model" not in lines
    assert re.search(r"where nothing is known of before: \d+\.\d\d mm RMS over its session", lines)
    assert "Where the time since power-on is known, drift@joint2 follows it." in lines


def test_a_file_whose_drift_is_not_there_follows_nothing(tmp_path: Path) -> None:
    state = STATE.replace("0.01 }", '0.01 }\nwarming_rad = { "drift@base" = 0.01 }')
    with pytest.raises(FileError, match=r"joint's drift.*drift@base"):
        Deployment.of_file(written(tmp_path, DRIFTING.format(drift=0.05) + COVARIANCE + state))


def test_the_command_asks_before_it_connects(tmp_path: Path) -> None:
    path = written(tmp_path, DRIFTING.format(drift=0.05) + COVARIANCE + STATE)
    options = argparse.Namespace(model=path, undo=False, accept=False, robot="nobody", connect=None, zenoh_config=None)
    with pytest.raises(LrmError, match="--accept"):
        deploy(options)


def test_an_old_file_with_effects_of_a_session_says_how_it_is_made_right(tmp_path: Path) -> None:
    path = written(tmp_path, DRIFTING.format(drift=0.01))
    with pytest.raises(FileError, match=r"drift@joint2 explain.* which state of it goes along; .*fit it again"):
        Deployment.of_file(path)


def test_a_state_that_is_the_whole_session_leaves_nothing_out(tmp_path: Path) -> None:
    """A drift of nothing, and no effect of a session at all, differ from their deployment by nothing."""
    assert left_out_differences(load_model(written(tmp_path, MODEL))) == (0.0, 0.0)
    assert left_out_differences(load_model(written(tmp_path, DRIFTING.format(drift=0.0)))) == (0.0, 0.0)


def test_a_size_that_no_real_arm_has_is_refused(tmp_path: Path) -> None:
    """A gear of 30 degrees: one line with the usual range, and a way for who knows better."""
    text = MODEL.replace('"compliance"]', '"compliance", "eccentricity@joint2"]')
    text = text.replace("[parameters]\n", '[parameters]\n"eccentricity.joint2.a1_rad" = 0.52\n')
    checked = Deployment.of_file(written(tmp_path, text + COVARIANCE))
    with pytest.raises(LrmError, match=r"a1_rad = 29\.8 deg .* usual is less than 3 deg; .*--accept$"):
        checked.check()
    assert any("not physically plausible" in line for line in checked.lines())


def test_a_model_that_the_daemon_refuses_is_named_as_the_file_of_the_person(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Before: the line named a file in the state directory of the daemon, which was gone by then."""
    path = written(tmp_path, MODEL)
    refused = RequestRefused(ErrorReply(code="model", msg="arm: a model of so101"))
    daemon = InMemoryDaemon(SimulatedDaemon(load_config(CONFIG)))
    with daemon.reachable(), mock.patch.object(Rover, "deploy", side_effect=refused):
        assert app.main(["deploy", str(path), "--accept"]) == 2
    assert capsys.readouterr().err == f"lrm: {path}: arm: a model of so101\n"
