"""Torque on: where the servos stand, bounded before, for all or for none, and after a supply that was off."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from examples.so101.feetech_bus import FeetechBus
from examples.so101.feetech_servo import MIDDLE, STEP, FeetechServo
from lrm_ident.measuring.campaign.session import torque_named
from lrm_ident.measuring.servo_bus import feetech as table
from lrm_ident.measuring.servo_bus.bus import ServoHost
from lrm_ident.measuring.servo_bus.feetech import FEETECH
from lrm_ident.measuring.servo_bus.servos import BusServos, held_servos
from lrm_ident.measuring.servo_bus.torque_on import TORQUE
from lrm_math.arm.arm_file import load_arm
from lrm_math.errors import LrmError
from tests.doors.servos_door import CampaignDoor, campaign_over_bus
from tests.doors.simulated_follower import GoalKeepingServo
from tests.ident.measuring.feetech.test_feetech_servos import BusLine, line_of

ARM = load_arm("so101")
NUMBERS = (1, 2, 3, 4, 5)
ONE_DEGREE = math.radians(1.0)


def held(line: BusLine) -> BusServos:
    return held_servos("x", ServoHost(line, FEETECH), ARM, NUMBERS)


def angles(line: BusLine) -> list[float]:
    return [servo.angle for servo in line.bus.servos]


@given(
    st.lists(st.integers(0, 4095), min_size=5, max_size=5),
    st.lists(st.tuples(st.integers(0, 1500), st.integers(2500, 4095)), min_size=5, max_size=5),
    st.lists(st.integers(-2, 2), min_size=5, max_size=5),
)
def test_torque_on_moves_no_joint_anywhere(counts: list[int], limits: list[tuple[int, int]], turns: list[int]) -> None:
    """Beyond its own limits and beyond a turn too, of firmware that counts turns and of others."""
    line = line_of(*NUMBERS)
    for k, servo in enumerate(line.bus.servos):
        servo.angle, servo.counts_turns = (counts[k] + 4096 * turns[k] - MIDDLE) * STEP, k % 2 == 0
        table.MIN_POSITION.write(servo.memory, limits[k][0])
        table.MAX_POSITION.write(servo.memory, limits[k][1])
    before = angles(line)
    try:
        held(line)
    except LrmError:
        assert not any(servo.powered for servo in line.bus.servos)
    else:
        assert all(servo.powered for servo in line.bus.servos)
    line.bus.advance(line.t + 5.0)
    assert np.abs(np.subtract(angles(line), before)).max() <= ONE_DEGREE


@pytest.mark.parametrize(
    ("which", "at", "counts_turns", "said"),
    [
        (1, 780, False, r"^--robot x: shoulder_lift stands at -111.4 deg, 10.5 deg beyond .* limits, -101 to 101 deg"),
        (4, 4368, True, r"wrist_roll stands at 203.9 deg, 24.0 deg beyond .* limits, -180 to 180 deg"),
    ],
)
def test_where_a_servo_would_turn_there_none_gets_torque(which: int, at: int, counts_turns: bool, said: str) -> None:
    line = line_of(*NUMBERS)
    table.MIN_POSITION.write(line.bus.servos[1].memory, 900)
    table.MAX_POSITION.write(line.bus.servos[1].memory, 3200)
    servo = line.bus.servos[which]
    servo.angle, servo.counts_turns = (at - MIDDLE) * STEP, counts_turns
    before = angles(line)
    with pytest.raises(LrmError, match=said + r".*; move it by hand to within them; no joint has torque$"):
        held(line)
    line.bus.advance(line.t + 5.0)
    assert angles(line) == before


class TorqueByRegisterServo(FeetechServo):
    """One whose firmware switches torque on by its register alone."""

    def write(self, address: int, data: bytes) -> None:
        before = self.powered
        super().write(address, data)
        if not address <= table.TORQUE_ENABLE.address < address + len(data):
            table.TORQUE_ENABLE.write(self.memory, before)


@pytest.mark.parametrize("kind", [FeetechServo, TorqueByRegisterServo, GoalKeepingServo])
def test_whatever_the_firmware_does_with_an_old_goal_nothing_turns(kind: type[FeetechServo]) -> None:
    line = BusLine(FeetechBus([kind(number) for number in NUMBERS]))
    for servo, at in zip(line.bus.servos, (900, 1500, 2500, 3300, 60), strict=True):
        servo.angle = (at - MIDDLE) * STEP
        table.GOAL_POSITION.write(servo.memory, 4000 - at)
    before = angles(line)
    held(line)
    line.bus.advance(line.t + 5.0)
    assert all(servo.powered for servo in line.bus.servos)
    assert np.abs(np.subtract(angles(line), before)).max() <= ONE_DEGREE


def test_torque_is_bounded_before_it_is_on() -> None:
    line, wrong = line_of(*NUMBERS), []
    feed = line.bus.feed

    def watched(data: bytes, now: float) -> bytes:
        answer = feed(data, now)
        most = [table.TORQUE_LIMIT.read(servo.memory) for servo in line.bus.servos if servo.powered]
        wrong.extend(limit for limit in most if limit > TORQUE * 1000)
        return answer

    line.bus.feed = watched  # type: ignore[method-assign]
    held(line)
    assert not wrong


def test_a_servo_that_holds_with_less_torque_gets_no_more() -> None:
    """It may press against something, or hang: with more torque it would turn to a goal of somebody before."""
    line = line_of(*NUMBERS)
    weak, strong = line.bus.servos[:2]
    for servo, limit in ((weak, 150), (strong, 1000)):
        table.TORQUE_ENABLE.write(servo.memory, 1)
        table.TORQUE_LIMIT.write(servo.memory, limit)
    table.TORQUE_LIMIT.write(line.bus.servos[2].memory, 150)
    held(line)
    limits = [table.TORQUE_LIMIT.read(servo.memory) for servo in line.bus.servos]
    assert limits == [150, *[round(TORQUE * 1000)] * 4]


def questions() -> int:
    """Number of packets of the host from the first to torque on all."""
    line = LossyLine(FeetechBus([FeetechServo(number) for number in NUMBERS]))
    held(line)
    return line.asked


class LossyLine(BusLine):
    """A line that loses the answers to some questions: by their number from 0, those after it too if `gone`."""

    asked, loses, gone = 0, -1, False

    def write(self, data: bytes) -> int:
        out = super().write(data)
        if self.asked == self.loses or (self.gone and self.asked > self.loses >= 0):
            self.waiting = b""
        self.asked += 1
        return out


@pytest.mark.usefixtures("hurried")
def test_a_lost_answer_is_asked_for_again() -> None:
    for which in range(questions()):
        line = LossyLine(FeetechBus([FeetechServo(number) for number in NUMBERS]))
        line.loses = which
        held(line)
        assert all(servo.powered for servo in line.bus.servos), which


@pytest.mark.parametrize(("silent", "kind"), [(None, FeetechServo), (3, FeetechServo), (None, TorqueByRegisterServo)])
@pytest.mark.usefixtures("hurried")
def test_a_servo_that_falls_silent_leaves_no_half_powered_arm(silent: int | None, kind: type[FeetechServo]) -> None:
    """From any question on: the others are released, and whatever may have torque is named."""
    for which in range(questions()):
        wire = FeetechBus([kind(number) for number in NUMBERS])
        line = LossyLine(wire) if silent is None else DyingLine(wire, which, silent)
        line.loses, line.gone = (which, True) if silent is None else (-1, False)
        said = ""
        try:
            held(line)
        except LrmError as error:
            said = str(error)
        joints = zip(ARM.joints, wire.servos, strict=True)
        powered = [str(joint.name) for joint, servo in joints if servo.powered]
        unnamed = [name for name in powered if name not in said]
        assert not unnamed or (silent is not None and len(powered) == len(NUMBERS) - 1 and not said), (which, said)


class DyingLine(LossyLine):
    """A line on which one servo answers nothing, and does nothing, from a question on."""

    def __init__(self, bus: FeetechBus, when: int, number: int) -> None:
        super().__init__(bus)
        self.when, self.number = when, number

    def write(self, data: bytes) -> int:
        if self.asked == self.when:
            servo = self.bus.servos[self.number - 1]
            table.ID.write(servo.memory, 200)
            table.TORQUE_ENABLE.write(servo.memory, 0)
        return super().write(data)


def test_an_error_that_ends_a_campaign_names_the_joints_that_have_torque() -> None:
    line = line_of(*NUMBERS)
    said = r"^pulled out; torque is on, .* at shoulder_pan, .*, wrist_roll$"
    with pytest.raises(LrmError, match=said), torque_named(held(line)):
        raise LrmError("pulled out")


FALL = 0.3
"""rad, less than that by which a joint that is held up may be behind."""


class PlainServo(FeetechServo):
    """Of its own class, so that the door lets it stand within its limits."""


@pytest.fixture
def door() -> Iterator[CampaignDoor]:
    with campaign_over_bus(FEETECH, PlainServo, FeetechBus, CampaignDoor, 3) as opened:
        opened.torque_on()
        yield opened


def falls(servo: FeetechServo) -> float:
    servo.power_cycle()
    servo.angle -= FALL
    return servo.angle


def raise_named(door: CampaignDoor) -> None:
    """As `by_servos` does with what ends a campaign."""
    with torque_named(door.arm.servos):
        raise LrmError(door.time.failed[0])


def test_at_a_rest_the_next_pose_is_not_approached(door: CampaignDoor) -> None:
    door.ask([0.3, 0.2, 0.1, 0.0, 0.1])
    door.pass_time(20.0)
    lies = falls(door.servos[1])
    before = door.commanded()[2:]
    door.ask([0.0, 0.0, 0.0, 0.0, 0.0])
    door.pass_time(3.0)
    assert door.time.failed == ["shoulder_lift lost torque: was the supply off? Look where the arm stands, start again"]
    assert (door.servos[1].angle, door.commanded()[2:]) == (lies, before)


def test_in_motion_it_ends_within_a_glance_and_says_what_still_has_torque() -> None:
    with campaign_over_bus(FEETECH, PlainServo, FeetechBus, CampaignDoor, 3) as door:
        door.torque_on()
        door.ask([-0.8, -0.8, 0.8, 0.8, 0.8])
        door.pass_time(0.5)
        lies = falls(door.servos[1])
        door.pass_time(0.3)
        stands = door.commanded()
        door.pass_time(3.0)
        assert (door.servos[1].angle, door.commanded()) == (lies, stands)
        others = "shoulder_pan, elbow_flex, wrist_flex, wrist_roll"
        with pytest.raises(LrmError, match=f"^shoulder_lift lost torque.*; torque is on, .* at {others}$"):
            raise_named(door)


@pytest.mark.parametrize("seconds", [0.51, 0.55, 0.6, 0.65, 0.69])
def test_a_supply_that_was_off_for_a_moment_is_noticed_before_the_next_command(seconds: float) -> None:
    """A goal would switch the torque on, unbounded: the joint would be pulled back from where it fell to."""
    with campaign_over_bus(FEETECH, PlainServo, FeetechBus, CampaignDoor, 3) as door:
        door.torque_on()
        door.ask([-0.8, -0.8, 0.8, 0.8, 0.8])
        door.pass_time(seconds)
        lies, stands = falls(door.servos[1]), door.commanded()
        door.pass_time(3.0)
        assert door.time.failed[0].startswith("shoulder_lift lost torque")
        assert (door.servos[1].angle, door.servos[1].powered) == (lies, False)
        assert door.commanded()[2:] == stands[2:]
