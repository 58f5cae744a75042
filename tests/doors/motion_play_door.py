"""`lrm-ident motion play`: recorded or designed moves on servos and over the daemon, by the doors of a campaign."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from lrm_ident.measuring.campaign.move_player import play
from lrm_ident.measuring.campaign.rover_arm import RoverArm
from lrm_ident.measuring.campaign.servo_arm import SPEED, ServoArm
from lrm_ident.measuring.excitation.excitations import FRAME_S
from lrm_ident.measuring.excitation.sequence import MoveSequence
from tests.doors.daemon_campaign_door import NEAR, DaemonCampaignDoor, daemon_campaign
from tests.doors.door import DoorKind
from tests.doors.servos_door import (
    BUS,
    DYNAMIXEL_BUS,
    FEETECH_BUS,
    LEROBOT_CAMPAIGN,
    CampaignDoor,
    campaign_over_lerobot,
)

AT_FIRST, SHARE, REST_S = 0.2, 0.8, 0.3
"""Part of the way to a wish that the arm stands from the first of the moves; of the fastest; s at rest between two."""


def there_and_back(here: Sequence[float], wish: Sequence[float], rate: float) -> MoveSequence:
    """Moves from near where the arm stands to a wish (rad), a rest, and back, at a rate (rad/s)."""
    first = np.array(here) + AT_FIRST * (np.array(wish) - here)
    seconds = max(float(np.max(np.abs(wish - first))) / rate, FRAME_S)
    times = np.cumsum([0.0, REST_S, seconds, REST_S, seconds, REST_S])
    t = FRAME_S * np.arange(np.ceil(times[-1] / FRAME_S) + 1.0)
    part = np.interp(t, times, [0.0, 0.0, 1.0, 1.0, 0.0, 0.0])
    return MoveSequence(t, first + part[:, None] * (wish - first))


class ServoPlayDoor(CampaignDoor):
    """See `CampaignDoor`; for a wish there are moves there and back."""

    def goes(self, arm: ServoArm, wish: Sequence[float]) -> None:
        play(arm, there_and_back(arm.commanded(), wish, SHARE * SPEED), [], lambda _: None)


class DaemonPlayDoor(DaemonCampaignDoor):
    """See `DaemonCampaignDoor`; for a wish there are moves there and back."""

    def _goes(self, arm: RoverArm, wish: Sequence[float]) -> None:
        rate = SHARE * min(arm.info.rate_rad_per_s[: arm.info.joints])
        play(arm, there_and_back(arm.commanded(), wish, rate), [], lambda _: None)


DOORS = (
    DoorKind(
        "moves over the daemon", ("lrm_ident.measuring.campaign.rover_arm", "lrmd.client.rover"),
        partial(daemon_campaign, DaemonPlayDoor), 0.5, 0.5, NEAR,
    ),
    DoorKind("moves over LeRobot", LEROBOT_CAMPAIGN, partial(campaign_over_lerobot, ServoPlayDoor), 0.0, 0.2),
    DoorKind("moves on a Feetech bus", BUS, partial(FEETECH_BUS, ServoPlayDoor), 0.0, 0.2),
    DoorKind("moves on a Dynamixel bus", BUS, partial(DYNAMIXEL_BUS, ServoPlayDoor), 0.0, 0.2),
)  # fmt: skip
