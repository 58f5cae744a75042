"""Touches by hand: kept when the tip rests, on the disk at once, limp servos only; the file goes on."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from examples.so101.feetech_servo import STEP
from lrm_ident.measuring.servo_bus import feetech as table
from lrm_ident.measuring.servo_bus.bus import ServoHost
from lrm_ident.measuring.servo_bus.feetech import FEETECH
from lrm_ident.measuring.servo_bus.servos import BusServos, limp_servos
from lrm_ident.measuring.sockets.by_hand import TouchLog, points_to_touch, record_touches
from lrm_math.arm.arm_file import load_arm
from lrm_math.errors import FileError, LrmError
from tests.ident.measuring.feetech.test_feetech_servos import BusLine, line_of


def limp(line: BusLine) -> BusServos:
    return limp_servos("feetech:/dev/x", ServoHost(line, FEETECH), load_arm("so101"), (1, 2, 3, 4, 5))


def recorded(line: BusLine, path: Path, answers: list[str], said: list[str]) -> int:
    """Touches by a person who gives these answers, the elbow at another angle each time."""
    steps: Iterator[str] = iter(answers)

    def ask(_: str) -> str:
        line.bus.servos[2].angle += 100 * STEP
        try:
            return next(steps)
        except StopIteration:
            raise EOFError from None

    return record_touches(limp(line), TouchLog(path, 5), ["A", "B"], ask, said.append, line.sleep)


def test_touches_are_kept_with_socket_and_placement(tmp_path: Path) -> None:
    path, said = tmp_path / "touches.csv", list[str]()
    assert recorded(line_of(1, 2, 3, 4, 5), path, ["", "", "board left", "B", "", "X", "end"], said) == 3
    rows = [line.split(",") for line in path.read_text().splitlines()]
    assert [row[-2:] for row in rows[1:]] == [["A", "1"], ["B", "1"], ["B", "left"]]
    assert abs(float(rows[1][3]) - 8.7891) < 1e-3
    assert any("'X' is none of A, B" in words for words in said)
    assert recorded(line_of(1, 2, 3, 4, 5), path, [""], said) == 1
    assert path.read_text().splitlines()[-1].startswith("4,")
    assert path.read_text().splitlines()[-1].endswith(",left")


def test_a_joint_that_moves_is_not_kept(tmp_path: Path) -> None:
    line, said = line_of(1, 2, 3, 4, 5), list[str]()
    servos = limp(line)

    def sleep(_: float) -> None:
        line.bus.servos[0].angle += 30 * STEP

    answers = iter(["", "end"])
    count = record_touches(servos, TouchLog(tmp_path / "t.csv", 5), ["A"], lambda _: next(answers), said.append, sleep)
    assert count == 0
    assert "joint 1 moved by" in said[-1]


def test_servos_with_torque_are_refused() -> None:
    line = line_of(1, 2, 3, 4, 5)
    table.TORQUE_ENABLE.write(line.bus.servos[3].memory, 1)
    with pytest.raises(LrmError, match="torque is on at wrist_flex"):
        limp(line)


def test_another_file_and_odd_names_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("a,b\n1,2\n")
    with pytest.raises(FileError, match="not that of touches"):
        TouchLog(path, 5)
    for names in ("", "A,A", "A,end"):
        with pytest.raises(LrmError, match="names of sockets by commas"):
            points_to_touch(names, [])
