"""A servo whose supply was off for a moment in a campaign: it has fallen, and is not pulled back from where it lies."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from examples.so101.feetech_bus import FeetechBus
from examples.so101.feetech_servo import FeetechServo
from lrm_ident.measuring.campaign.session import torque_named
from lrm_ident.measuring.servo_bus.feetech import FEETECH
from lrm_math.errors import LrmError
from tests.doors.servos_door import CampaignDoor, campaign_over_bus
from tests.ident.measuring.feetech.test_torque_on import TorqueOnGoalServo

FALL = 0.3
"""rad, less than that by which a joint that is held up may be behind."""


@pytest.fixture
def door() -> Iterator[CampaignDoor]:
    with campaign_over_bus(FEETECH, TorqueOnGoalServo, FeetechBus, CampaignDoor, 3) as opened:
        opened.torque_on()
        yield opened


class PlainServo(FeetechServo):
    """Of its own class, so that the door lets it stand within its limits."""


def falls(servo: FeetechServo) -> float:
    servo.power_cycle()
    servo.angle -= FALL
    return servo.angle


def raise_named(door: CampaignDoor) -> None:
    """As `by_servos` does with what ends a campaign."""
    assert door.arm is not None
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
