"""Sentences on the residuals: what predicts them, where they are largest, what the estimates show together."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

from lrm_ident.data.error_stats import ErrorStats, error_stats
from lrm_ident.data.wording import enumerate_words, in_mm, in_percent, poses_count, quantity
from lrm_ident.diagnosis.shifted_rows import ShiftedRows
from lrm_ident.report.text.variables import in_a_sentence
from lrm_ident.residual.deployment.deployed_error import DeployedError
from lrm_ident.residual.error_breakdown import HeldOutResidual
from lrm_ident.residual.parameter_hints import HintKind, ParameterHint
from lrm_ident.residual.picture.error_field import ArrowScale
from lrm_ident.residual.predictability import PredictableError
from lrm_ident.residual.regime import UNITS, Regime
from lrm_ident.residual.residual_patterns import ResidualPatterns
from lrm_ident.residual.scale_uncertainty import ScaleUncertainty
from lrm_math.arm.place_names import place_words
from lrm_math.effects.tracker_errors import FRAME_TYPICAL

UNSEEN = "the fit saw none of these poses: the model's own error is a held-out one"
BLACK_BOX = "a black-box model, which learns the pattern of the error but no cause,"
"""What *black-box model* means, where it stands first."""
NAMED = 3  # variables in a sentence
QUESTIONS = {
    ("angle", "end"): "Does a stop, a tight cable or another part touch there?",
    ("angle", "middle"): "Does a gear tooth or a cable catch there?",
    ("load", "end"): "Is the load's mass or centre wrong, or a spring not linear?",
    ("load", "middle"): "Was another load mounted than stated?",
    ("order", "end"): "Did the arm warm up, or something come loose or move?",
    ("order", "middle"): "Did something move, or did somebody touch the arm?",
}
"""What may have caused a regime, by the kind of its variable and where the interval lies."""
A_LENGTH = "A known length tells it: measure some distances, too (distance_mm), with a string or a ball bar."
WHY_OFF = "Measured wrongly, or the arm did not get there: measure there again"
"""What poses that are far off, and were left out, may be."""
NEIGHBOURS = {1: "before", -1: "after"}


def why_not_held_out(held_out: HeldOutResidual) -> str:
    """Why there is no held-out error."""
    return UNSEEN if held_out.unseen else held_out.reason


def predictable_brief(prediction: PredictableError) -> str:
    """What the black-box model reaches, and what that means."""
    reached = f"{in_mm(prediction.error.rms)} mm RMS"
    return f"{reached}: the error is systematic" if prediction.more_to_find else f"finds nothing systematic ({reached})"


def predictable_sentence(prediction: PredictableError) -> str:
    """Prediction of the residual by the black-box model, and what it depends on."""
    before, after = in_mm(error_stats(prediction.before).rms), in_mm(prediction.error.rms)
    if not prediction.more_to_find:
        return f"{BLACK_BOX} predicts no better ({after} mm RMS with it)"
    return (
        f"{BLACK_BOX} lowers the error from {before} to {after} mm RMS. So that part is systematic: it has a "
        f"cause. It depends on {enumerate_words(list(map(in_a_sentence, prediction.follows)), NAMED)}."
    )


def where(regime: Regime) -> str:
    """Interval of a regime, for instance `the angle of joint 2 < -40°`."""
    low, high = regime.low, regime.high
    if regime.quantity.kind == "order":
        if high is None:
            return f"measured after number {int(low or 0.0)}"
        return f"measured {f'up to number {int(high)}' if low is None else f'as numbers {int(low) + 1} to {int(high)}'}"
    name, unit = in_a_sentence(regime.quantity.variable), UNITS[regime.quantity.kind]
    if low is None:
        return f"{name} < {high:.4g}{unit}"
    return f"{name} > {low:.4g}{unit}" if high is None else f"{low:.4g}{unit} < {name} < {high:.4g}{unit}"


def _question(regime: Regime) -> str:
    """A question on what may have caused it."""
    return QUESTIONS[regime.quantity.kind, "end" if None in (regime.low, regime.high) else "middle"]


def regime_brief(regime: Regime) -> str:
    """The concentration, and a question on possible causes."""
    rms = f"{in_mm(regime.inside)} mm RMS, else {in_mm(regime.outside)} mm"
    return f"{regime.poses} poses ({where(regime)}): {rms}. {_question(regime)}"


def regime_sentence(regime: Regime) -> str:
    """Concentration of the error in the interval, and possible causes."""
    inside = f"{in_mm(regime.inside)} mm RMS in {regime.poses} poses ({where(regime)})"
    return (
        f"{inside}, {in_mm(regime.outside)} mm elsewhere; "
        f"{in_percent(regime.share)} % of the squared error lies there. {_question(regime)}"
    )


def regime_values(regime: Regime) -> dict[str, object]:
    """One entry of the table `regimes`."""
    ordered = regime.quantity.kind == "order"
    return {
        "quantity": "number in order" if ordered else regime.quantity.variable.symbol,
        "unit": UNITS[regime.quantity.kind].strip(),
        "low": regime.low,
        "high": regime.high,
        "poses": regime.poses,
        "share_of_squared_error": regime.share,
        "inside_rms_mm": regime.inside * 1e3,
        "outside_rms_mm": regime.outside * 1e3,
        "p_value": regime.p_value,
        "sentence": regime_sentence(regime),
    }


def scale_sentence(scale: ScaleUncertainty | None) -> str:
    """What stays open of a tracker's scale, and what would decide it; empty where nothing does."""
    if scale is None:
        return ""
    if scale.sd is None or scale.at_tip is None:
        along = "no pose distinguishes a scale along all axes together from longer links"
        return f"taken as right across that direction: {along}. {A_LENGTH}"
    return (
        f"known to ± {1e3 * scale.sd:.2g} mm/m along all axes together, ± {1e3 * scale.at_tip:.2g} mm at the deployed "
        f"tip. That is mostly its prior (typical: {1e3 * FRAME_TYPICAL:.2g} mm/m): a worse tracker may err by more. "
        f"No pose distinguishes it from longer links. {A_LENGTH}"
    )


def other_outliers_sentence(left_out: Collection[int], before: Collection[int]) -> str:
    """That the error after a step is of other poses than those before, since other ones are outliers then; empty where
    they are the same."""
    again, anew = len({*before} - {*left_out}), len({*left_out} - {*before})
    said = [
        f"{poses_count(count)} {one if count == 1 else more}"
        for count, one, more in ((again, "counts again", "count again"), (anew, "is left out", "are left out"))
        if count
    ]
    return f"{' and '.join(said)}: the errors before, and what it explains, are of other poses" if said else ""


def error_raised_sentence(before: DeployedError, after: DeployedError) -> str:
    """By how much a model errs more on the arm than an earlier one, held out; empty where it does not, or where the two
    errors are not of all poses both.

    After a restart the daemon knows neither the time since power-on nor the earlier moves, and keeps the state alone.
    """
    if before.fewer is not None or after.fewer is not None:
        return ""
    if more := _more(before.now, after.now):
        return f"{more} as deployed"
    restarted = after.time_unknown or after.now
    if more := _more(before.time_unknown or before.now, restarted):
        unknown = "earlier moves" if after.state is not None and after.state.memory else "time since power-on"
        return f"{more} after a restart of the arm's daemon, which then does not know the {unknown}"
    return ""


def law_may_be_wrong_sentence(laws: Sequence[str]) -> str:
    """What lrmd follows although more than the noise is left beside it (plain names of effects); empty where nothing.

    A law that the residual contradicts is an interpolation: it predicts the poses of its session, at their pace.
    """
    if not laws:
        return ""
    said = f"the arm's daemon follows {enumerate_words(laws, NAMED)}"
    return f"{said}. More than the noise is left, so the law may be wrong later or at another pace"


def _more(before: ErrorStats, after: ErrorStats) -> str:
    """Both errors, where the second is larger as it is printed; else empty."""
    without, with_it = in_mm(before.rms), in_mm(after.rms)
    return f"{with_it} mm RMS, before auto {without} mm," if float(with_it) > float(without) else ""


def hint_sentence(hint: ParameterHint) -> str:
    """A pattern in the estimates, as a question."""
    match hint.kind:
        case HintKind.SCALED_LENGTHS:
            share, error = hint.numbers
            size = f"{quantity(abs(share) * 100, error * 100)} % {'longer' if share > 0 else 'shorter'}"
            return f"all lengths are {size} than drawn, by the same share: the tracker's scale?"
        case HintKind.TURNED_FRAME:
            angle = math.degrees(hint.numbers[0])
            return f"the base's offsets look like a frame turned by {angle:.2f}° about the tracker's origin"
        case HintKind.FEW_LEVELS:
            place, *effects = hint.names
            what = f"{' and '.join(effects)} of {place_words(place)}"
            return f"{what} rest on {hint.numbers[0]:g} levels of the joint: at others it may err differently"


def shifted_sentence(rows: ShiftedRows) -> str:
    """Rows that carry the position of a neighbour."""
    neighbour = f"each has the position of the row {NEIGHBOURS[rows.shift]} it"
    return f"poses {rows.first} to {rows.last} look shifted by one row: {neighbour}"


def arrows_caption(scale: ArrowScale) -> str:
    """Caption of a picture of the errors."""
    arrows = f"Arrows: measured minus predicted, {scale.magnification:g} times enlarged"
    return f"Dots: measured positions of the tip. {arrows}; colours and lengths mean the same in all steps."


def noise_words(floor_mm: float | None, source: str, patterns: ResidualPatterns) -> str:
    """The noise floor, or its upper bound where it is not known."""
    if floor_mm is None:
        most = f"at most {in_mm(patterns.predictable.noise_bound)} mm"
        rest = ": a black-box model predicts the rest" if patterns.predictable.more_to_find else ""
        return f"not known ({most}{rest})"
    return f"{in_mm(floor_mm * 1e-3)} mm ({source})"
