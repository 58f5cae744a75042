"""`lrm-ident measure --robot lerobot:…`: LeRobot's follower over the simulated bus, with a tracker beside it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("lerobot", reason="LeRobot is not installed (it needs torch; Python 3.12 from 0.5 on)")
pytest.importorskip("scservo_sdk", reason="feetech-servo-sdk is not installed")

from examples.so101.hidden_arm import ARM_FILE, JOINTS, hidden_truth, tip_after
from examples.so101.launch import simulated_so101, simulated_tracker
from lrm_ident.data.measurement_file.load import load_poses
from lrm_math.arm.arm_file import load_arm
from validation.lerobot_robot.simulated_follower import MOTORS, ROBOT_ID
from validation.synthetic import load_arm as described_arm

PATIENT_COMMAND = """
import sys
import lerobot.motors.feetech.feetech as feetech
from lrm_ident.__main__ import main
def set_timeout(port, length):  # 50 ms, LeRobot's own, are too short for simulated servos on a busy machine
    port.packet_start_time, port.packet_timeout = port.getCurrentTime(), 5000.0
feetech.patch_setPacketTimeout = set_timeout
sys.exit(main())
"""
POSES_DEG = ((0, 0, 0, 0, 0), (15, -10, 12, 5, -8), (-12, 8, -15, 10, 20), (6, 14, -6, -12, 4))


def calibration(folder: Path, names: tuple[str, ...] = MOTORS) -> None:
    swept = {
        name: {"id": number, "drive_mode": 0, "homing_offset": 0, "range_min": 0, "range_max": 4095}
        for number, name in enumerate(names, start=1)
    }
    (folder / f"{ROBOT_ID}.json").write_text(json.dumps(swept))


def measured(folder: Path, link: Path, *more: str) -> subprocess.CompletedProcess[str]:
    robot = f"lerobot:so101_follower,port={link},id={ROBOT_ID},calibration_dir={folder}"
    words = ["measure", str(folder / "poses.csv"), "--robot", robot, "--pause", "0"]
    words += ["--settle", "0.2", "--dwell", "0.3", "-o", str(folder / "data.csv"), *more]
    with simulated_tracker(link, 1) as tracker:
        words += ["--tracker", tracker]
        return subprocess.run(
            [sys.executable, "-c", PATIENT_COMMAND, *words], capture_output=True, text=True, timeout=300
        )


def poses_file(folder: Path) -> None:
    lines = [",".join(map(str, (number, *q))) for number, q in enumerate(POSES_DEG, start=1)]
    (folder / "poses.csv").write_text("pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg\n" + "\n".join(lines) + "\n")


def test_poses_are_driven_to_and_measured(tmp_path: Path) -> None:
    poses_file(tmp_path)
    calibration(tmp_path)
    with simulated_so101(tmp_path, "gain", 1) as link:
        done = measured(tmp_path, link)
    assert done.returncode == 0, done.stderr + done.stdout
    assert "4 of 4 poses are in" in done.stdout
    data = load_poses(tmp_path / "data.csv", load_arm("so101"))
    np.testing.assert_allclose(np.degrees(data.q), POSES_DEG, atol=1e-4)
    table = np.genfromtxt(tmp_path / "data.csv", delimiter=",", names=True)
    tips = 1e-3 * np.stack([table[f"{axis}_mm"] for axis in "xyz"], axis=1)
    arm = described_arm(ARM_FILE)
    for q, tip in zip(np.radians(POSES_DEG), tips, strict=True):
        true = tip_after(arm, hidden_truth(arm, "gain", 1), np.array([np.zeros(JOINTS), q]))
        assert np.linalg.norm(tip - true) < 2e-3  # the tracker's noise, and servos that round to counts


def test_a_bus_without_servos_and_other_calibrations_are_one_line(tmp_path: Path) -> None:
    poses_file(tmp_path)
    calibration(tmp_path)
    missing = measured(tmp_path, tmp_path / "nothing")
    assert missing.returncode == 2
    assert missing.stderr.strip().splitlines()[-1].startswith("error: --robot lerobot:so101_follower")
    with simulated_so101(tmp_path, "gain", 1) as link:
        (tmp_path / f"{ROBOT_ID}.json").write_text((tmp_path / f"{ROBOT_ID}.json").read_text().replace("4095", "4000"))
        done = measured(tmp_path, link)
    assert done.returncode == 2
    assert "not calibrated as its file says" in done.stderr
