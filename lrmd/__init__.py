"""Daemon of the robot arm, in four processes: ramp (serial port), api (state machine), ik (kinematics), router.

What rover software needs is here by name (`lrmd.client`), imported when it is first used: the ramp stays light.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lrmd.client import (
        FkRequest,
        GoalEntry,
        IkRequest,
        MotionInterrupted,
        NoReply,
        PlanRequest,
        RequestRefused,
        Rover,
    )

__all__ = [
    "FkRequest",
    "GoalEntry",
    "IkRequest",
    "MotionInterrupted",
    "NoReply",
    "PlanRequest",
    "RequestRefused",
    "Rover",
]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'lrmd' has no attribute '{name}'")
    return getattr(import_module("lrmd.client"), name)
