"""Reasons: why a candidate is judged as it is, was refused, or cannot be tested: a kind, its numbers, its subject."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import NamedTuple

from lrm_ident.residual.free_functions import FreeFunction
from lrm_math.effects import Effect
from lrm_math.model.covariance import ImplausibleEstimate


class Estimate(NamedTuple):
    """Estimate of a parameter: its name with the unit, value and standard error in that unit."""

    name: str
    value: float
    error: float


@dataclass(frozen=True)
class Claim:
    """An effect that is claimed, with its estimates.

    Attributes:
        shape: of its parameters (SI), the chosen ones of a shape among them.
        largest_motion: of the TCP (m), where its claim states no estimate, as of a curve, and it was refitted.
        turns: by the name of its compliances, the turn that the usual load makes of a compliance of 1 (`usual_turns`).
    """

    effect: Effect
    estimates: tuple[Estimate, ...]
    shape: tuple[float, ...]
    largest_motion: float | None
    turns: Mapping[str, float] = field(default_factory=dict)


class ReasonKind(StrEnum):
    """Kinds of reasons, with what `numbers`, `names`, `subject` and `said` of a `Reason` are of each."""

    EXPLAINS = "explains"
    """Numbers: held-out RMS of the tip without and with it (m), where known. Names: it, equivalents. Subject: claim."""
    IMPLAUSIBLE = "implausible"
    """Number: what a parameter would have to be, in its unit. Name: the parameter. Against physics."""
    LITTLE = "little"
    """Numbers: held-out RMS of the tip with it and without (m), where known."""
    RESEMBLES = "resembles_structure"
    """Subject: a free function that explains far more."""
    REFUSED = "refused"
    """Number: held-out RMS of the tip that it would leave alone (m), where known. `because`: one of those below."""
    BEHIND = "explained_by_supported"
    """The supported effects explain the same."""
    CHANCE = "may_be_chance"
    UNCONFIRMED = "no_refit_confirmed"
    """No refit confirmed the effects that were selected."""
    NEAR_ZERO = "near_zero"
    """Refitted, its own parameters may all be zero, by the Wald test."""
    ABSURD = "absurd_estimate"
    """Subject: the estimate of the refit beyond what is plausible."""
    CURVED_IN_PART = "tracker_curve_leaves_more"
    """A curve of the tracker that leaves more than the noise."""
    NOT_REFITTED = "not_refitted"
    """Said: the error."""
    WORSE_DEPLOYED = "worse_as_deployed"
    NOT_BETTER_LATER = "later_poses_not_surely_better"
    """Numbers: RMS of later poses predicted from those before them, without and with it (m)."""
    FOLLOWED_NO_BETTER = "memory_followed_no_better"
    """What the arm did before predicts no better than a constant spring and offset in the place of the memory."""
    NOT_BETTER = "not_surely_better"
    """Numbers: held-out RMS before and after the refit (m)."""
    LESS_THAN_PROMISED = "less_than_promised"
    """Name: the refused effect that promised far more."""
    NO_DIAGNOSIS = "no_diagnosis"
    """A model with it could not be gone on with."""
    HARDLY_MOVES = "hardly_moves"
    """Number: the motion by a typical size (m), beyond what the fitted parameters explain."""
    MASSLESS = "massless"
    RIGID = "rigid"
    """Nothing of the model gives way to gravity."""
    UNLOADED = "unloaded"
    POSES = "poses"
    """Said: what these poses lack, by the effect itself."""


@dataclass(frozen=True)
class Reason:
    """A reason; `said`: words of an error or an effect. See `ReasonKind`."""

    kind: ReasonKind
    numbers: tuple[float, ...] = ()
    names: tuple[str, ...] = ()
    subject: Claim | FreeFunction | ImplausibleEstimate | None = None
    said: str = ""
    because: Reason | None = None
