"""Touched points: the TCP was where they are, on boards of which nothing says where they stood."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from lrm_ident.data.observations.positions import Positions
from lrm_ident.data.registration.similarity import Similarity, rigid_motion_between
from lrm_ident.data.rigid_motion import to_xyz_angles
from lrm_ident.data.source import Source
from lrm_math.effects import Effect
from lrm_math.effects.tracker_errors import TouchedBoard, TouchedPoint
from lrm_math.kinematics.poses import Poses
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import Model, model_of


@dataclass(frozen=True)
class TouchedFrame:
    """A thing that moves as a whole when it is put elsewhere: a board with touched points, or one lone point.

    `placement`: name of where it stood. `points`: names of its touched points. `turns`: whether these are several at
    known places, so that its attitude shows.
    """

    placement: str
    points: tuple[str, ...]
    turns: bool

    @property
    def words(self) -> str:
        """Its placement; with the point where that stands alone."""
        return self.placement if self.turns else f"{self.placement}, point {self.points[0]}"


@dataclass(frozen=True, eq=False)
class TouchedPoints(Positions):
    """Positions of touched points; `frames`: what `poses.placement` numbers from 1."""

    frames: tuple[TouchedFrame, ...] = ()
    words = "touched points"

    def rounding_doubts(self) -> Iterator[str]:
        """None: their places on the board are drawn, not read."""
        return iter(())

    def set_up(self, model: Model, poses: Poses, source: Source) -> Model:
        """Where what was touched stood; as it is where it was fitted to these.

        Each place is the one from which the model's own TCPs touch best, and its numbers are free parameters.
        """
        kinds = [TouchedBoard if frame.turns else TouchedPoint for frame in self.frames]
        needed = [kind(model.arm, f"placement{number}") for number, kind in enumerate(kinds, start=1)]
        keys = [key for effect in needed for key in effect.keys]
        there = set(model.keys)
        set_already = all(key in there and model.value(key) != 0.0 for key in keys)
        if set_already and model.fitted_to in (None, source.sha256):
            return model
        kept: list[Effect] = [effect for effect in model.effects if not isinstance(effect, TouchedPoint)]
        values = {key: model.value(key) for effect in kept for key in effect.keys}
        arm_only = replace(model_of(model.arm, kept, values), within=model.within)
        touching = solve_equilibrium(arm_only, poses).tcp
        for number, (effect, frame) in enumerate(zip(needed, self.frames, strict=True), start=1):
            rows = poses.placement == number
            motion = Similarity(np.eye(3), np.zeros(3))
            if rows is not None and np.any(rows):
                motion = rigid_motion_between(touching[rows], self.values[rows], frame.turns)
            numbers = (*motion.translation.tolist(), *to_xyz_angles(motion.rotation))
            values |= dict(zip(effect.keys, numbers, strict=False))
        kept_free = [key for key in model.free if key in values or key in keys]
        extended = replace(model_of(model.arm, (*kept, *needed), values), within=model.within, state=model.state)
        free = tuple(dict.fromkeys([*kept_free, *keys])) if model.free else ()
        return replace(extended, fitted_to=model.fitted_to, free=free)
