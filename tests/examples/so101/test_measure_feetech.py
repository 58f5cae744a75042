"""`lrm-ident measure` and `verify` with bare servos: the simulated bus at a pty, a tracker beside it."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from serial import Serial

from examples.so101.hidden_arm import ARM_FILE, JOINTS, hidden_truth, tip_after
from examples.so101.launch import simulated_so101, simulated_tracker
from lrm_ident.data.measurement_file.conventions import metadata_of
from lrm_ident.data.measurement_file.load import load_poses
from lrm_ident.measuring.servo_bus.bus import ServoHost
from lrm_ident.measuring.servo_bus.dynamixel import DYNAMIXEL
from lrm_ident.measuring.servo_bus.feetech import FEETECH
from lrm_ident.measuring.servo_bus.servos import STEP
from lrm_math.arm.arm_file import load_arm
from lrmd.sim.control_socket import query_board
from tests.support.commands import run_command, stderr_of
from tests.support.daemon.daemon_process import wait_for
from tests.support.sweep import soak
from validation.lerobot_robot.fitted_model import fit_hidden
from validation.synthetic import load_arm as described_arm

pytestmark = pytest.mark.long

POSES_DEG = ((0, 0, 0, 0, 0), (15, -10, 12, 5, -8), (-12, 8, -15, 10, 20), (6, 14, -6, -12, 4))
QUICK = ("--pause", "0", "--settle", "0.1", "--dwell", "0.2", "--speed", "120")


def poses_file(folder: Path, count: int = len(POSES_DEG)) -> Path:
    lines = [",".join(map(str, (number, *q))) for number, q in enumerate(POSES_DEG[:count], start=1)]
    path = folder / "poses.csv"
    path.write_text("pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg\n" + "\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("kind", ["feetech", "dynamixel"])
def test_poses_are_measured_and_an_interrupted_file_goes_on(tmp_path: Path, kind: str) -> None:
    poses, data = poses_file(tmp_path), tmp_path / "data.csv"
    with simulated_so101(tmp_path, "gain", 1, kind) as link, simulated_tracker(link, 1) as tracker:
        words = ["measure", poses, "--robot", f"{kind}:{link}", "--tracker", tracker, *QUICK, "-o", data]
        code, said, complaint = run_command(*words)
        assert (code, complaint) == (0, "")
        assert "4 of 4 poses are in" in said
        kept = data.read_text().splitlines()[:3]
        data.write_text("\n".join(kept) + "\n3,1.0")  # as a crash in the middle of a line leaves it
        code, said, complaint = run_command(*words)
        assert (code, complaint) == (0, "")
    assert data.read_text().splitlines()[:3] == kept
    stated = metadata_of(data)
    assert stated.approach_deg == pytest.approx(3.0)  # friction with a memory is fitted along this way
    q = load_poses(data, load_arm("so101")).q
    assert np.abs(q - np.radians(POSES_DEG)).max() <= 0.5 * STEP + 1e-7
    np.testing.assert_allclose(q / STEP, np.round(q / STEP), atol=1e-4)  # what the servos were sent
    table = np.genfromtxt(data, delimiter=",", names=True)
    tips = 1e-3 * np.stack([table[f"{axis}_mm"] for axis in "xyz"], axis=1)
    arm = described_arm(ARM_FILE)
    true = [
        tip_after(arm, hidden_truth(arm, "gain", 1), np.array([np.zeros(JOINTS), one])) for one in q
    ]  # this effect does not remember where the arm was
    assert np.linalg.norm(tips - true, axis=1).max() < 1.5e-3  # five sd of the tracker's noise


@pytest.mark.parametrize(
    ("robot", "words"),
    [
        ("dynamixel:{link},ids=1-4", "should be one id for each of the 5 joints"),
        ("dynamixel:{link}", "cannot be opened"),
        ("feetech:{link},ids=1-4", "should be one id for each of the 5 joints"),
        ("feetech:{link},ids=1+2+3+4+4", "should be one id for each of the 5 joints"),
        ("feetech:{link},id=1-5", "'id=1-5'; should be ids=1-5"),
        ("feetech:{link}", "cannot be opened"),
    ],
)
def test_words_that_name_no_bus_are_one_line(tmp_path: Path, robot: str, words: str) -> None:
    given = robot.format(link=tmp_path / "nothing")
    (tmp_path / "seen.csv").write_text("t_s,x_mm,y_mm,z_mm\n")
    tracker = f"csv:{tmp_path / 'seen.csv'}"
    said = stderr_of("measure", poses_file(tmp_path), "--robot", given, "--tracker", tracker, "-o", tmp_path / "d.csv")
    assert words in said
    assert said.count("\n") == 1


@pytest.mark.parametrize("kind", ["dynamixel", *soak("feetech")])
def test_a_wrong_number_on_a_real_line_is_one_line(tmp_path: Path, kind: str) -> None:
    poses = poses_file(tmp_path)
    with simulated_so101(tmp_path, "gain", 1, kind) as link, simulated_tracker(link, 1) as tracker:
        robot = f"{kind}:{link},ids=1+2+3+4+9"
        said = stderr_of("measure", poses, "--robot", robot, "--tracker", tracker, "-o", tmp_path / "d.csv")
    assert said.endswith("servo 9 does not answer; on the bus are 1, 2, 3, 4, 5, 6\n")
    assert said.count("\n") == 1


@pytest.mark.parametrize("kind", ["feetech", *soak("dynamixel")])
def test_the_tip_lands_nearer_with_the_model_of_this_arm(tmp_path: Path, kind: str) -> None:
    model = fit_hidden(hidden_truth(described_arm(ARM_FILE), "gain", 1), "gain", 1, tmp_path)
    found = {}
    with simulated_so101(tmp_path, "gain", 1, kind) as link, simulated_tracker(link, 1) as tracker:
        words = ["verify", "--robot", f"{kind}:{link}", "--tracker", tracker, *QUICK[2:], "--goals", "3"]
        for name, more in {"drawn": [], "fitted": ["--model", model]}.items():
            code, _, complaint = run_command(*words, *more, "--json", tmp_path / f"{name}.json")
            assert (code, complaint) == (0, "")
            found[name] = json.loads((tmp_path / f"{name}.json").read_text())
    assert [found[name]["model"] for name in ("drawn", "fitted")] == ["nominal", str(model)]
    assert len(found["fitted"]["goals"]) == 3
    assert found["fitted"]["error"]["rms_mm"] < 0.2 * found["drawn"]["error"]["rms_mm"]
    assert 0.0 < found["fitted"]["rounding_rms_mm"] < 0.5  # half a count of each joint


def test_a_release_of_other_robots_is_one_line(tmp_path: Path) -> None:
    words = ["--robot", "lerobot:so101_follower", "--tracker", "dtrack:45991", "-o", tmp_path / "d.csv", "--release"]
    said = stderr_of("measure", poses_file(tmp_path), *words)
    assert said == "error: --release: it goes with feetech: and dynamixel:\n"


def test_a_model_for_a_daemon_and_one_of_another_arm_are_one_line(tmp_path: Path) -> None:
    assert "a daemon uses its own model" in stderr_of("verify", "--tracker", "dtrack:45991", "--model", "m.toml")
    model = tmp_path / "other.toml"
    model.write_text('schema = "lrm/model/1"\narm = "ur5"\neffects = []\n')
    with simulated_so101(tmp_path, "gain", 1) as link, simulated_tracker(link, 1) as tracker:
        said = stderr_of("verify", "--robot", f"feetech:{link}", "--tracker", tracker, "--model", model)
    assert "a model of ur5" in said


RELEASES = [
    ("feetech", signal.SIGINT, ["--release"], "release\n", False),  # Ctrl-C holds, whatever else was said
    ("feetech", signal.SIGQUIT, [], "no\n", False),
    ("dynamixel", signal.SIGQUIT, [], "release\n", True),
]
RARER = [
    ("dynamixel", signal.SIGQUIT, [], "", False),
    ("feetech", signal.SIGQUIT, ["--release"], "", True),
]
OTHER_BUS = {"feetech": "dynamixel", "dynamixel": "feetech"}


@pytest.mark.parametrize(
    ("kind", "number", "options", "answer", "released"),
    [*RELEASES, *soak(*RARER, *((OTHER_BUS[kind], *rest) for kind, *rest in [*RELEASES, *RARER]))],
)
def test_torque_is_released_only_when_the_person_said_so(
    tmp_path: Path, kind: str, number: signal.Signals, options: list[str], answer: str, released: bool
) -> None:
    with simulated_so101(tmp_path, "gain", 1, kind) as link, simulated_tracker(link, 1) as tracker:
        words = ["measure", poses_file(tmp_path), "--robot", f"{kind}:{link}", "--tracker", tracker, "--pause", "60"]
        command = [sys.executable, "-m", "lrm_ident", *map(str, [*words, "-o", tmp_path / "data.csv", *options])]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as measuring:
            wait_for(lambda: int(str(query_board(link, "joints")["goals"])) > 0, "the arm is driven", 60.0)
            measuring.send_signal(number)
            said, _ = measuring.communicate(answer, timeout=60)
        assert measuring.returncode == 1
        assert ("its torque is released" if released else "the arm holds. What is measured") in said
        with Serial(str(link), timeout=0.02) as line:
            host = ServoHost(line, {"feetech": FEETECH, "dynamixel": DYNAMIXEL}[kind])
            torque = host.read_all(range(1, 6), host.kind.torque)
    assert set(torque.values()) == {int(not released)}
