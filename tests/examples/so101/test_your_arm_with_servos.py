"""docs/your-arm.md: its commands that drive bare servos, in order, on the simulated bus with a tracker beside it."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import numpy as np
import pytest
import tomli_w

from examples.so101.hidden_arm import ARM_FILE, hidden_truth
from examples.so101.launch import simulated_camera, simulated_so101, simulated_tracker
from lrm_ident.data.measurement_file.number_table import numbers_of, read_csv
from tests.conftest import ROOT
from tests.support.commands import run_command
from tests.support.page_commands import lines_of
from validation.lerobot_robot.fitted_model import fit_hidden
from validation.synthetic import load_arm

POSES, GOALS = 4, 2
QUICK = ("--settle", "0.1", "--dwell", "0.2", "--speed", "120")


def commands_of(page: Path) -> list[str]:
    """Those that drive bare servos."""
    return [line for line in lines_of(page) if "feetech:" in line or line.startswith("design so101")]


@pytest.mark.slow
def test_every_command_with_servos_runs_as_it_stands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Fewer poses and goals, and faster; the model is fitted to poses of the same arm that are not driven to."""
    monkeypatch.chdir(tmp_path)
    fit_hidden(hidden_truth(load_arm(ARM_FILE), "gain", 1), "gain", 1, tmp_path).rename("best.toml")
    commands = [line for line in commands_of(ROOT / "docs" / "your-arm.md") if not line.startswith("camera")]
    assert [command.split()[0] for command in commands] == ["design", "measure", "verify", "verify"]
    with simulated_so101(tmp_path, "gain", 1) as link, simulated_tracker(link, 1) as tracker:
        for command in commands:
            line = command.replace("/dev/ttyACM0", str(link)).replace("dtrack:5000", tracker)
            words = shlex.split(line.replace("--goals 10", f"--goals {GOALS}"))
            words += [] if words[0] == "design" else QUICK
            words += ["--pause", "0"] if words[0] == "measure" else []
            words += ["--json", "after.json"] if "--before" in words else []
            code, _, complaint = run_command(*words)
            assert (code, complaint) == (0, ""), line
            if words[0] == "design":
                rows = Path("poses.csv").read_text().splitlines()
                assert len(rows) > 60
                Path("poses.csv").write_text("\n".join(rows[: POSES + 1]) + "\n")
    assert len(Path("data.csv").read_text().splitlines()) == POSES + 1
    before, after = (json.loads(Path(name).read_text())["error"]["rms_mm"] for name in ("before.json", "after.json"))
    assert after < 0.3 * before


@pytest.mark.soak
@pytest.mark.slow
def test_the_camera_takes_its_photos_by_itself(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Takes ten poses, and a lens that is known."""
    pytest.importorskip("cv2", reason="OpenCV is not installed (extra 'camera')")
    from examples.so101.camera import poses_for_photos
    from examples.so101.demo import table
    from tests.ident.measuring.camera.test_camera import LENS

    monkeypatch.chdir(tmp_path)
    Path("lens.toml").write_text(tomli_w.dumps(LENS.model_dump(by_alias=True)))
    Path("poses.csv").write_text(table("q{}_deg", np.degrees(poses_for_photos(10, 1))))
    (command,) = [line for line in commands_of(ROOT / "docs" / "your-arm.md") if line.startswith("camera")]
    with simulated_so101(tmp_path, "gain", 1) as link, simulated_camera(link) as camera:
        line = command.replace("/dev/ttyACM0", str(link)).replace("read 0", f"read {camera}")
        code, said, complaint = run_command(*shlex.split(line), "--settle", "0.1", "--speed", "120")
    assert (code, "10 of 10 photos used" in said) == (0, True), complaint
    driven = numbers_of(read_csv(Path("data.photos", "poses.csv"), ["q1_deg"]), "q1_deg")
    step = 360.0 / 4096.0
    np.testing.assert_allclose(driven / step, np.round(driven / step), atol=1e-3)
