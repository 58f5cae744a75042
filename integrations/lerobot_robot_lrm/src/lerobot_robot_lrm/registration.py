"""Calibrated forms of every robot that LeRobot knows: `so101_follower` → `so101_follower_calibrated`."""

from __future__ import annotations

from dataclasses import field, fields, make_dataclass
from typing import Any

import lerobot.robots.bi_so_follower
import lerobot.robots.so_follower  # noqa: F401  (registers so100_follower and so101_follower)
from lerobot.robots.config import RobotConfig
from lerobot.robots.robot import Robot
from lerobot.robots.utils import make_robot_from_config
from lerobot.utils.import_utils import register_third_party_plugins

from lerobot_robot_lrm.calibrated_pair import CalibratedPair
from lerobot_robot_lrm.calibrated_robot import CalibratedRobot

CALIBRATED = "_calibrated"
COMMON = (("accept_settings", bool, False), ("keep", str, "base,tool"), ("lead", bool, False))
ONE = (("model", str), ("motion", str, ""), ("payload_g", float, 0.0), *COMMON)
TWO = (
    ("left_model", str), ("right_model", str), ("left_motion", str, ""), ("right_motion", str, ""),
    ("left_payload_g", float, 0.0), ("right_payload_g", float, 0.0),
    ("base", str, "each"), *COMMON,
)  # fmt: skip
"""Options of a calibrated form beside those of the robot: name, type and, if it has one, what it is if not given."""


def register_calibrated_robots() -> None:
    """Registers the calibrated form of every robot known so far, those of other plug-ins too."""
    register_third_party_plugins()
    for name, config in list(RobotConfig.get_known_choices().items()):
        known = RobotConfig.get_known_choices()
        if not name.endswith(CALIBRATED) and name + CALIBRATED not in known:
            RobotConfig.register_subclass(name + CALIBRATED, calibrated_config(name, config))


def calibrated_config(name: str, config: type[Any]) -> type[Any]:
    """Configuration of the calibrated form of a robot: its own fields, and `ONE`, or `TWO` of one with two arms."""
    two = {"left_arm_config", "right_arm_config"} <= {own.name for own in fields(config)}
    options = [
        (word, kind, field(kw_only=True, **_default(*default))) for word, kind, *default in (TWO if two else ONE)
    ]
    namespace = {"wrapped_type": name, "wrapped_config": config, "__module__": __name__}
    # LeRobot makes the robot of the class named like the configuration's, from the package of its module.
    form = CalibratedPairForm if two else CalibratedForm
    return make_dataclass(f"{form.__name__}Config", options, bases=(config,), namespace=namespace)


class CalibratedForm(CalibratedRobot):
    """The calibrated form that a configuration of `calibrated_config` describes. Raises `LrmError`."""

    def __init__(self, config: Any) -> None:
        super().__init__(config, _wrapped(config))


class CalibratedPairForm(CalibratedPair):
    """The same of a robot with two arms. Raises `LrmError`."""

    def __init__(self, config: Any) -> None:
        super().__init__(config, _wrapped(config))


def _wrapped(config: Any) -> Robot:
    """The robot that a calibrated form is one of."""
    kind = config.wrapped_config
    return make_robot_from_config(kind(**{own.name: getattr(config, own.name) for own in fields(kind) if own.init}))


def _default(*values: object) -> dict[str, Any]:
    return {"default": values[0]} if values else {}
