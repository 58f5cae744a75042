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
NOTHING_MISSING = "nothing_missing"
ALWAYS_TRUE = ("offsets", "compliance")
"""Every generated arm has these errors at all places."""
NEAR_NOISE = 1.15


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
    def all_named(self) -> bool:
        """Whether a step names every hidden effect, or has it in its class."""
        return all(any(right & set(step) for step in self.steps) for right in self.of.truths or ())

    @property
    def false_names(self) -> tuple[str, ...]:
        """First name of each step in whose class there is no truth."""
        return tuple(step[0] for step in self.steps if self._is_false(step))

    @property
    def false_findings(self) -> tuple[str, ...]:
        """Those of them that are said to be a cause."""
        said = zip(self.steps, self.findings, strict=True)
        return tuple(step[0] for step, finding in said if finding and self._is_false(step))

    @property
    def falsely_content(self) -> bool:
        """Whether it says that nothing is missing while much more than the noise is left."""
        return self.verdict == NOTHING_MISSING and self.ratio is not None and self.ratio > NEAR_NOISE

    @property
    def first_right(self) -> bool:
        """Whether the first new name, or one of its class, is right."""
        new = [step for step in self.steps if not _is_always_true(step[0])]
        return bool(new and self._right & set(new[0]))

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

    def _is_false(self, step: tuple[str, ...]) -> bool:
        excused = step if self.right is None else step[:1]
        return not self._right & set(step) and not any(_is_always_true(name) for name in excused)


def _is_always_true(name: str) -> bool:
    return EffectRef.parse(name).id in ALWAYS_TRUE
