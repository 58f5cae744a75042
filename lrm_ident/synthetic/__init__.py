"""Synthetic measurements by a second, independent model of the arm: screws, world-frame statics, Newton's method.

It shares no code with the model that is fitted, so that the two check each other.
"""

from .example import example, write_example
from .files import write
from .generate import Dataset, Schedule, even_schedule, measure, poses, simulate, true_state
from .hidden import Effect, EndLoad, JointLoad, LinkBending, Sight, Situation, SoftPlay
from .rig import Body, Link, Placement, Rig, load_arm
from .statics import TrueState
from .truth import Deviations, Truth

__all__ = [
    "Body",
    "Dataset",
    "Deviations",
    "Effect",
    "EndLoad",
    "JointLoad",
    "Link",
    "LinkBending",
    "Placement",
    "Rig",
    "Schedule",
    "Sight",
    "Situation",
    "SoftPlay",
    "TrueState",
    "Truth",
    "even_schedule",
    "example",
    "load_arm",
    "measure",
    "poses",
    "simulate",
    "true_state",
    "write",
    "write_example",
]
