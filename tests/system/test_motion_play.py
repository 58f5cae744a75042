"""`lrm-ident motion play` on the real daemon and a simulated board: it goes along its moves, and any stop ends it."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from lrmd.client import Rover
from tests.support.commands import stderr_of
from tests.support.daemon.daemon_harness import arm_when_ready, wait_for_link
from tests.support.daemon.daemon_process import LONGEST_LEASE, SLOW_BOARD, DaemonSetup, running_daemon, wait_for

START = (0.0, -60.0, 0.0, 0.0, 0.0, 0.0)
FRAME_S = 1.0 / 30.0
HEAD = "t_s,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg"


def moves_csv(path: Path, *knots: tuple[float, float], joint: int = 0, start: tuple[float, ...] = START) -> Path:
    """Moves of one joint (from 0) through angles (deg, of the start) at times (s), the others at the start."""
    t = np.arange(0.0, knots[-1][0] + FRAME_S / 2, FRAME_S)
    turn = np.interp(t, [s for s, _ in knots], [by for _, by in knots])
    q = np.tile(start, (len(t), 1))
    q[:, joint] += turn
    rows = [",".join(f"{value:.5f}" for value in (s, *row)) for s, row in zip(t.tolist(), q.tolist(), strict=True)]
    path.write_text("\n".join([HEAD, *rows]) + "\n")
    return path


THERE_AND_BACK = ((0.0, 5.0), (0.3, 5.0), (1.0, 15.0), (1.5, 15.0), (2.0, 10.0), (3.2, 10.0), (4.0, 5.0), (4.5, 5.0))
LONG = ((0.0, 0.0), (0.3, 0.0), (3.3, 30.0), (7.0, 30.0), (15.0, 0.0))
RESTING = ((0.0, 0.0), (0.3, 0.0), (1.3, 10.0), (5.8, 10.0), (10.0, 0.0))


@pytest.fixture(scope="module")
def daemon(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[DaemonSetup, Rover]]:
    """A daemon with its board, and a client of it."""
    changes = {**SLOW_BOARD, **LONGEST_LEASE, "step_us = 1.0": "step_us = 10.0"}
    setup = DaemonSetup.make(tmp_path_factory.mktemp("daemon"), changes)
    with running_daemon(setup, "--start-deg", ",".join(f"{q:g}" for q in START)), setup.rover() as rover:
        wait_for_link(rover)
        yield setup, rover


@pytest.fixture
def armed(daemon: tuple[DaemonSetup, Rover]) -> tuple[DaemonSetup, Rover]:
    """The daemon; its arm stands at the start with pulses, and nobody has its lease."""
    _, rover = daemon
    start = dict(zip(rover.info().names[:6], np.radians(START).tolist(), strict=True))
    with rover.control("test", take=True):
        if rover.mode().mode == "estop":
            rover.reset_fault()
        if rover.mode().mode == "disarmed":
            arm_when_ready(rover, "given", start)
        if angles(rover) != pytest.approx(START, abs=1e-6):
            rover.move(start)
    return daemon


def command(setup: DaemonSetup, moves: Path) -> list[str]:
    return [sys.executable, "-m", "lrm_ident", "motion", "play", str(moves), "--connect", setup.endpoint]


def angles(rover: Rover) -> np.ndarray:
    return np.degrees(rover.commanded_q())


def test_moves_are_announced_made_and_end_at_rest(armed: tuple[DaemonSetup, Rover], tmp_path: Path) -> None:
    (setup, rover), seen = armed, list[float]()
    words = command(setup, moves_csv(tmp_path / "moves.csv", *THERE_AND_BACK))
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as player:
        while player.poll() is None:
            seen.append(float(angles(rover)[0]))
            time.sleep(0.02)
        said = player.communicate()[0]
    assert player.returncode == 0, said
    assert "It moves now: to the first pose, joint1 by 5.0 deg, then 4 s of moves: joint1 5 to 15 deg" in said
    assert max(seen) == pytest.approx(15.0, abs=0.01)
    late = seen[seen.index(max(seen)) :]
    assert sum(abs(q - 10.0) < 0.01 for q in late) > 20  # it rests there for 1.2 s
    assert angles(rover) == pytest.approx([5.0, *START[1:]], abs=0.3)
    assert rover.mode().mode == "armed"
    assert rover.mode().holder is None


def taken_and_given_back(rover: Rover) -> None:
    with rover.control("somebody else", take=True):
        rover.move({"joint1": 0.2})


def frozen(player: subprocess.Popen[str], rover: Rover) -> None:
    """The player's computer is busy until its lease has run out."""
    player.send_signal(signal.SIGSTOP)
    wait_for(lambda: rover.mode().holder is None, "the lease runs out")
    player.send_signal(signal.SIGCONT)


@pytest.mark.parametrize(
    ("what", "at_rest", "code", "words"),
    [
        ("hold", False, 2, "error: the motion ended before its goal: holding (hold)"),
        ("estop", True, 2, "error: the moves ended: the arm is estop (test)"),
        ("taken", True, 2, "error: the moves ended: the lease"),
        ("frozen", False, 2, "error: the motion ended before its goal: holding (lease lost)"),
        ("frozen", True, 2, "error: the moves ended: the lease"),
        ("Ctrl-C", False, 1, "stopped; the arm holds"),
    ],
)
def test_a_stop_in_the_middle_ends_it_and_nothing_moves_any_more(
    armed: tuple[DaemonSetup, Rover], tmp_path: Path, what: str, at_rest: bool, code: int, words: str
) -> None:
    """In a move, and in a rest between two."""
    setup, rover = armed
    asked = command(setup, moves_csv(tmp_path / "moves.csv", *(RESTING if at_rest else LONG)))
    with subprocess.Popen(asked, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as player:
        there = 9.99 if at_rest else 5.0
        wait_for(lambda: angles(rover)[0] > there or player.poll() is not None, "it moves", 60.0, 0.05)
        assert player.poll() is None, player.communicate()[0]
        time.sleep(1.0 if at_rest else 0.0)
        stops: dict[str, Callable[[], object]] = {
            "hold": rover.hold, "estop": lambda: rover.estop("test"), "taken": lambda: taken_and_given_back(rover),
            "frozen": lambda: frozen(player, rover), "Ctrl-C": lambda: player.send_signal(signal.SIGINT),
        }  # fmt: skip
        stops[what]()
        if what == "Ctrl-C":
            wait_for(lambda: rover.mode().mode == "holding", "it holds")
        at = angles(rover)
        said, _ = player.communicate(timeout=60)
    assert player.returncode == code, said
    assert "Traceback" not in said
    assert f"\n{words}" in said
    time.sleep(1.0)
    assert angles(rover).tolist() == at.tolist()
    assert rover.mode().mode in ("holding", "estop", "armed")


def test_what_it_refuses_moves_nothing(armed: tuple[DaemonSetup, Rover], tmp_path: Path) -> None:
    setup, rover = armed
    begin = angles(rover).tolist()
    good = moves_csv(tmp_path / "good.csv", (0.0, 5.0), (2.0, 10.0)).read_text()
    five = "\n".join(line.rpartition(",")[0] for line in good.splitlines()) + "\n"
    cases = {
        "times as fast as the ramp": moves_csv(tmp_path / "fast.csv", (0.0, 5.0), (0.1, 40.0)).read_text(),
        "q1_deg": moves_csv(tmp_path / "far.csv", (0.0, 5.0), (60.0, 200.0)).read_text(),
        "q6_deg": five,
        "nan": good.replace("5.00000,-60", "nan,-60", 1),
    }
    for number, (needle, text) in enumerate(cases.items()):
        (path := tmp_path / f"bad{number}.csv").write_text(text)
        assert needle in stderr_of("motion", "play", path, "--connect", setup.endpoint)
        assert angles(rover).tolist() == begin
