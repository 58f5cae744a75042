"""A study of motion from files and to files: the recording, and the model with its history."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import tomli_w

from lrm_ident.data.atomic_write import write_text
from lrm_ident.fitting.progress import Progress, silent
from lrm_ident.measuring.motion.motion_study import MotionStudy
from lrm_ident.measuring.motion.moves import Moves, moves_of
from lrm_ident.measuring.recordings.lerobot import read_frames
from lrm_math.arm.arm import Arm
from lrm_math.errors import FileError
from lrm_math.model.reading import AngleUnit
from lrm_math.motion.motion_model import MotionFile, MotionStep, load_motion

DIGITS = 8


def read_moves(recording: Path, arm: Arm, angle_unit: AngleUnit | None = None, prefix: str | None = None) -> Moves:
    """The moves of a LeRobot dataset. Raises `FileError`."""
    return moves_of(read_frames(recording, arm, angle_unit, prefix), arm, recording)


def open_motion(
    model: Path,
    recording: Path,
    angle_unit: AngleUnit | None = None,
    prefix: str | None = None,
    progress: Progress = silent,
) -> tuple[MotionFile, MotionStudy]:
    """A model's file, and its study on a recording: fitted anew where that is not the one that it came from.

    Raises `FileError`.
    """
    file, known = load_motion(model)
    study = MotionStudy(known, read_moves(recording, known.arm, angle_unit, prefix), progress=progress)
    before = [(step.step, float(np.radians(step.held_out_deg or np.nan))) for step in file.history]
    fitted = study.refit(before)
    return file, fitted


def write_motion(study: MotionStudy, arm: str, path: Path) -> None:
    """Writes the model of a study. Raises `FileError`."""
    units = {
        key: parameter.si
        for effect in study.model.effects
        for key, parameter in zip(effect.keys, effect.parameters, strict=True)
    }
    tables = {
        "schema": "lrm/motion/1",
        "arm": arm,
        "recording": study.moves.name,
        "effects": [effect.name for effect in study.model.effects],
        "parameters": {key: _rounded(study.model.values[key] / si) for key, si in units.items()},
        "sigma": {key: _rounded(study.model.sigma.get(key, 0.0) / si) for key, si in units.items()},
        "history": [
            MotionStep(step=step, held_out_deg=_rounded(float(np.degrees(error)))).model_dump()
            for step, error in study.history
        ],
    }
    if not study.history:
        raise FileError(path, "", "nothing is fitted yet")
    write_text(path, tomli_w.dumps(tables))


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
