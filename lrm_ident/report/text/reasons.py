"""Reasons in words: why a candidate is judged as it is, was refused, or cannot be tested."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from lrm_ident.data.wording import fall, in_mm
from lrm_ident.diagnosis.reason import Claim, Reason, ReasonKind
from lrm_ident.report.text.claims import claim_sentence
from lrm_ident.report.text.variables import function_name
from lrm_ident.residual.free_functions import FreeFunction
from lrm_math.model.covariance import ImplausibleEstimate

if TYPE_CHECKING:  # loaded by `propose` alone
    from lrm_ident.diagnosis.symbolic_regression.proposal import LawProposal

RIVALS_NAMED = 4
SENTENCES = {
    ReasonKind.BEHIND: "the effects above explain the same",
    ReasonKind.CHANCE: "that may be chance",
    ReasonKind.UNCONFIRMED: "no refit confirmed the effects that were selected",
    ReasonKind.NEAR_ZERO: "refitted, its own parameters may all be zero (Wald test)",
    ReasonKind.CURVED_IN_PART: "a curve of the tracker that leaves more than the noise stands for something else",
    ReasonKind.NOT_REFITTED: "it could not be refitted: {said}",
    ReasonKind.WORSE_DEPLOYED: "it fits this session, but the model as deployed would be worse",
    ReasonKind.FOLLOWED_NO_BETTER: "at this pace a constant spring predicts as well: it shows no memory",
    ReasonKind.NO_DIAGNOSIS: "a model with it could not be gone on with",
    ReasonKind.MASSLESS: "the arm's file gives no masses",
    ReasonKind.RIGID: "nothing of the model gives way to gravity; fit compliances first",
    ReasonKind.UNLOADED: "gravity puts no load on it",
    ReasonKind.POSES: "{said}",
}


NO_LAW: Mapping[str, str] = {
    "like_noise": "the best of {} laws is no better than on pure noise",
    "not_predicted": "no law predicts poses that were not used to choose it",
    "not_better_refitted": "no law lowers the held-out error once everything is refitted",
}


def no_law_words(proposal: LawProposal) -> str:
    """Why no law is proposed; empty where one is."""
    return "" if proposal.reason is None else NO_LAW[proposal.reason].format(proposal.tried)


def reason_words(reason: Reason, named: Callable[[str], str] = str) -> str:
    """A reason in words, the effects in it as they are to be `named`."""
    sizes = [in_mm(number) for number in reason.numbers]
    match reason.subject:
        case Claim() as claim:
            return _explains(reason, claim_sentence(claim), named)
        case FreeFunction() as function:
            return f"it only resembles {function_name(function)}, which explains far more"
        case ImplausibleEstimate() as estimate:
            return f"refitted, {estimate.sentence}"
    match reason.kind:
        case ReasonKind.IMPLAUSIBLE:
            return f"{reason.names[0]} would have to be {reason.numbers[0]:.3g}, against physics"
        case ReasonKind.LITTLE:
            return f"it would leave {' of '.join(sizes)} mm held out" if sizes else "it explains too little"
        case ReasonKind.REFUSED:
            why = "" if reason.because is None else f", but {reason_words(reason.because, named)}"
            return f"{f'alone it would leave {sizes[0]} mm' if sizes else 'alone it would help'}{why}"
        case ReasonKind.NOT_BETTER:
            return f"refitted, it does not surely predict better: {sizes[0]} mm held out, {sizes[1]} with it"
        case ReasonKind.NOT_BETTER_LATER:
            return (
                "it fits this session, but from earlier poses it does not surely predict the later ones better: "
                f"{sizes[0]} mm as deployed, {sizes[1]} with it"
            )
        case ReasonKind.LESS_THAN_PROMISED:
            return f"it saves far less than {named(reason.names[0])} promised, which its refit refused"
        case ReasonKind.HARDLY_MOVES:
            size = f"a typical size moves the TCP by only {reason.numbers[0] * 1e3:.2g} mm"
            return f"{size} beyond what the fitted parameters already explain"
        case _:
            return SENTENCES[reason.kind].format(said=reason.said)


def _explains(reason: Reason, claim: str, named: Callable[[str], str]) -> str:
    effect, *equivalent = reason.names
    better = f"{claim}: the held-out error falls {fall(*reason.numbers)} mm" if reason.numbers else claim
    if not equivalent:
        return better
    rivals = ", ".join(map(named, equivalent[:RIVALS_NAMED]))
    told = f"these poses cannot distinguish it from {rivals}; several may be present"
    return f"if it is {named(effect)}, {better}; {told}"
