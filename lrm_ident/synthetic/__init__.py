"""Synthetic measurements by a second, independent model of the arm: screws, world-frame statics, Newton's method.

It shares no code with the model that is fitted, so that the two check each other.
"""

from .chain import name_base_errors
from .example import example, write_example
from .files import write
from .generate import Dataset, Schedule, even_schedule, measure, poses, simulate, true_state
from .hidden import Effect, EndLoad, JointLoad, Sight, Situation
from .hidden_bodies import BaseRocking, LinkBending, WrongBody, WrongLoad
from .hidden_joints import (
    CablePull,
    CoupledJoint,
    EccentricShaft,
    EntangledJoint,
    FrictionLag,
    HardeningSpring,
    OneSidedGain,
    SoftPlay,
)
from .hidden_sight import SkewTracker
from .hidden_times import BaseWarmUp, SessionStep, WarmUp
from .rig import Body, Link, Placement, Rig, load_arm
from .statics import TrueState
from .truth import Deviations, Truth

__all__ = [
    "BaseRocking",
    "BaseWarmUp",
    "Body",
    "CablePull",
    "CoupledJoint",
    "Dataset",
    "Deviations",
    "EccentricShaft",
    "Effect",
    "EndLoad",
    "EntangledJoint",
    "FrictionLag",
    "HardeningSpring",
    "JointLoad",
    "Link",
    "LinkBending",
    "OneSidedGain",
    "Placement",
    "Rig",
    "Schedule",
    "SessionStep",
    "Sight",
    "Situation",
    "SkewTracker",
    "SoftPlay",
    "TrueState",
    "Truth",
    "WarmUp",
    "WrongBody",
    "WrongLoad",
    "even_schedule",
    "example",
    "load_arm",
    "measure",
    "name_base_errors",
    "poses",
    "simulate",
    "true_state",
    "write",
    "write_example",
]
