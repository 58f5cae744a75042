"""Verdicts in words: headlines, why an effect identifies no cause, and why it is no more than a candidate."""

from __future__ import annotations

from collections.abc import Collection

from lrm_ident.data.wording import in_percent
from lrm_ident.diagnosis.attribution import unexplained_ratio
from lrm_ident.diagnosis.contradiction import NoCause, why_no_cause
from lrm_ident.diagnosis.judgement import Verdict
from lrm_ident.report.plain_names import plain_name
from lrm_ident.residual.thresholds import MAX_UNEXPLAINED_RATIO
from lrm_math.arrays import Array
from lrm_math.effects import Effect, variants

OTHERWISE = "what it follows also moves the arm elsewhere, or otherwise at other angles, so the cause may be another"
MISSING = "Missing from the model"
NONE_FOUND, NOT_IDENTIFIED = "No missing effect found", "No cause identified"
WHY_NOT = {
    Verdict.EFFECT_DESCRIBES: "the error is systematic, but these poses do not show why.",
    Verdict.UNEXPLAINED_STRUCTURE: "the error is systematic, but no known effect explains it.",
    Verdict.UNPREDICTABLE: "the error exceeds the noise, but nothing measured predicts it.",
}
"""Why no cause was identified."""
WHY_NO_CAUSE = {
    NoCause.FREE_FORM: WHY_NOT[Verdict.EFFECT_DESCRIBES],
    NoCause.FEW_ANGLES: "with so few angles of its joint, any function of the angle fits as well.",
    NoCause.LITTLE: "the best effect explains too little of the error to be called its cause.",
}
"""The same where an effect predicts better."""
LEFT = {
    Verdict.NOTHING_MISSING: "no further systematic error is seen.",
    Verdict.NOISE_UNKNOWN: "but the measurement noise is not known, so another effect may be hidden in it.",
}
"""What is left where no missing effect was found."""
CHANGES = "but the arm goes on changing: earlier poses predict the later ones worse."
"""Of an arm whose later poses are worse predicted from those before them than from all around."""
HEADLINES = {
    **{verdict: f"{NOT_IDENTIFIED}: {why}" for verdict, why in WHY_NOT.items()},
    Verdict.NOTHING_MISSING: f"{NONE_FOUND}: {LEFT[Verdict.NOTHING_MISSING]}",
    Verdict.NOISE_UNKNOWN: f"{NONE_FOUND}, {LEFT[Verdict.NOISE_UNKNOWN]}",
}
"""First lines of the verdicts that name no effect to add as a cause."""


def explains_words(share: float, floor_known: bool) -> str:
    """Share of the squared error that an effect explains."""
    return f"explains {in_percent(share)} % of the squared error{' above the noise' if floor_known else ''}"


def no_cause(effect: Effect, q: Array, present: Collection[str]) -> str:
    """Reason why an effect that predicts better identifies no new cause; arguments as of `why_no_cause`."""
    forms = variants(effect)
    match why_no_cause(effect, q, present):
        case NoCause.OTHER_FORM:
            there = (plain_name(name) for name in forms if name in present)
            return f"another formula for {' and '.join(there)}, no new cause"
        case NoCause.FREE_FORM:
            return f"an empirical term that may stand for {' or '.join(map(plain_name, forms))}"
        case NoCause.FEW_ANGLES:
            return "an empirical term: with so few angles any function of that joint's angle fits as well"
        case NoCause.LITTLE:
            return "an empirical term: it explains too little to be called a cause"


def why_candidate(replicates: bool, misspecified: bool, explained: float, remaining: float, noise_known: bool) -> str:
    """Why an effect is a candidate cause and no identified one.

    Args:
        replicates: whether both halves of the data choose it. misspecified: whether what it follows moves the arm
            otherwise, too. explained, left: squared errors that it explains, and that stay unexplained, in one unit.
    """
    if not replicates:
        return "the two halves of the data do not agree on it"
    if misspecified:
        return OTHERWISE
    if explained <= 0.0:
        return "it does not lower the error of the tip, so the cause may be another"
    ratio = unexplained_ratio(explained, remaining)
    if not noise_known:  # a third of all that stays was counted (`_above_noise`), so the limit of the whole is one
        most = ratio / MAX_UNEXPLAINED_RATIO
        return f"up to {most:.1f} times the squared error that it explains may be another's, as the noise is not known"
    stays = f"stays unexplained (limit {MAX_UNEXPLAINED_RATIO:.2f}), so the cause may be another"
    return f"{ratio:.1f} times the squared error that it explains {stays}"
