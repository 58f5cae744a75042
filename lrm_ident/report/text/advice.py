"""Sentences on what to measure next: poses that distinguish causes, and where candidate poses come from."""

from __future__ import annotations

from collections.abc import Sequence

from lrm_ident.design.advice import Advice, MeasuringPlan
from lrm_ident.design.expected_lead import NEEDED, CausePair
from lrm_ident.design.pose_design import ClearAngles
from lrm_ident.residual.thresholds import EQUIVALENCE_COSINE, Z_THRESHOLD

NO_POSE = "No pose that keeps clear was found, so no poses can be proposed."


def plan_options(plan: MeasuringPlan) -> str:
    """The plan as options of `design`."""
    return f"--levels any --loads-g {','.join(_grams(plan))} -n {len(plan.poses)}"


def _grams(plan: MeasuringPlan) -> list[str]:
    return [f"{1e3 * load:g}" for load in plan.loads]


def _plan_words(plan: MeasuringPlan) -> str:
    carrying = "without a load" if plan.loads == (0.0,) else f"with {' and '.join(_grams(plan))} g"
    waiting = f", half of them held for {plan.hold:g} s before the reading" if plan.hold else ""
    count = f"{len(plan.poses)} poses at any angles, {carrying}"
    return f"{count}, each joint coming from both sides, in random order{waiting}"


def hopeless_words(advice: Advice) -> str:
    """That no poses distinguish the causes that move the tip most alike."""
    if advice.plan is None:
        return NO_POSE
    worst = advice.alike[0]
    return f"No poses tried can distinguish {worst.there} from {worst.instead}"


def provided_words(pairs: Sequence[CausePair]) -> str:
    """On what it depends that poses distinguish these pairs: ", if …", or empty."""
    form = next((pair for pair in pairs if pair.distinguishable_if_exact and not pair.distinguishable), None)
    return "" if form is None else f", if the formula of {form.there} or {form.instead} is exact"


def advice_sentence(advice: Advice) -> str:
    """What to measure and what it will tell; or that nothing will, and why."""
    if advice.plan is None:
        return hopeless_words(advice)
    how, provided = _plan_words(advice.plan), provided_words(advice.pairs)
    if advice.works:
        least = min(pair.lead for pair in advice.pairs)
        return (
            f"{how}, distinguish them{provided}: the true cause is expected to lead by {least:.1f} standard errors "
            f"or more ({Z_THRESHOLD:g} are needed)."
        )
    worst = advice.alike[0]
    why = (
        f"they move the tip alike (cosine {worst.cosine:.2f})"
        if worst.cosine > EQUIVALENCE_COSINE
        else f"it would lead by {worst.lead:.1f} standard errors, and {NEEDED:.1f} must be expected"
    )
    none = f"{hopeless_words(advice)}: {why}"
    return f"{none}; {how}, distinguish the others{provided}." if advice.helps else f"{none}, with {how}."


def candidates_words(origin: ClearAngles) -> str:
    """Where candidate poses come from."""
    what = f"{origin.tried} random poses" if origin.random else f"{origin.tried} combinations of levels"
    words = f"{origin.clear} of {what} keep clear"
    if origin.seen is not None:
        words += f", {origin.seen} of these show the board to the camera"
    if origin.drawn is not None:
        words += f"; {origin.drawn} of them, drawn at random, are looked at"
    bare = "; the arm has no shapes, so only the lines between its joints were held to the rules"
    return words + (bare if origin.shapeless else "")
