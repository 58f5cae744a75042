"""Knowledge of a measuring set-up that a model needs beside the arm: the anchor of distances, the places touched."""

from __future__ import annotations

from lrm_ident.data.measurements import Measurements
from lrm_math.arm.arm import Arm
from lrm_math.model.model import Model, model_of


def with_set_up(model: Model, data: Measurements) -> Model:
    """The model, knowing what these data need of their set-up. Raises `FileError`."""
    for observation in data.observations:
        model = observation.set_up(model, data.poses, data.source)
    return model


def nominal_arm(arm: Arm, data: Measurements) -> Model:
    """The arm as drawn, without effects but those that the data's set-up needs. Raises `FileError`."""
    return with_set_up(model_of(arm, ()), data)
