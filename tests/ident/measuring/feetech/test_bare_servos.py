"""Bare Feetech servos: a host that believes no garbled answer, an arm that does not move when it is connected."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from examples.so101.feetech_bus import FeetechBus
from examples.so101.feetech_servo import FeetechServo
from examples.so101.story import TIMING, bench
from lrm_ident.data.measurement_file.load import load_poses
from lrm_ident.measuring.feetech import memory_table as table
from lrm_ident.measuring.feetech.bus import FeetechHost, NoAnswer
from lrm_ident.measuring.feetech.servos import MIDDLE, FeetechServos, connected_bus
from lrm_math.arm.arm_file import load_arm
from lrm_math.errors import LrmError
from tests.support.commands import stderr_of

ARM = load_arm("so101")
REGISTERS = st.sampled_from(
    [table.ID, table.MAX_POSITION, table.GOAL_POSITION, table.TORQUE_LIMIT, table.TEMPERATURE, table.HOMING_OFFSET]
)
POSES_DEG = ((0, 0, 0, 0, 0), (15, -10, 12, 5, -8), (6, 14, -6, -12, 4))


class Wire:
    """The simulated bus as a serial line. `echo`: whether the adapter hands back what is sent."""

    def __init__(self, servos: list[FeetechServo], echo: bool = False) -> None:
        self.bus, self.echo, self.heard, self.now = FeetechBus(servos), echo, b"", 0.0

    def write(self, data: bytes, /) -> int:
        self.heard += data * self.echo + self.bus.feed(data, self.now)
        return len(data)

    def read(self, size: int = 1, /) -> bytes:
        out, self.heard = self.heard[:size], self.heard[size:]
        return out

    def reset_input_buffer(self) -> None:
        self.heard = b""

    @property
    def in_waiting(self) -> int:
        return len(self.heard)


@given(st.integers(1, 5), REGISTERS, st.booleans())
def test_it_reads_what_the_servo_has(number: int, register: table.Register, echo: bool) -> None:
    wire = Wire([FeetechServo(i) for i in range(1, 6)], echo)
    host, memory = FeetechHost(wire), wire.bus.servos[number - 1].memory
    assert host.read(number, register) == register.read(memory)


@given(st.integers(1, 5), st.integers(0, 1000), st.booleans())
def test_it_writes_to_one_servo_alone(number: int, limit: int, echo: bool) -> None:
    wire = Wire([FeetechServo(i) for i in range(1, 6)], echo)
    FeetechHost(wire).write(number, table.TORQUE_LIMIT, limit)
    limits = [table.TORQUE_LIMIT.read(servo.memory) for servo in wire.bus.servos]
    assert limits == [limit if servo.id == number else 1000 for servo in wire.bus.servos]


@pytest.mark.parametrize("echo", [False, True])
def test_two_servos_of_one_number_and_none_are_told_apart(echo: bool) -> None:
    servos = [FeetechServo(1), FeetechServo(2), FeetechServo(2)]
    servos[2].angle = 0.7
    host = FeetechHost(Wire(servos, echo))
    with pytest.raises(NoAnswer, match="servo 3 does not answer"):
        host.ping(3)
    with pytest.raises(NoAnswer, match="servo 2 answers no packet: are there two servos of this number"):
        host.read(2, table.POSITION)


@given(st.lists(st.floats(-1.5, 1.5), min_size=5, max_size=5))
def test_commands_are_the_angles_that_the_encoders_read_then(q: list[float]) -> None:
    wire = Wire([FeetechServo(i) for i in range(1, 6)])
    for servo in wire.bus.servos:
        servo.write(table.TORQUE_ENABLE.address, b"\x01")
    servos = FeetechServos("test", FeetechHost(wire), ("a", "b", "c", "d", "e"), (1, 2, 3, 4, 5), ((0, 4095),) * 5)
    servos.command(q)
    wire.now = 10.0
    np.testing.assert_allclose(servos.angles(), q, atol=math.pi / 4096 + 1e-9)


def test_beyond_a_servos_own_limits_is_refused_not_cut_short() -> None:
    wire = Wire([FeetechServo(1)])
    servos = FeetechServos("test", FeetechHost(wire), ("elbow",), (1,), ((1024, 3072),))
    with pytest.raises(LrmError, match=r"elbow: 100.0 deg is beyond its servo's own limits, -90 to 90 deg"):
        servos.command([math.radians(100.0)])
    assert wire.bus.goals == 0


@pytest.fixture(scope="module")
def link(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, int]]:
    """The simulated SO-101 at a serial device, and the port of the tracker beside it."""
    with bench(tmp_path_factory.mktemp("bus"), "gain", 1) as found:
        yield found.link, found.tracker_port


@pytest.mark.slow
def test_connecting_gives_torque_where_the_servos_stand(link: tuple[Path, int]) -> None:
    with connected_bus(f"feetech:{link[0]}", ARM) as servos:
        before = servos.angles()
        assert all(servos.powered().values())
        assert before == pytest.approx(servos.angles(), abs=1e-9)
        assert [servos.host.read(n, table.GOAL_POSITION) for n in servos.numbers] == [
            round(q / (2 * math.pi / 4096)) + MIDDLE for q in before
        ]


@pytest.mark.slow
def test_poses_are_driven_to_and_measured(link: tuple[Path, int], tmp_path: Path) -> None:
    lines = [",".join(map(str, (number, *q))) for number, q in enumerate(POSES_DEG, start=1)]
    (tmp_path / "poses.csv").write_text("pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg\n" + "\n".join(lines) + "\n")
    words = ["measure", tmp_path / "poses.csv", "--robot", f"feetech:{link[0]}", "--tracker", f"dtrack:{link[1]}"]
    words += [*TIMING, "-o", tmp_path / "data.csv"]
    done = subprocess.run(
        [sys.executable, "-m", "lrm_ident", *map(str, words)], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr + done.stdout
    assert "3 of 3 poses are in" in done.stdout
    data = load_poses(tmp_path / "data.csv", ARM)
    np.testing.assert_allclose(np.degrees(data.q), POSES_DEG, atol=1e-4)


@pytest.mark.parametrize(
    ("robot", "words"),
    [
        ("{link},ids=1+2+3+4+9", "servo 9 does not answer; of 1, 2, 3, 4, 9 these answer: 1, 2, 3, 4"),
        ("{link},ids=1-4", "4 ids; should be one for each of the arm's 5 joints"),
        ("{link},id=1", "'id=1'; should be ids=1-5, ids=3+1+2, or baud=1000000"),
        ("/nowhere/at/all", "/nowhere/at/all cannot be opened"),
    ],
)
@pytest.mark.slow
def test_what_is_not_there_is_one_line(link: tuple[Path, int], tmp_path: Path, robot: str, words: str) -> None:
    (tmp_path / "poses.csv").write_text("pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg\n1,0,0,0,0,0\n")
    said = stderr_of(
        "measure", tmp_path / "poses.csv", "--robot", f"feetech:{robot.format(link=link[0])}",
        "--tracker", f"dtrack:{link[1]}", "-o", tmp_path / "data.csv",
    )  # fmt: skip
    assert words in " ".join(said.split())
    assert not (tmp_path / "data.csv").exists()
