"""The correction as steps of LeRobot's processor pipelines, beside a robot that is left as it is.

`lrm_calibrated_action` goes last in the pipeline before the robot, `lrm_calibrated_observation` first in the one after
it. A model is of one arm: steps of one model, with the same options, share its motion in a process, so that an
observation knows from which side each joint came.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any
from weakref import WeakValueDictionary

import numpy as np
from lerobot.processor import ObservationProcessorStep, ProcessorStepRegistry, RobotActionProcessorStep

from lerobot_robot_lrm.corrected_arm import SUFFIX, CorrectedArm
from lerobot_robot_lrm.correction import Correction, places_of
from lrm_math.errors import LrmError

if TYPE_CHECKING:
    from lerobot.configs.types import PipelineFeatureType, PolicyFeature

ACTION, OBSERVATION = "lrm_calibrated_action", "lrm_calibrated_observation"
_arms: WeakValueDictionary[str, CorrectedArm] = WeakValueDictionary()


@dataclass
class CalibratedStep:
    """Options of both steps, as the JSON of a pipeline has them. Raises `LrmError`: no such model, or options of none.

    Attributes:
        model: the model file. payload_g: what the tool carries. keep: places whose offsets are no error of the arm.
        prefix: what stands before the joints' names, `left_` of two arms.
        half_range_deg: of joints that are commanded −100 … 100, the angle (deg) that 100 is; all others are in degrees.
        motion: file of a model of motion; "": none. lead: whether moving joints are commanded ahead by its dead times.
    """

    model: str
    payload_g: float = 0.0
    keep: str = "base,tool"
    prefix: str = ""
    half_range_deg: dict[str, float] = field(default_factory=dict)
    motion: str = ""
    lead: bool = False

    def __post_init__(self) -> None:
        self.arm = _arm_of(self)

    def get_config(self) -> dict[str, Any]:
        """The options."""
        return asdict(self)

    def transform_features(
        self, features: dict[PipelineFeatureType, dict[str, PolicyFeature]]
    ) -> dict[PipelineFeatureType, dict[str, PolicyFeature]]:
        """The features: names, shapes and units stay."""
        return features


@ProcessorStepRegistry.register(ACTION)
@dataclass
class CalibratedAction(CalibratedStep, RobotActionProcessorStep):
    """Wished angles in, commands out, within the bounds of `lerobot_robot_lrm.bounded`.

    A command counts as sent. The first one needs an observation beside it, as LeRobot's loops pass it.
    """

    def action(self, action: Mapping[str, Any]) -> dict[str, Any]:
        """The corrected action. Raises `LrmError`: a joint is missing or no number."""
        corrected = self.arm.corrected(action, self._seen)
        self.arm.follow(corrected, corrected.action)
        return corrected.action

    def reset(self) -> None:
        """Forgets the motion so far: the next action begins a new one where the arm is seen."""
        self.arm.forget()

    def _seen(self) -> Mapping[str, Any]:
        seen = self.transition.get("observation")
        if not isinstance(seen, Mapping):
            raise LrmError(f"{ACTION}: the first action needs the robot's observation beside it, (action, observation)")
        return seen


@ProcessorStepRegistry.register(OBSERVATION)
@dataclass
class CalibratedObservation(CalibratedStep, ObservationProcessorStep):
    """What the encoders read in, angles of the arm as drawn whose tool is where the real one is out."""

    def observation(self, observation: Mapping[str, Any]) -> dict[str, Any]:
        """The observation with true angles. Raises `LrmError`: a joint is missing or no number."""
        return self.arm.observed(observation)


def _arm_of(step: CalibratedStep) -> CorrectedArm:
    """The arm of a step, shared with those of the same options."""
    files = {key: file and str(Path(file).resolve()) for key, file in (("model", step.model), ("motion", step.motion))}
    name = repr(asdict(step) | files)
    arm = _arms.get(name)
    if arm is None:
        places = places_of(step.keep)
        correction = Correction.of_file(step.model, 1e-3 * step.payload_g, places, step.motion, step.lead)
        arm = CorrectedArm(step.model, correction, step.prefix)
        arm.scale = np.radians([_degrees_per_unit(step, name.removesuffix(SUFFIX)) for name in arm.keys])
        if unknown := sorted(step.half_range_deg.keys() - {*correction.names}):
            raise LrmError(f"half_range_deg: no joint '{unknown[0]}'; there is {', '.join(correction.names)}")
        _arms[name] = arm
    return arm


def _degrees_per_unit(step: CalibratedStep, joint: str) -> float:
    half = step.half_range_deg.get(joint.removeprefix(step.prefix), 100.0)
    if not 0.0 < abs(half) <= 720.0:
        raise LrmError(f"half_range_deg: {joint} = {half}; should be an angle in degrees that 100 is")
    return half / 100.0
