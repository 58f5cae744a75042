"""Synthetic measurements from an independent model of the arm: twists, statics in world axes, Newton's method.

It shares no code with the fitted model, so that each verifies the other.
"""

from .arm_description import ArmDescription, load_arm
from .chain import base_displacement_to_deviations
from .example import example, write_example
from .files import write
from .generate import Dataset, Schedule, even_schedule, measure, random_poses, simulate, true_state
from .ground_truth import Deviations, GroundTruth
from .hidden_bodies import WrongBody, WrongLoad
from .hidden_effect import CommandedPoses, EndLoad, HiddenEffect, JointLoad
from .hidden_joints import (
    CablePull,
    CoupledJoint,
    EccentricShaft,
    FastClock,
    FormulaJoint,
    HardeningSpring,
    HardStop,
    OneSidedGain,
    SharedCable,
    SoftPlay,
    ToothRipple,
)
from .hidden_links import (
    AxialFloat,
    BaseRocking,
    BaseWarmUp,
    HingedLink,
    LiftingBase,
    LinkBending,
    RadialFloat,
    TiltingBearing,
)
from .hidden_memory import (
    DahlLoop,
    FrictionLag,
    JointSlip,
    SessionStep,
    StickSlip,
    TwoStageWarmUp,
    WarmUp,
)
from .hidden_tracker import SkewTracker
from .statics import TrueState

__all__ = [
    "ArmDescription",
    "AxialFloat",
    "BaseRocking",
    "BaseWarmUp",
    "CablePull",
    "CommandedPoses",
    "CoupledJoint",
    "DahlLoop",
    "Dataset",
    "Deviations",
    "EccentricShaft",
    "EndLoad",
    "FastClock",
    "FormulaJoint",
    "FrictionLag",
    "GroundTruth",
    "HardStop",
    "HardeningSpring",
    "HiddenEffect",
    "HingedLink",
    "JointLoad",
    "JointSlip",
    "LiftingBase",
    "LinkBending",
    "OneSidedGain",
    "RadialFloat",
    "Schedule",
    "SessionStep",
    "SharedCable",
    "SkewTracker",
    "SoftPlay",
    "StickSlip",
    "TiltingBearing",
    "ToothRipple",
    "TrueState",
    "TwoStageWarmUp",
    "WarmUp",
    "WrongBody",
    "WrongLoad",
    "base_displacement_to_deviations",
    "even_schedule",
    "example",
    "load_arm",
    "measure",
    "random_poses",
    "simulate",
    "true_state",
    "write",
    "write_example",
]
