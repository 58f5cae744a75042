"""Calibrated forms of every robot that LeRobot knows: `so101_follower` → `so101_follower_calibrated`."""

from __future__ import annotations

from dataclasses import field, fields, make_dataclass
from typing import Any

import lerobot.robots.so_follower  # noqa: F401  (registers so100_follower and so101_follower)
from lerobot.robots.config import RobotConfig
from lerobot.robots.utils import make_robot_from_config
from lerobot.utils.import_utils import register_third_party_plugins

from lerobot_robot_lrm.calibrated_robot import CalibratedRobot

CALIBRATED = "_calibrated"


def register_calibrated_robots() -> None:
    """Registers the calibrated form of every robot known so far, those of other plug-ins too."""
    register_third_party_plugins()
    for name, config in list(RobotConfig.get_known_choices().items()):
        known = RobotConfig.get_known_choices()
        if not name.endswith(CALIBRATED) and name + CALIBRATED not in known:
            RobotConfig.register_subclass(name + CALIBRATED, calibrated_config(name, config))


def calibrated_config(name: str, config: type[Any]) -> type[Any]:
    """Configuration of the calibrated form of a robot: its own fields, `model` (a file), `payload_g`,
    `accept_settings`, `keep`."""
    own = [
        ("model", str, field(kw_only=True)),
        ("payload_g", float, field(default=0.0, kw_only=True)),
        ("accept_settings", bool, field(default=False, kw_only=True)),
        ("keep", str, field(default="base,tool", kw_only=True)),
    ]
    namespace = {"wrapped_type": name, "wrapped_config": config, "__module__": __name__}
    # LeRobot makes the robot of the class named like the configuration's, from the package of its module.
    return make_dataclass("CalibratedFormConfig", own, bases=(config,), namespace=namespace)


class CalibratedForm(CalibratedRobot):
    """The calibrated form that a configuration of `calibrated_config` describes. Raises `LrmError`."""

    def __init__(self, config: Any) -> None:
        kind = config.wrapped_config
        values = {own.name: getattr(config, own.name) for own in fields(kind) if own.init}
        super().__init__(config, make_robot_from_config(kind(**values)))
