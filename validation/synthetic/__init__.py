"""Synthetic measurements from an independent model of the arm: twists, statics in world axes, Newton's method.

It shares no code with the fitted model, so that each verifies the other.
"""

from .arm_description import ArmDescription as ArmDescription
from .arm_description import load_arm as load_arm
from .chain import base_displacement_to_deviations as base_displacement_to_deviations
from .example import example as example
from .example import write_example as write_example
from .files import write as write
from .generate import Dataset as Dataset
from .generate import Schedule as Schedule
from .generate import even_schedule as even_schedule
from .generate import measure as measure
from .generate import random_poses as random_poses
from .generate import simulate as simulate
from .generate import true_state as true_state
from .ground_truth import Deviations as Deviations
from .ground_truth import GroundTruth as GroundTruth
from .hidden_bodies import WrongBody as WrongBody
from .hidden_bodies import WrongLoad as WrongLoad
from .hidden_effect import CommandedPoses as CommandedPoses
from .hidden_effect import EndLoad as EndLoad
from .hidden_effect import HiddenEffect as HiddenEffect
from .hidden_effect import JointLoad as JointLoad
from .hidden_joints import CablePull as CablePull
from .hidden_joints import CoupledJoint as CoupledJoint
from .hidden_joints import EccentricShaft as EccentricShaft
from .hidden_joints import FastClock as FastClock
from .hidden_joints import FormulaJoint as FormulaJoint
from .hidden_joints import HardeningSpring as HardeningSpring
from .hidden_joints import HardStop as HardStop
from .hidden_joints import OneSidedGain as OneSidedGain
from .hidden_joints import SharedCable as SharedCable
from .hidden_joints import SoftPlay as SoftPlay
from .hidden_joints import ToothRipple as ToothRipple
from .hidden_links import AxialFloat as AxialFloat
from .hidden_links import BaseRocking as BaseRocking
from .hidden_links import BaseWarmUp as BaseWarmUp
from .hidden_links import HingedLink as HingedLink
from .hidden_links import LiftingBase as LiftingBase
from .hidden_links import LinkBending as LinkBending
from .hidden_links import RadialFloat as RadialFloat
from .hidden_links import TiltingBearing as TiltingBearing
from .hidden_memory import DahlLoop as DahlLoop
from .hidden_memory import FrictionLag as FrictionLag
from .hidden_memory import JointSlip as JointSlip
from .hidden_memory import SessionStep as SessionStep
from .hidden_memory import StickSlip as StickSlip
from .hidden_memory import TwoStageWarmUp as TwoStageWarmUp
from .hidden_memory import WarmUp as WarmUp
from .hidden_tracker import SkewTracker as SkewTracker
from .statics import TrueState as TrueState
