"""Reasons: why a candidate is judged as it is, was refused, or cannot be tested: a kind, and its numbers and names."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

from lrm_ident.data.wording import fall, in_mm

RIVALS_NAMED = 4


class ReasonKind(StrEnum):
    """Kinds of reasons, with what `Reason.numbers`, `Reason.names` and `Reason.said` are of each."""

    EXPLAINS = "explains"
    """Numbers: held-out RMS without and with it (m). Names: it, then its equivalents. Said: its claim."""
    IMPLAUSIBLE = "implausible"
    """Number: what a parameter would have to be, in its unit. Name: the parameter. Against physics."""
    LITTLE = "little"
    """Numbers: held-out RMS with it and without (m)."""
    RESEMBLES = "resembles_structure"
    """Name: a free function that explains far more."""
    REFUSED = "refused"
    """Number: held-out RMS that it would leave alone (m). `because`: one of those below."""
    BEHIND = "explained_by_supported"
    """The supported effects explain the same."""
    CHANCE = "may_be_chance"
    UNCONFIRMED = "no_refit_confirmed"
    """No refit confirmed the effects that were selected."""
    NEAR_ZERO = "near_zero"
    """Refitted, its own parameters may all be zero, by the Wald test."""
    ABSURD = "absurd_estimate"
    """Said: the estimate of the refit beyond what is plausible."""
    CURVED_IN_PART = "tracker_curve_leaves_more"
    """A curve of the tracker that leaves more than the noise."""
    NOT_REFITTED = "not_refitted"
    """Said: why."""
    WORSE_DEPLOYED = "worse_as_deployed"
    NOT_BETTER_LATER = "later_poses_not_surely_better"
    """Numbers: RMS of later poses predicted from those before them, without and with it (m)."""
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
    """A reason; `said`: words of another in it. See `ReasonKind`."""

    kind: ReasonKind
    numbers: tuple[float, ...] = ()
    names: tuple[str, ...] = ()
    said: str = ""
    because: Reason | None = None

    def __str__(self) -> str:
        return self.words(str)

    def words(self, named: Callable[[str], str]) -> str:
        """The reason in words, the effects in it as they are to be `named`."""
        sizes = [in_mm(number) for number in self.numbers]
        match self.kind:
            case ReasonKind.EXPLAINS:
                return self._explains(named)
            case ReasonKind.IMPLAUSIBLE:
                return f"{self.names[0]} would have to be {self.numbers[0]:.3g}, against physics"
            case ReasonKind.LITTLE:
                return f"it would leave {sizes[0]} of {sizes[1]} mm held out"
            case ReasonKind.RESEMBLES:
                return f"it only resembles {self.names[0]}, which explains far more"
            case ReasonKind.REFUSED:
                why = "" if self.because is None else f", but {self.because.words(named)}"
                return f"alone it would leave {sizes[0]} mm{why}"
            case ReasonKind.NOT_BETTER:
                return f"refitted, it does not surely predict better: {sizes[0]} mm held out, {sizes[1]} with it"
            case ReasonKind.NOT_BETTER_LATER:
                return (
                    "it fits this session, but from earlier poses it does not surely predict the later ones better: "
                    f"{sizes[0]} mm as deployed, {sizes[1]} with it"
                )
            case ReasonKind.LESS_THAN_PROMISED:
                return f"it saves far less than {named(self.names[0])} promised, which its refit refused"
            case ReasonKind.HARDLY_MOVES:
                size = f"a typical size moves the TCP by only {self.numbers[0] * 1e3:.2g} mm"
                return f"{size} beyond what the fitted parameters already explain"
            case _:
                return SENTENCES[self.kind].format(said=self.said)

    def _explains(self, named: Callable[[str], str]) -> str:
        (before, after), (effect, *equivalent) = self.numbers, self.names
        better = f"{self.said}: the held-out error falls {fall(before, after)} mm"
        if not equivalent:
            return better
        rivals = ", ".join(map(named, equivalent[:RIVALS_NAMED]))
        told = f"these poses cannot distinguish it from {rivals}; several may be present"
        return f"if it is {named(effect)}, {better}; {told}"


SENTENCES = {
    ReasonKind.BEHIND: "the effects above explain the same",
    ReasonKind.CHANCE: "that may be chance",
    ReasonKind.UNCONFIRMED: "no refit confirmed the effects that were selected",
    ReasonKind.NEAR_ZERO: "refitted, its own parameters may all be zero (Wald test)",
    ReasonKind.ABSURD: "refitted, {said}",
    ReasonKind.CURVED_IN_PART: "a curve of the tracker that leaves more than the noise stands for something else",
    ReasonKind.NOT_REFITTED: "it could not be refitted: {said}",
    ReasonKind.WORSE_DEPLOYED: "it fits this session, but the model as deployed would be worse",
    ReasonKind.NO_DIAGNOSIS: "a model with it could not be gone on with",
    ReasonKind.MASSLESS: "the arm's file gives no masses",
    ReasonKind.RIGID: "nothing of the model gives way to gravity; fit compliances first",
    ReasonKind.UNLOADED: "gravity puts no load on it",
    ReasonKind.POSES: "{said}",
}
