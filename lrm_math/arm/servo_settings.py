"""Settings of the servos of an arm that decide how far it sags and stops short: they belong to its measurement."""

from __future__ import annotations

from lrm_math.errors import LrmError
from lrm_math.toml_file import StrictSchema

WORDS = {
    "p": "P gain", "i": "I gain", "d": "D gain", "torque_limit": "torque limit",
    "return_delay_us": "return delay (us)", "firmware": "firmware",
}  # fmt: skip
"""Settings, and what people call them."""


class JointServoSettings(StrictSchema):
    """Settings of one joint's servo, as its registers have them; None where it has no such register.

    `p`, `i`, `d`: gains of its position control. `torque_limit`: the greatest, in its own unit, that is kept without
    power. `return_delay_us`: until it answers. `firmware`: its version.
    """

    p: int | None = None
    i: int | None = None
    d: int | None = None
    torque_limit: int | None = None
    return_delay_us: int | None = None
    firmware: str | None = None


ServoSettings = dict[str, JointServoSettings]
"""Settings by the name of the joint."""


def settings_tables(settings: ServoSettings) -> dict[str, dict[str, object]]:
    """Settings as tables of a TOML file, without what is not known."""
    return {joint: joint_settings.model_dump(exclude_none=True) for joint, joint_settings in settings.items()}


def settings_difference(current: ServoSettings, then: ServoSettings) -> str:
    """Differences of the settings of joints that both know, in one line; empty if there are none."""
    differences = []
    for joint, before in then.items():
        for name, words in WORDS.items() if joint in current else ():
            was, here = getattr(before, name), getattr(current[joint], name)
            if was is not None and here is not None and was != here:
                differences.append(f"{joint}: {words} {here}, was {was}")
    return "; ".join(differences)


def require_same_settings(current: ServoSettings | None, then: ServoSettings | None, of: str, accept: str) -> None:
    """Raises `LrmError`: the servos are set otherwise than `of` says; `accept`: how a person says that it shall be so.

    Settings that one of both does not know are not compared.
    """
    if current and then and (words := settings_difference(current, then)):
        raise LrmError(
            f"the servos are not set as in {of}, so the arm sags and stops otherwise: {words}; set them back, measure "
            f"anew, or {accept}"
        )
