"""Bare Feetech servos over a line that is the simulated bus: what is asked for, held, refused, and said in one line."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st

from examples.so101.dynamixel_bus import DynamixelBus, DynamixelServo
from examples.so101.feetech_bus import FeetechBus
from examples.so101.feetech_servo import STEP, FeetechServo
from lrm_ident.measuring.campaign.plan import PlannedPose
from lrm_ident.measuring.campaign.run import Unreachable
from lrm_ident.measuring.campaign.servo_arm import SPEED, TICK_S, TORQUE, ServoArm
from lrm_ident.measuring.servo_bus import feetech as table
from lrm_ident.measuring.servo_bus.bus import ServoHost
from lrm_ident.measuring.servo_bus.dynamixel import DYNAMIXEL
from lrm_ident.measuring.servo_bus.feetech import FEETECH
from lrm_ident.measuring.servo_bus.servos import BusServos, held_servos
from lrm_math.arm.arm_file import load_arm
from lrm_math.errors import LrmError

pytestmark = pytest.mark.usefixtures("hurried")
MOST_TORQUE = 1000
ARM = load_arm("so101")
REGISTERS = st.sampled_from(
    [table.ID, table.MAX_POSITION, table.GOAL_POSITION, table.TORQUE_LIMIT, table.TEMPERATURE, table.HOMING_OFFSET]
)
ANGLES = st.lists(st.floats(-1.5, 1.5), min_size=5, max_size=5)
WITHIN = st.tuples(
    *(st.one_of(st.sampled_from([j.lower, j.upper]), st.floats(j.lower, j.upper)) for j in ARM.joints)
).map(list)


@dataclass
class BusLine:
    """A serial line to a simulated bus, and the clock of both: servos move while the host sleeps."""

    bus: FeetechBus
    t: float = 0.0
    waiting: bytes = b""
    echo: bool = False
    lost: int = 0
    seen: list[list[float]] = field(default_factory=list)

    def write(self, data: bytes) -> int:
        if self.lost:  # a bus loses an answer now and then
            self.lost -= 1
            return len(data)
        self.waiting += (data if self.echo else b"") + self.bus.feed(data, self.t)
        self.seen.append([servo.target for servo in self.bus.servos])
        return len(data)

    def read(self, size: int = 1) -> bytes:
        out, self.waiting = self.waiting[:size], self.waiting[size:]
        return out

    @property
    def in_waiting(self) -> int:
        return len(self.waiting)

    def now(self) -> float:
        return self.t

    def sleep(self, seconds: float) -> None:
        self.t += seconds


class SdkPort:
    """A line to a bus, with as much of `PortHandler` as the packets of both makers' kits need."""

    is_using = False

    def __init__(self, line: BusLine) -> None:
        self.line = line

    def clearPort(self) -> None:  # noqa: N802
        self.line.waiting = b""

    def writePort(self, packet: list[int]) -> int:  # noqa: N802
        return self.line.write(bytes(packet))

    def readPort(self, length: int) -> list[int]:  # noqa: N802
        return list(self.line.read(length))

    def setPacketTimeout(self, length: int) -> None:  # noqa: N802
        pass

    def isPacketTimeout(self) -> bool:  # noqa: N802
        return not self.line.waiting


BUSES = {"feetech": (FEETECH, FeetechBus, FeetechServo), "dynamixel": (DYNAMIXEL, DynamixelBus, DynamixelServo)}
on_both = pytest.mark.parametrize("kind", BUSES)


def line_of(*numbers: int, echo: bool = False, kind: str = "feetech") -> BusLine:
    _, bus, servo = BUSES[kind]
    return BusLine(bus([servo(number) for number in numbers]), echo=echo)


def held(line: BusLine, numbers: tuple[int, ...] = (1, 2, 3, 4, 5)) -> BusServos:
    kind = next(kind for kind, (_, bus, _) in BUSES.items() if type(line.bus) is bus)
    return held_servos(f"{kind}:/dev/x", ServoHost(line, BUSES[kind][0]), ARM, numbers)


def pose(q: list[float], approach: int = 0) -> PlannedPose:
    return PlannedPose(1, tuple(q), 0.0, (approach,) * len(q), 1)


@on_both
@given(angles=ANGLES, echo=st.booleans())
def test_torque_comes_where_they_stand_and_moves_nothing(kind: str, angles: list[float], echo: bool) -> None:
    line = line_of(1, 2, 3, 4, 5, 6, echo=echo, kind=kind)
    for servo, angle in zip(line.bus.servos, angles, strict=False):
        servo.angle = round(angle / STEP) * STEP
        if kind == "feetech":
            table.GOAL_POSITION.write(servo.memory, 3000)
    servos = held(line)
    line.sleep(5.0)
    assert servos.angles() == pytest.approx([round(angle / STEP) * STEP for angle in angles])
    assert all(servos.powered().values())
    assert not line.bus.servos[5].powered  # the gripper is no joint: it is left alone


@pytest.mark.long
@given(st.lists(WITHIN, min_size=1, max_size=3), st.sampled_from([-1, 0, 1]))
def test_rows_have_the_whole_counts_that_were_commanded_and_speed_is_bounded(
    goals: list[list[float]], approach: int
) -> None:
    line = line_of(1, 2, 3, 4, 5)
    arm = ServoArm(held(line), ARM, line, lambda _: None)
    line.seen.clear()
    for goal in goals:
        state = arm.go(pose(goal, approach))
        targets = [servo.target for servo in line.bus.servos]
        assert state.q == pytest.approx(targets)
        assert max(abs(a - b) for a, b in zip(state.q, goal, strict=True)) <= STEP
        inside = [j.lower <= q <= j.upper for q, j in zip(state.q, ARM.joints, strict=True)]
        assert all(inside)
        assert arm.commanded() == state.q
    before = [0.0] * 5
    for now in line.seen:
        assert max(abs(a - b) for a, b in zip(now, before, strict=True)) <= SPEED * TICK_S + STEP + 1e-9
        before = now
    for servo in line.bus.servos:
        assert table.TORQUE_LIMIT.read(servo.memory) == round(TORQUE * MOST_TORQUE)


def test_a_pose_beyond_a_servos_own_limits_is_not_tried() -> None:
    line = line_of(1, 2, 3, 4, 5)
    table.MAX_POSITION.write(line.bus.servos[2].memory, 2500)
    arm = ServoArm(held(line), ARM, line, lambda _: None)
    for one in (pose([0.0, 0.0, 1.2, 0.0, 0.0]), pose([0.0, 0.0, 452 * STEP, 0.0, 0.0], -1)):
        with pytest.raises(Unreachable, match=r"elbow_flex: .* deg is beyond its servo's own limits, -180 to 40 deg"):
            arm.go(one)
    line.sleep(5.0)
    assert [servo.angle for servo in line.bus.servos] == [0.0] * 5


def test_an_interrupted_move_holds_where_it_was_sent_last() -> None:
    line = line_of(1, 2, 3, 4, 5)
    arm = ServoArm(held(line), ARM, line, lambda _: None)
    slept = line.sleep

    def interrupted(seconds: float) -> None:
        slept(seconds)
        if line.t > 1.0:
            raise KeyboardInterrupt

    line.sleep = interrupted  # type: ignore[method-assign]
    with pytest.raises(KeyboardInterrupt):
        arm.go(pose([1.5] * 5))
    line.bus.advance(60.0)
    assert [servo.angle for servo in line.bus.servos] == pytest.approx(arm.commanded(), abs=1e-6)
    assert max(arm.commanded()) <= SPEED * (1.0 + 2 * TICK_S)
    assert all(servo.powered for servo in line.bus.servos)


@pytest.mark.long
def test_lost_answers_are_asked_for_again_and_a_lost_line_is_said() -> None:
    line = line_of(1, 2, 3, 4, 5)
    line.lost = 2
    arm = ServoArm(held(line), ARM, line, lambda _: None)
    line.lost = 1
    assert arm.too_warm() == ""

    def gone(_: bytes) -> int:
        raise OSError("device disconnected?\nno data")

    line.write = gone  # type: ignore[method-assign]
    with pytest.raises(LrmError, match=r"does not answer: the serial line is gone \(device disconnected\? no data\)$"):
        arm.go(pose([0.1] * 5))


@given(st.integers(1, 5), REGISTERS, st.booleans())
def test_it_reads_what_the_servo_has(number: int, register: table.Register, echo: bool) -> None:
    line = line_of(1, 2, 3, 4, 5, echo=echo)
    host, memory = ServoHost(line, FEETECH), line.bus.servos[number - 1].memory
    assert host.read(number, register) == register.read(memory)
    assert host.read_all((5, number), register)[number] == register.read(memory)


@given(st.integers(1, 5), st.integers(0, 1000), st.booleans())
def test_it_writes_to_one_servo_alone(number: int, limit: int, echo: bool) -> None:
    line = line_of(1, 2, 3, 4, 5, echo=echo)
    ServoHost(line, FEETECH).write(number, table.TORQUE_LIMIT, limit)
    limits = [table.TORQUE_LIMIT.read(servo.memory) for servo in line.bus.servos]
    assert limits == [limit if servo.id == number else MOST_TORQUE for servo in line.bus.servos]


def refusal(line: BusLine, numbers: tuple[int, ...] = (1, 2, 3, 4, 5)) -> str:
    with pytest.raises(LrmError) as caught:
        held(line, numbers)
    assert "\n" not in str(caught.value)
    assert not any(servo.powered for servo in line.bus.servos)  # none gets torque unless all are fit
    return str(caught.value)


@pytest.mark.long
@on_both
def test_a_missing_motor_and_a_wrong_number(kind: str) -> None:
    line = partial(line_of, kind=kind)
    assert refusal(line(1, 2, 4, 5, 6)).endswith("servo 3 does not answer; on the bus are 1, 2, 4, 5, 6")
    wrong = refusal(line(1, 2, 3, 4, 5, 6), (1, 2, 3, 4, 9))
    assert wrong == f"--robot {kind}:/dev/x: servo 9 does not answer; on the bus are 1, 2, 3, 4, 5, 6"
    assert refusal(line()).endswith("nor does any other: is the power on, is it the right port?")


@pytest.mark.long
@on_both
@given(apart=st.floats(0.01, 3.0), which=st.integers(0, 4))
def test_two_servos_of_one_number(kind: str, apart: float, which: int) -> None:
    numbers = (1, 2, 3, 4, 5)
    line = line_of(*numbers, numbers[which], kind=kind)
    line.bus.servos[5].angle = apart
    assert f"the answer of servo {numbers[which]} is garbled: two servos have this number?" in refusal(line)


def test_other_servos_and_modes() -> None:
    line = line_of(1, 2, 3, 4, 5)
    table.MODEL.write(line.bus.servos[1].memory, 1284)
    assert refusal(line).endswith("servo 2 is of model 1284; should be STS3215 or STS3250")
    line = line_of(1, 2, 3, 4, 5)
    table.MODE.write(line.bus.servos[3].memory, 1)
    assert refusal(line).endswith("servo 4 is in mode 1; should be 0, which goes to angles")
