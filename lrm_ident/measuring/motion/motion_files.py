"""A study of motion from files and to files: the recording, and the model with its history."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import tomli_w

from lrm_ident.data.atomic_write import write_text
from lrm_ident.fitting.progress import Progress, silent
from lrm_ident.measuring.motion.motion_study import MotionStudy
from lrm_ident.measuring.motion.moves import Moves, moves_of
from lrm_ident.measuring.motion.tip_moves import tip_moves
from lrm_ident.measuring.recordings.command_log import CommandLog, read_command_log
from lrm_ident.measuring.recordings.lerobot import read_frames
from lrm_ident.measuring.recordings.mcap_file import SUFFIX as MCAP
from lrm_ident.measuring.recordings.mcap_file import joint_track
from lrm_ident.measuring.recordings.readers import read_take
from lrm_ident.measuring.recordings.take import TipTrack
from lrm_math.arm.arm import Arm
from lrm_math.arm.arm_digest import arm_sha256
from lrm_math.arm.arm_file import arm_name_for
from lrm_math.arm.servo_settings import settings_tables
from lrm_math.errors import FileError
from lrm_math.model.model import Model, model_of
from lrm_math.model.model_file import load_model
from lrm_math.model.reading import AngleUnit, Reading
from lrm_math.motion.motion_model import SCHEMA, MotionFile, load_motion

DIGITS = 8
LOGS = (".csv", ".mcap")


@dataclass(frozen=True)
class MotionSource:
    """What an arm's moves are read from.

    Attributes:
        recording: a LeRobot dataset, or a log of commands (CSV or MCAP). tip: what a tracker recorded meanwhile; None:
            it is in the log's own file. tool, base: bodies of it. topic, encoders: of commands, and of what encoders
            read, in an MCAP file. rotation: as in `RecordingFile`. rest: a fitted model of poses; None: the nominal
            arm. angle_unit, prefix: see `read_frames`.
    """

    recording: Path
    tip: Path | None = None
    tool: str | None = None
    base: str | None = None
    topic: str | None = None
    encoders: str | None = None
    rotation: str | None = None
    rest: Path | None = None
    angle_unit: AngleUnit | None = None
    prefix: str | None = None

    def moves(self, arm: Arm) -> Moves:
        """The moves. Raises `FileError`, `UnknownName`."""
        if self.encoders is not None and (self.recording.suffix != MCAP or self.tip is not None):
            what = "names a topic of an MCAP file of commands and encoders"
            raise FileError(self.recording, "--encoders", what, "leave it out, or leave --tip out")
        if self.recording.suffix not in LOGS:
            if self.tip is not None:
                what = "is read beside a log of commands, and this is none"
                raise FileError(self.recording, "--tip", what, f"a {' or '.join(LOGS)}")
            self._require_no_other_than("prefix")
            return moves_of(read_frames(self.recording, arm, self.angle_unit, self.prefix), arm, self.recording)
        log = read_command_log(self.recording, arm, Reading(angle_unit=self.angle_unit), self.topic)
        moves = self._of_log(log, arm)
        return replace(moves, notices=(*log.notices, *moves.notices))

    def _of_log(self, log: CommandLog, arm: Arm) -> Moves:
        """The moves of a log of commands. Raises `FileError`."""
        of_log = ("topic",) if self.recording.suffix == MCAP else ()
        if self.encoders is not None:
            self._require_no_other_than(*of_log, "encoders")
            return moves_of(log.beside(*joint_track(self.recording, arm, self.encoders)), arm, self.recording)
        if self.tip is None and (encoders := log.encoders()) is not None:
            self._require_no_other_than(*of_log)
            return replace(moves_of(encoders, arm, self.recording), servos=log.servos)
        tip = self.tip or self.recording
        if tip.suffix != MCAP and self.tip is None:
            raise FileError(
                self.recording,
                "--tip",
                "a log of commands alone shows no motion",
                "--tip and the tracker's file, or columns q1_meas_deg, ...",
            )
        self._require_no_other_than(*of_log, "tip", "tool", "base", "rotation", "rest")
        take = read_take(tip, self.rotation)
        track = TipTrack.of(take.path, take.pair(self.tool, self.base))
        return tip_moves(log, track, self._at_rest(arm))

    def _require_no_other_than(self, *used: str) -> None:
        """Raises `FileError`: an option is stated that this kind of recording has no use for."""
        for option in ("tip", "tool", "base", "topic", "encoders", "rotation", "rest", "prefix"):
            if option not in used and getattr(self, option) is not None:
                raise FileError(
                    self.recording, f"--{option}", "has no use for a recording of this kind", "leave it out"
                )

    def _at_rest(self, arm: Arm) -> Model:
        if self.rest is None:
            return model_of(arm, ())
        rest_model = load_model(self.rest)
        if rest_model.arm != arm:
            raise FileError(self.rest, "--rest", f"is a model of {rest_model.arm.name}", f"one of {arm.name}")
        return rest_model


def open_motion(
    model: Path,
    source: MotionSource,
    progress: Progress = silent,
) -> tuple[MotionFile, MotionStudy]:
    """A model's file, and its study on a recording: fitted anew where that is not the one that it came from.

    Raises `FileError`.
    """
    file, motion_model = load_motion(model)
    study = MotionStudy(motion_model, source.moves(motion_model.arm), progress=progress)
    scale = study.moves.scale
    before = [(step.step, (step.held_out_deg or step.held_out_mm or np.nan) / scale) for step in file.history]
    fitted = study.refit(before)
    return file, fitted


def write_motion(study: MotionStudy, arm: str, path: Path) -> None:
    """Writes the model of a study; a path of an `arm` is stored relative to the file's folder. Raises `FileError`."""
    units = {
        key: parameter.si
        for effect in study.model.effects
        for key, parameter in zip(effect.keys, effect.parameters, strict=True)
    }
    tables = {
        "schema": SCHEMA,
        "arm": arm_name_for(arm, path.parent),
        "arm_sha256": arm_sha256(study.model.arm),
        "recording": study.moves.name,
        **({} if study.moves.servos is None else {"servos": settings_tables(study.moves.servos)}),
        "effects": [effect.name for effect in study.model.effects],
        "parameters": {key: _rounded(study.model.values[key] / si) for key, si in units.items()},
        "sigma": {key: _rounded(study.model.sigma.get(key, 0.0) / si) for key, si in units.items()},
        "history": [
            {"step": step, f"held_out_{study.moves.unit}": _rounded(error * study.moves.scale)}
            for step, error in study.history
        ],
    }
    if not study.history:
        raise FileError(path, "", "nothing is fitted yet")
    write_text(path, tomli_w.dumps(tables))


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
