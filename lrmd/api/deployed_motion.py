"""The model of motion that the daemon uses: loaded from its file, checked, deployed over zenoh and taken back.

Theory of operation: as with the model of poses, a text that comes over zenoh is tried in a process of its own and kept
as a version. Nothing moves by it: the way of a motion is fixed when it is ordered, so that another model counts from
the next one on. `[motion] shaping` of the configuration shapes nothing until there is a model.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from lrm_math.arm.arm_digest import WHAT_COUNTS, arm_sha256
from lrm_math.arm.arm_file import arm_of
from lrm_math.errors import FileError
from lrm_math.motion.motion_model import MotionFile, MotionModel, motion_of
from lrm_math.motion.settling import LONGEST_S, settling
from lrm_math.toml_file import read_toml
from lrmd.api.model_reload import ActiveModel
from lrmd.api.model_trial import check_in_trial
from lrmd.config import Config
from lrmd.control.motion_predictor import MotionPredictor
from lrmd.ik.deployed_model import content_sha256, named_arm
from lrmd.persistence.deployed_models import DeployedVersions, ModelKind

MOVES, SPEED = 4, 1.0
"""Moves over which a model is tried, and their speed (rad/s)."""


def predictor_of(config: Config, path: Path | None) -> MotionPredictor | None:
    """That of a motion model's file; None without one. Raises `FileError`: the file cannot be used for this arm."""
    if path is None:
        return None
    file = read_toml(path, MotionFile)
    over_zenoh = DeployedVersions.of(config, ModelKind.MOTION).holds(path)
    arm = named_arm(config, path, file.arm) if over_zenoh else arm_of(path, file.arm)
    if arm.name != config.arm.name or arm_sha256(arm) != arm_sha256(config.arm):
        what = f"a motion model of {arm.name}, whose {WHAT_COUNTS} differ from those of {config.arm.name}"
        raise FileError(path, "arm", what, f"one of {config.arm.name} as this daemon's arm file has it")
    return MotionPredictor(config, motion_of(path, file, arm), str(path), content_sha256(path))


def check_comes_to_rest(config: Config, path: Path | None) -> None:
    """Raises `FileError` if a model cannot be used, or its tip still swings long after some move of a sample."""
    arm, within = config.arm, config.motion.within_mm
    model = MotionModel.nominal(arm) if path is None else motion_of(path, read_toml(path, MotionFile), arm)
    predictor_of(config, path)
    lower, upper = (np.array([getattr(joint, side) for joint in arm.joints]) for side in ("lower", "upper"))
    for start, goal in lower + (upper - lower) * np.random.default_rng(0).random((MOVES, 2, arm.dof)):
        if settling(model, start, goal, SPEED, within * 1e-3).seconds >= LONGEST_S:
            words = f"{LONGEST_S:g} s after a move the tip is not within {within:g} mm of its rest yet"
            raise FileError(path or "nominal", "parameters", words, "an arm that comes to rest; look at the damping")


class ActiveMotionModel:
    """The model of motion in use as `predictor`; None without one. `models`: with which it takes turns."""

    def __init__(self, config: Config, models: ActiveModel) -> None:
        """Raises `LrmError` for a file that cannot be used."""
        self._config, self._models = config, models
        self._versions = DeployedVersions.of(config, ModelKind.MOTION)
        with self._versions.undo_named():
            self.predictor = predictor_of(config, self._versions.in_use)

    def deploy(self, text: str) -> None:
        """Keeps a motion model's text as a new version and uses it. Raises `LrmError`; then nothing has changed."""
        with self._models.one_at_a_time():
            with self._versions.new(text) as path:
                predictor = self._tried(path)
            self.predictor = predictor

    def undo(self) -> None:
        """Goes back to the version before. Raises `LrmError`: nothing was deployed, or that one cannot be used."""
        with self._models.one_at_a_time():
            with self._versions.undone() as before:
                predictor = self._tried(before)
            self.predictor = predictor

    def _tried(self, path: Path | None) -> MotionPredictor | None:
        check_in_trial(self._config, path, check_comes_to_rest)
        return predictor_of(self._config, path)
