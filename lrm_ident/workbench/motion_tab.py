"""The workbench's tab of motion: its page, made once, when somebody first opens it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path


@dataclass(frozen=True)
class MotionTab:
    """A motion model's file and the recording that it is shown on."""

    model: Path
    recording: Path

    @cached_property
    def page(self) -> str:
        """The page's text, after some seconds of fitting. Raises `LrmError`."""
        from lrm_ident.measuring.motion.motion_files import MotionSource, open_motion
        from lrm_ident.measuring.motion.motion_study import MotionStudy
        from lrm_ident.workbench.motion_page import motion_page

        _, study = open_motion(self.model, MotionSource(self.recording))
        return motion_page(MotionStudy.of(study.moves).fit(), study, str(self.model))
