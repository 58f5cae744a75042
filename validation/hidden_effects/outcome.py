"""What the tool ended with on one data set, and what that is worth against the truth."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

from lrm_math.effects.reference import EffectRef
from validation.hidden_effects.case import Case
from validation.hidden_effects.catalogue import EVERY
from validation.hidden_effects.faults.measurement import NOISE_M

FLOOR_MM = NOISE_M * 1000.0 * math.sqrt(3.0)
NOTHING_MISSING, UNEXPLAINED = "nothing_missing", "unexplained_structure"
ALWAYS_TRUE = ("offsets", "compliance")
"""Every generated arm has these errors at all places."""
NEAR_FLOOR, NEAR_NOISE = 1.10, 1.15


class Judgement(StrEnum):
    """What an outcome is worth to somebody who believes it: see `Outcome.judgement`."""

    RIGHT = "right"
    HONEST = "honest"
    FALSE = "false"
    FAILED = "failed"


@dataclass(frozen=True)
class Outcome:
    """The tool's result on one data set.

    case: its key. steps: for each step its name (a form counts as the effect that it refines) and all that the data
    cannot tell from it; of `diagnose` the first class of the ranking alone. findings: whether each step is said to
    be a cause; the others only describe, or have rivals (of `diagnose`). ratio: RMS error over the noise, held out
    or at unseen poses. seconds: of `diagnose`, or of `auto`. right: names that are right by the seed; None: the
    case's. z: (estimate − truth) / standard error of the hidden parameters that were fitted. trouble: what failed,
    with the last line that the tool printed.
    """

    case: str
    seed: int
    steps: tuple[tuple[str, ...], ...] = ()
    verdict: str = ""
    ratio: float | None = None
    seconds: float | None = None
    trouble: str = ""
    findings: tuple[bool, ...] = ()
    right: tuple[str, ...] | None = None
    arm: str = ""
    z: tuple[float, ...] = ()

    @property
    def of(self) -> Case:
        """Outcome of a case."""
        return EVERY[self.case]

    @property
    def first_class(self) -> tuple[str, ...]:
        """The first name, and all that the data cannot tell from it."""
        return self.steps[0] if self.steps else ()

    @property
    def named(self) -> str:
        """The first name, or the verdict."""
        return self.first_class[0] if self.steps else self.verdict or "failed"

    @property
    def confident(self) -> bool:
        """Whether it named one effect at one place and no other."""
        return len(self.first_class) == 1

    @property
    def hit(self) -> bool:
        """The truth, or one of the truths, is in the first class; or rightly nothing, or nothing known, is missing."""
        truth = self.of.truth
        if truth is None:
            return self.verdict == UNEXPLAINED
        return bool(set(truth) & set(self.first_class)) if truth else self.verdict == NOTHING_MISSING

    @property
    def confidently_wrong(self) -> bool:
        """One name, and a wrong one."""
        return self.confident and not self.hit

    @property
    def truths_named(self) -> int:
        """Number of the hidden effects that a step names, or has in its class."""
        return sum(any(right & set(step) for step in self.steps) for right in self.of.truths or ())

    @property
    def all_named(self) -> bool:
        """Whether every hidden effect is named."""
        return not self.trouble and self.truths_named == len(self.of.truths or ())

    @property
    def false_names(self) -> tuple[str, ...]:
        """First name of each step in whose class there is no truth."""
        return tuple(step[0] for step in self.steps if self._is_false(step))

    @property
    def false_findings(self) -> tuple[str, ...]:
        """Those of them that are said to be a cause."""
        return tuple(step[0] for step in self._said if self._is_false(step))

    @property
    def near_floor(self) -> bool:
        """Whether hardly any error above the noise is left."""
        return self.ratio is not None and self.ratio <= NEAR_FLOOR

    @property
    def near_noise(self) -> bool:
        """Whether little error above the noise is left."""
        return self.ratio is not None and self.ratio <= NEAR_NOISE

    @property
    def wrong_form(self) -> bool:
        """All is named rightly, and yet error is left."""
        return self.all_named and not self.false_names and not self.near_floor

    @property
    def falsely_content(self) -> bool:
        """Whether it says that nothing is missing while much more than the noise is left."""
        return self.verdict == NOTHING_MISSING and self.ratio is not None and not self.near_noise

    @property
    def first_right(self) -> bool:
        """Whether the first new name, or one of its class, is right; where nothing is hidden, whether none is named."""
        new = self._new(self.steps)
        return bool(new and self._right & set(new[0])) if self._right else not new

    @property
    def honest(self) -> bool:
        """Whether the first new name is right, or where nothing is named the verdict an honest one."""
        return self._honest(self.steps)

    @property
    def honest_findings(self) -> bool:
        """The same of what is said to be a cause: descriptions name none."""
        return self._honest(self._said)

    def _honest(self, steps: tuple[tuple[str, ...], ...]) -> bool:
        new = self._new(steps)
        if new:
            return bool(set(new[0]) & self._right)
        content = self.verdict == NOTHING_MISSING and self.near_noise
        return content or self.verdict in self.of.verdicts

    @property
    def judgement(self) -> Judgement:
        """False: a cause is identified that is none, or nothing is said to be missing above the noise. Right: every
        hidden cause is named, or rightly none. Honest: what is between."""
        if self.trouble:
            return Judgement.FAILED
        if self.false_findings or self.falsely_content:
            return Judgement.FALSE
        if self.hidden is None:
            return Judgement.HONEST
        right = self.first_right if self.right else self.all_named
        return Judgement.RIGHT if (right if self.hidden else self.verdict == NOTHING_MISSING) else Judgement.HONEST

    @property
    def hidden(self) -> bool | None:
        """Whether an effect is hidden that has a name; None: one that no name fits."""
        if self.right or self.of.truths:
            return True
        return None if self.of.truths is None or (self.of.spoil and "healthy" not in self.of.name) else False

    @property
    def _right(self) -> set[str]:
        return set(self.of.truth or () if self.right is None else self.right)

    @property
    def _said(self) -> tuple[tuple[str, ...], ...]:
        return tuple(step for step, finding in zip(self.steps, self.findings, strict=True) if finding)

    def _is_false(self, step: tuple[str, ...]) -> bool:
        excused = step if self.right is None else step[:1]
        return not self._right & set(step) and not any(_is_always_true(name) for name in excused)

    @staticmethod
    def _new(steps: tuple[tuple[str, ...], ...]) -> list[tuple[str, ...]]:
        return [step for step in steps if not _is_always_true(step[0])]


def _is_always_true(name: str) -> bool:
    return EffectRef.parse(name).id in ALWAYS_TRUE
