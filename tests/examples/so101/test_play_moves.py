"""`lrm-ident motion play` with bare servos, the simulated bus at a pty: it records what it plays, or moves nothing."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from examples.so101.launch import simulated_so101
from lrm_ident.measuring.recordings.command_log import read_command_log
from lrm_math.arm.arm_file import load_arm
from lrm_math.model.reading import AS_NAMED
from lrmd.sim.control_socket import query_board
from tests.support.commands import run_command, stderr_of
from tests.support.daemon.daemon_process import wait_for
from tests.support.sweep import soak

pytestmark = pytest.mark.long

FRAME_S = 1.0 / 30.0


def moves(t: np.ndarray, q: np.ndarray) -> str:
    """MOVES.csv of one joint, q3, at angles (deg)."""
    rows = [f"{s:.5f},0,0,{turn:.4f},0,0" for s, turn in zip(t.tolist(), q.tolist(), strict=True)]
    return "\n".join(["t_s,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg", *rows]) + "\n"


def angles(link: Path) -> np.ndarray:
    """(5,), rad, of the simulated shafts."""
    return np.array(query_board(link, "joints")["q_rad"])


T = 100.0 + FRAME_S * np.arange(91)
"""s: a log need not begin at 0."""
GOOD = moves(T, np.interp(T - 100.0, [0.0, 0.3, 1.3, 1.8, 2.8], [5.0, 5.0, 20.0, 20.0, 5.0]))
BAD = {
    "the moves begin at 40.0 deg; bring it within 30 deg first; torque is on": moves(T, np.full(91, 40.0)),
    "--speed allows 30 deg/s": moves(T, np.interp(T - 100.0, [0.0, 0.3], [5.0, 45.0])),
    "q3_deg": moves(T, 5.0 + 4.0 * (T - 100.0) ** 4),
    "q5_deg": "\n".join(line.rpartition(",")[0] for line in GOOD.splitlines()) + "\n",
    "nan": GOOD.replace("20.0000", "nan", 1),
    "missing column q3_deg": GOOD.replace("q3_deg", "elbow"),
}


@pytest.mark.parametrize("kind", ["feetech", *soak("dynamixel")])
def test_it_says_what_it_does_and_records_it(tmp_path: Path, kind: str) -> None:
    path, recording = tmp_path / "moves.csv", tmp_path / "recording.csv"
    path.write_text(GOOD)
    with simulated_so101(tmp_path, "gain", 1, kind) as link:
        code, said, complaint = run_command("motion", "play", path, "--robot", f"{kind}:{link}", "-o", recording)
    assert (code, complaint) == (0, "")
    assert "It moves now: to the first pose, elbow_flex by " in said
    assert "then 3 s of moves: elbow_flex 5 to 20 deg at up to 15 deg/s. Ctrl-C holds." in " ".join(said.split())
    table = np.genfromtxt(recording, delimiter=",", names=True)
    assert len(table) == len(T)
    assert table["q3_deg"] == pytest.approx(np.interp(T - 100.0, [0, 0.3, 1.3, 1.8, 2.8], [5, 5, 20, 20, 5]), abs=0.1)
    assert np.ptp(table["q3_meas_deg"]) > 12.0
    log = read_command_log(recording, load_arm("so101"), AS_NAMED)
    assert set(log.servos) == {joint.name for joint in log.arm.joints}
    assert kind != "feetech" or log.servos["elbow_flex"].p, "a motion model holds for these gains"


def test_what_it_refuses_is_one_line_and_moves_nothing(tmp_path: Path) -> None:
    with simulated_so101(tmp_path, "gain", 1) as link:
        begin = angles(link)
        for number, (words, text) in enumerate(BAD.items()):
            (path := tmp_path / f"moves{number}.csv").write_text(text)
            said = stderr_of("motion", "play", path, "--robot", f"feetech:{link}", "-o", tmp_path / "recording.csv")
            assert words in said
            assert said.count("\n") == 1
        assert angles(link) == pytest.approx(begin, abs=np.radians(0.5))
    assert not (tmp_path / "recording.csv").exists()


def test_interrupted_it_holds_and_keeps_what_it_played(tmp_path: Path) -> None:
    path, recording = tmp_path / "moves.csv", tmp_path / "recording.csv"
    path.write_text(moves(FRAME_S * np.arange(900), np.linspace(5.0, 80.0, 900)))
    with simulated_so101(tmp_path, "gain", 1) as link:
        words = ["motion", "play", str(path), "--robot", f"feetech:{link}", "-o", str(recording)]
        with subprocess.Popen([sys.executable, "-m", "lrm_ident", *words], stdout=subprocess.PIPE, text=True) as player:
            wait_for(lambda: angles(link)[2] > np.radians(15.0), "it moves", 60.0)
            player.send_signal(signal.SIGINT)
            said, _ = player.communicate(timeout=60)
        time.sleep(0.5)
        stands = np.degrees(angles(link)[2])
    assert player.returncode == 1, said
    assert "stopped; the arm holds. What was played is kept" in said
    last = np.genfromtxt(recording, delimiter=",", names=True)["q3_deg"][-1]
    assert 15.0 / 1.036 < last < 40.0, "the servo of joint 3 turns further than commanded: by its gain, 3.6 % at most"
    assert stands == pytest.approx(last, abs=3.0)
