"""Settings of servos as LeRobot's motor buses name their registers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from lrm_math.arm.servo_settings import JointServoSettings, ServoSettings

REGISTERS = {
    "p": ("P_Coefficient", "Position_P_Gain"),
    "i": ("I_Coefficient", "Position_I_Gain"),
    "d": ("D_Coefficient", "Position_D_Gain"),
    "torque_limit": ("Max_Torque_Limit", "PWM_Limit"),
    "return_delay_us": ("Return_Delay_Time",),
}
"""Registers of Feetech and of Dynamixel servos by the fields of `JointServoSettings`."""
FIRMWARE = (("Firmware_Major_Version", "Firmware_Minor_Version"), ("Firmware_Version",))
DELAY_US = 2
"""Microseconds in one unit of the return delay."""


def settings_of(bus: Any, joints: Sequence[str]) -> ServoSettings:
    """Settings of the motors of some joints of a LeRobot bus; of those that are in its table of registers."""
    tables = getattr(bus, "model_ctrl_table", None)
    if tables is None:
        return {}
    settings: ServoSettings = {}
    for joint in joints:
        table, values = tables[bus.motors[joint].model], dict[str, Any]()
        for name, register_names in REGISTERS.items():
            if register := next((each for each in register_names if each in table), None):
                factor = DELAY_US if name == "return_delay_us" else 1
                values[name] = factor * int(bus.read(register, joint, normalize=False))
        for version in FIRMWARE:
            if all(register in table for register in version):
                numbers = (bus.read(register, joint, normalize=False) for register in version)
                values["firmware"] = ".".join(str(int(number)) for number in numbers)
        settings[joint] = JointServoSettings(**values)
    return settings
