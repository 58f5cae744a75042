"""The two scales of judgement: the verdict of a study, and the support that a candidate or a step has in the data."""

from __future__ import annotations

from enum import StrEnum


class Verdict(StrEnum):
    """Verdict of a study: what its model misses."""

    EFFECT_MISSING = "effect_missing"
    EFFECT_DESCRIBES = "effect_describes"
    """An effect predicts better and shows no cause."""
    UNEXPLAINED_STRUCTURE = "unexplained_structure"
    UNPREDICTABLE = "unpredictable"
    """The error exceeds the noise, and nothing that was measured predicts it."""
    NOTHING_MISSING = "nothing_missing"
    NOISE_UNKNOWN = "noise_unknown"

    @property
    def quiet(self) -> bool:
        """Whether nothing was found."""
        return self in (Verdict.NOTHING_MISSING, Verdict.NOISE_UNKNOWN)

    @property
    def adds(self) -> bool:
        """Whether an effect is to be added."""
        return self in (Verdict.EFFECT_MISSING, Verdict.EFFECT_DESCRIBES)


class Support(StrEnum):
    """Support of an effect by the data; people read the last three as `attribution.term_of` words them.

    Of a candidate by the screening: the first four. Of one that was refitted or added: the last three.
    """

    IMPLAUSIBLE = "implausible"
    NO_EVIDENCE = "no_evidence"
    INDISTINGUISHABLE = "indistinguishable"
    """One of a class that these poses cannot distinguish."""
    SUPPORTED = "supported"
    DESCRIPTION = "description"
    """It predicts better, and shows no cause."""
    POSSIBLE_CAUSE = "possible_cause"
    """It may stand for another cause."""
    FINDING = "finding"
    """A cause that is shown."""
