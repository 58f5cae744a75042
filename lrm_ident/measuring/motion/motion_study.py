"""`MotionStudy`: a model of motion on the moves of a recording, whose methods are the steps of an identification.

The steps and words are those of `Study` for poses; a joint's effects are fitted apart from those of other joints, whose
motion enters by the loads along the path.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from lrm_ident.diagnosis.attribution import attribute_steps
from lrm_ident.diagnosis.evidence import Evidence
from lrm_ident.diagnosis.judgement import Support
from lrm_ident.fitting.progress import Progress, silent
from lrm_ident.measuring.motion.joint_fit import JointFit, fit_joint
from lrm_ident.measuring.motion.moves import Moves
from lrm_ident.measuring.motion.screening import (
    JointScreening,
    is_plausible,
    is_worse,
    screen_joint,
    with_effect,
    without_effect,
)
from lrm_ident.residual.thresholds import FLOOR_RATIO
from lrm_math.errors import LrmError
from lrm_math.motion.base import MotionEffect
from lrm_math.motion.effects import MOTION_EFFECTS
from lrm_math.motion.motion_model import MotionCatalogue, MotionModel, effect_of

MOST_ADDED = 5
"""Effects that `auto` adds to one joint: a bound on time."""


@dataclass(frozen=True, eq=False)
class JudgedEffect:
    """What the finished model says of one of its effects.

    Attributes:
        kind: `finding`, `possible_cause` or `description`, as for poses. without: held-out error without it (rad RMS).
        rivals: names of effects in whose company the model predicts as well without it.
    """

    effect: MotionEffect
    kind: Support
    without: float
    rivals: tuple[str, ...]

    @property
    def identified(self) -> bool:
        """Whether its cause is identified."""
        return self.kind == Support.FINDING and not self.rivals


@dataclass(frozen=True, eq=False)
class MotionStudy:
    """A model of motion on moves.

    Attributes:
        fits: of each joint, once fitted. history: name of each step and its held-out error (rad or m RMS, all joints).
    """

    model: MotionModel
    moves: Moves
    catalogue: MotionCatalogue = MOTION_EFFECTS
    fits: tuple[JointFit, ...] = ()
    history: tuple[tuple[str, float], ...] = ()
    progress: Progress = field(default=silent)

    @staticmethod
    def of(moves: Moves, catalogue: MotionCatalogue = MOTION_EFFECTS, progress: Progress = silent) -> MotionStudy:
        """The nominal model on moves: nothing is fitted yet."""
        return MotionStudy(MotionModel.nominal(moves.arm, catalogue), moves, catalogue, progress=progress)

    def fit(self, step: str = "fit") -> MotionStudy:
        """Fits all joints, along the path that the model before predicts, and once more along the new one."""
        return self._refitted(range(self.moves.arm.dof), twice=True)._noted(step)

    def refit(self, history: Iterable[tuple[str, float]]) -> MotionStudy:
        """The study of a model from a file: its effects, fitted to these moves from its values."""
        return replace(self._refitted(range(self.moves.arm.dof), twice=True), history=tuple(history))

    def screen(self, joints: Iterable[int] | None = None) -> tuple[JointScreening, ...]:
        """Tries every effect at every joint (or `joints`, from 0)."""
        fitted = self if self.fits else self.fit()
        tried = len(self.catalogue) * self.moves.arm.dof
        chosen = list(range(self.moves.arm.dof) if joints is None else joints)
        out = []
        for number, joint in enumerate(chosen):
            self.progress("trying every effect at every joint", number, len(chosen))
            out.append(screen_joint(fitted.fits[joint], float(self.moves.noise[joint]), self.catalogue, tried))
        self.progress("trying every effect at every joint", len(chosen), len(chosen))
        return tuple(out)

    def add(self, name: str) -> MotionStudy:
        """Adds an effect `id@joint` and refits. Raises `LrmError`: unknown, there already, or not testable here."""
        fitted = self if self.fits else self.fit()
        effect = effect_of(self.moves.arm, name, self.catalogue)
        if effect.name in {effect_present.name for effect_present in fitted.model.effects}:
            raise LrmError(f"{effect.name} is in the model already")
        reason = effect.missing_excitation(self.moves.drive(effect.joint))
        if reason is not None:
            raise LrmError(f"{effect.name}: these moves cannot show it: {reason}")
        return fitted._with(effect)._noted(f"add {effect.name}")

    def auto(self, on_step: Callable[[str, MotionStudy], object] = lambda *_: None) -> MotionStudy:
        """Adds at every joint the best effect, until none predicts held-out moves better; drops what is superfluous."""
        fitted = self if self.fits else self.fit()
        on_step("fit", fitted)
        open_joints = list(range(self.moves.arm.dof))
        for _ in range(MOST_ADDED):
            screenings = fitted.screen(open_joints)
            open_joints = [
                joint for joint, screening in zip(open_joints, screenings, strict=True) if screening.first is not None
            ]
            for by_joint in sorted(screenings, key=lambda joint_screening: -joint_screening.saved):
                if by_joint.first is not None:
                    fitted = fitted._with(by_joint.first.effect)._noted(f"add {by_joint.first.effect.name}")
                    on_step(fitted.history[-1][0], fitted)
            if not open_joints:
                break
        for effect in fitted.model.added:
            without = fitted._without(effect)
            if not is_worse(without.fits[effect.joint], fitted.fits[effect.joint]):
                fitted = without._noted(f"drop {effect.name}")
                on_step(fitted.history[-1][0], fitted)
        return fitted

    def judged(self) -> tuple[JudgedEffect, ...]:
        """What the model says of each added effect: cause, possible cause, or description; and what else it may be."""
        out: list[JudgedEffect] = []
        for joint in range(self.moves.arm.dof):
            added = [effect for effect in self.model.of_joint(joint) if not effect.basic]
            if added:
                out += self._judged_at(joint, added)
        return tuple(out)

    def _judged_at(self, joint: int, added: list[MotionEffect]) -> list[JudgedEffect]:
        fit, noise = self.fits[joint], float(self.moves.noise[joint])
        bare = {effect.name: without_effect(fit, effect) for effect in added}
        added = sorted(added, key=lambda effect: -bare[effect.name].held_out_rms)
        unexplained = max(fit.held_out_rms**2 - (FLOOR_RATIO * noise) ** 2, 0.0)
        steps = [
            (
                bare[effect.name].held_out_rms ** 2 - fit.held_out_rms**2,
                Evidence(describes=not (effect.names_a_cause and is_plausible(fit, effect))),
            )
            for effect in added
        ]
        kinds = attribute_steps(steps, unexplained)
        return [
            JudgedEffect(
                effect, kind.kind, bare[effect.name].held_out_rms, self._rivals(fit, effect, bare[effect.name])
            )
            for effect, kind in zip(added, kinds, strict=True)
        ]

    def _rivals(self, fit: JointFit, effect: MotionEffect, bare: JointFit) -> tuple[str, ...]:
        """Effects that predict as well in its place."""
        present = {effect_present.id for effect_present in fit.effects}
        out = []
        for kind in self.catalogue:
            other = kind(effect.arm, effect.place)
            if kind.id in present or not kind.names_a_cause or other.missing_excitation(fit.data.drive) is not None:
                continue
            instead = with_effect(bare, other)
            if instead.squares < 1.5 * fit.squares and not is_worse(instead, fit):
                out.append(other.name)
        return tuple(out)

    def _with(self, effect: MotionEffect) -> MotionStudy:
        before = self.fits[effect.joint]
        return self._replaced(with_effect(before, effect))._refitted(self.moves.fitted_with(effect.joint))

    def _without(self, effect: MotionEffect) -> MotionStudy:
        return self._replaced(without_effect(self.fits[effect.joint], effect))

    def _replaced(self, fit: JointFit) -> MotionStudy:
        joint = fit.effects[0].joint
        fits = tuple(fit if number == joint else joint_fit for number, joint_fit in enumerate(self.fits))
        return replace(self, model=self.model.with_joint(fit.effects, fit.by_key, fit.sigma), fits=fits)

    def _refitted(self, joints: Iterable[int], twice: bool = False) -> MotionStudy:
        """Joints fitted again along the path that the model predicts."""
        model, fits, moves = self.model, list(self.fits), self.moves
        chosen = list(joints)
        for turn in range(2 if twice else 1):
            moves, model = moves.tuned(model) if fits or moves.unit == "mm" else (moves, model)
            done: list[JointFit] = []
            for number, data in enumerate(moves.measured(model, chosen)):
                self.progress("fitting the joints", turn * len(chosen) + number, (2 if twice else 1) * len(chosen))
                done.append(fit_joint(model.of_joint(chosen[number]), data, model.values, moves.evaluations))
            for joint, fit in zip(chosen, done, strict=True):
                model = model.with_joint(fit.effects, fit.by_key, fit.sigma)
                if fits:
                    fits[joint] = fit
            fits = fits or done
        self.progress("fitting the joints", 1, 1)
        return replace(self, model=model, fits=tuple(fits), moves=moves)

    def _noted(self, step: str) -> MotionStudy:
        return replace(self, history=(*self.history, (step, self.held_out_rms)))

    @cached_property
    def held_out_rms(self) -> float:
        """rad or m, RMS over all joints, at moves that the fit did not use."""
        return float(np.sqrt(np.mean([fit.held_out_rms**2 for fit in self.told_apart])))

    @property
    def told_apart(self) -> tuple[JointFit, ...]:
        """Fits whose errors are of different readings: every joint's encoder, or the one tip."""
        return self.fits if self.moves.unit == "deg" else self.fits[:1]

    def added_at(self, number: int) -> tuple[MotionEffect, ...]:
        """Effects that were added to the servos' response, of those that one of `told_apart` reads, by its number."""
        of_all = self.moves.unit != "deg"
        return tuple(effect for effect in self.model.added if of_all or effect.joint == number)
