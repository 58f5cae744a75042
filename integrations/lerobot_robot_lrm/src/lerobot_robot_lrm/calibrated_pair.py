"""A LeRobot robot of two arms, each corrected by a model of its own, with a base for each or one for both."""

from __future__ import annotations

from contextlib import suppress
from types import SimpleNamespace
from typing import Any

from lerobot.robots.robot import Robot

from lerobot_robot_lrm.calibrated_robot import CalibratedRobot
from lerobot_robot_lrm.correction import Correction, places_of
from lerobot_robot_lrm.wrapped_robot import WrappedRobot
from lrm_math.errors import UnknownName

SIDES = ("left", "right")
EACH = "each"


class CalibratedPair(WrappedRobot):
    """A robot with a `left_arm` and a `right_arm`, as LeRobot's `bi_so_follower`; each becomes a `CalibratedRobot`.

    `config.base`: `each`, every arm on its own base as fitted, or `left` or `right`: the base of this arm carries both,
    and the other arm's tool is brought to where the arm files have it beside that. Raises `LrmError`: a model is not of
    its arm, or the two stand otherwise than the arm files say by more than commands make up for.
    """

    def __init__(self, config: Any, robot: Robot) -> None:
        super().__init__(config, robot)
        if config.base not in (EACH, *SIDES):
            raise UnknownName("base", config.base, (EACH, *SIDES))
        keep = places_of(config.keep)
        models = {side: str(getattr(config, f"{side}_model")) for side in SIDES}
        payloads = {side: 1e-3 * getattr(config, f"{side}_payload_g") for side in SIDES}
        motions = {side: getattr(config, f"{side}_motion") for side in SIDES}
        found = {
            side: Correction.of_file(models[side], payloads[side], keep, motions[side], config.lead) for side in SIDES
        }
        if config.base != EACH:
            (other,) = {*SIDES} - {config.base}
            found[other] = found[other].on_the_base_of(found[config.base])
        for side in SIDES:
            own = SimpleNamespace(model=models[side], motion=motions[side], accept_settings=config.accept_settings)
            setattr(robot, f"{side}_arm", CalibratedRobot(own, getattr(robot, f"{side}_arm"), found[side]))

    def connect(self, calibrate: bool = True) -> None:
        """Connects both arms, or none. Raises `LrmError`: as `CalibratedRobot.connect`."""
        try:
            self.robot.connect(calibrate)
        except Exception:
            for side in SIDES:
                arm = getattr(self.robot, f"{side}_arm")
                with suppress(Exception):  # what is told is why it did not connect
                    if arm.is_connected:
                        arm.disconnect()
            raise
