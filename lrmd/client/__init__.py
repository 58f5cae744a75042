"""Client of the daemon `lrmd`, for rover software and scripts.

from lrmd.client import Rover

with Rover("rover") as rover, rover.control("my program"):
    rover.arm(where="stored")
    rover.move({"joint2": 0.5, "joint3": -0.2})  # rad
    print(rover.joints().q_rad)
"""

from lrmd.client.identity import DaemonRestarted, SeveralDaemons
from lrmd.client.rover import MotionInterrupted, Rover
from lrmd.client.session import NoReply, RequestRefused, RoverSession
from lrmd.messages.control import LEASE_LOST, InfoState, JointsState, ModeState, ThermalState
from lrmd.messages.kinematics import FkRequest, GoalEntry, IkAnswer, IkRequest, PlanRequest

__all__ = [
    "LEASE_LOST",
    "DaemonRestarted",
    "FkRequest",
    "GoalEntry",
    "IkAnswer",
    "IkRequest",
    "InfoState",
    "JointsState",
    "ModeState",
    "MotionInterrupted",
    "NoReply",
    "PlanRequest",
    "RequestRefused",
    "Rover",
    "RoverSession",
    "SeveralDaemons",
    "ThermalState",
]
