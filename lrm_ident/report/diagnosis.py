"""What people read of a search: the verdict first, then the ranking, then what the data cannot show."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

import numpy as np
from rich.console import Console

from lrm_ident.data.error_stats import figures
from lrm_ident.diagnosis.add_effect import Step
from lrm_ident.diagnosis.diagnose import ABOVE_FLOOR
from lrm_ident.diagnosis.diagnosis_report import Report
from lrm_ident.diagnosis.inject_recover import Trial
from lrm_ident.report.fit import table
from lrm_math.arm.arm_file import load_arm, shipped_arms
from lrm_math.effects import Effect, Parameter

SHOWN, REFUSED_SHOWN, RIVALS_SHOWN = 8, 4, 4
VERDICTS = {
    "effect_missing": "An effect is missing.",
    "nothing_missing": "Nothing is missing: what is left looks like the noise of the measurement.",
    "unexplained_structure": "There is structure left that no known effect explains.",
}
OUTCOMES = {"found": "● found", "one of a class": "◐ one of a class", "missed": "○ missed", "wrong": "✕ wrong"}
MARKS = {"supported": "● supported", "indistinguishable": "◐ one of a class", "no_evidence": "○ no evidence"}


def print_report(console: Console, report: Report) -> None:
    """The result of `lrm-ident diagnose`."""
    found = report.diagnosis
    floor = "unknown" if found.floor.rms is None else f"{found.floor.rms * 1e3:.2f} mm ({found.floor.source})"
    console.print(_verdict(report), style="bold")
    console.print(
        f"{len(found.data)} poses, {len(found.fit.model.free)} parameters: RMS {report.fit.rms * 1e3:.2f} mm in the "
        f"fit, {report.held_out.rms * 1e3:.2f} mm held out; noise floor {floor}; "
        f"likeness of neighbours (Moran's I) {found.structure.moran_i:.2f}, p = {found.structure.p_value:.1g}",
        highlight=False,
    )
    _print_ranking(console, report)
    if report.verdict == "unexplained_structure" and found.anatomy:
        console.print("\nIts anatomy: what it acts like, and what that follows", style="bold")
        for function, rms in found.anatomy:
            console.print(f"  {function.name} would leave {rms * 1e3:.2f} mm held out", highlight=False)
    if found.outliers:
        console.print(f"\nOutliers, left out: poses {', '.join(map(str, found.outliers))}", highlight=False)
    if report.traps:
        console.print("\nWhat these data cannot show", style="bold")
        for trap in report.traps:
            console.print(f"  {trap}", highlight=False, soft_wrap=True)
    _print_untestable(console, found.not_testable)
    console.print(f"\nNext poses: {report.hint}", highlight=False)


def _verdict(report: Report) -> str:
    """The verdict in words; nothing found above the noise floor is not the same as nothing missing."""
    floor, sigma = report.diagnosis.floor.sd, report.diagnosis.fit.sigma
    if report.verdict == "nothing_missing" and floor is not None and sigma > ABOVE_FLOOR * floor:
        return (
            f"No effect can be shown to be missing, yet the error is {sigma / floor:.2f} times the noise: "
            "there are too few poses to tell, or the noise is larger than said."
        )
    return VERDICTS[report.verdict]


def _print_ranking(console: Console, report: Report) -> None:
    ranking = table("", ">", "effect", "verdict", ">held out mm", "why")
    named = sum(advice.verdict != "no_evidence" for advice in report.ranking)
    for rank, advice in enumerate(report.ranking[: min(named, SHOWN) + REFUSED_SHOWN], start=1):
        approximate = "" if advice.exact else "≈ "
        rms = f"{approximate}{advice.held_out_rms * 1e3:.2f}"
        ranking.add_row(str(rank), advice.scored.name, MARKS[advice.verdict], rms, advice.why)
    console.print(ranking)


def _print_untestable(console: Console, refused: tuple[tuple[Effect, str], ...]) -> None:
    by_reason: dict[tuple[str, str], list[str]] = defaultdict(list)
    for effect, reason in refused:
        general = reason.replace(effect.place, "the joint")
        short = f"{general} (needs {effect.needs})" if effect.needs else general
        if "typical size" in reason:
            short = "its typical size would hardly show in what is left now"
        by_reason[effect.id, short].append(effect.place)
    if by_reason:
        console.print("\nNot testable", style="bold")
        for (name, reason), places in by_reason.items():
            console.print(f"  {name} at {', '.join(places)}: {reason}", highlight=False, soft_wrap=True)


def print_step(console: Console, number: int, step: Step, held_out: float) -> None:
    """One line of the fall, and what could not be told from the effect added."""
    bar = "█" * int(np.clip(round(held_out * 1e3 * 3), 1, 24))
    errors = f"fit {figures(step.fit.residual).rms * 1e3:5.2f}   held out ≈ {held_out * 1e3:5.2f} mm  {bar}"
    line = f"{number:3d}  {step.added or 'start':28s} {len(step.fit.model.free):3d} parameters   {errors}"
    console.print(line, highlight=False, soft_wrap=True)
    if step.rivals:
        more = f" and {len(step.rivals) - RIVALS_SHOWN} more" if len(step.rivals) > RIVALS_SHOWN else ""
        rivals = ", ".join(step.rivals[:RIVALS_SHOWN]) + more
        console.print(f"       or {rivals}: these data cannot tell", highlight=False, soft_wrap=True, style="dim")


def print_effect(console: Console, kind: type[Effect], in_full: bool) -> None:
    """What one effect is; in full, with everything that there is to know."""
    console.print(f"[bold]{kind.id}[/bold]: {kind.cause}", highlight=False, soft_wrap=True)
    console.print(f"    {kind.formula}", highlight=False, soft_wrap=True, markup=False)
    if not in_full:
        return
    online = "the rover can compensate it" if kind.online else "explains a measurement session; never deployed silently"
    console.print(
        f"    source: {kind.source}\n    needs: {kind.needs or 'nothing special'}\n    {online}", highlight=False
    )
    arm = load_arm(next(iter(shipped_arms())))
    places = kind.places(arm)
    console.print(f"    places on {arm.name}: {', '.join(places)}", highlight=False, soft_wrap=True, markup=False)
    console.print(f"    acts on: {_acts_on(kind(arm, places[0]))}", highlight=False, soft_wrap=True, markup=False)
    console.print(f"    parameters, for instance at {places[0]}:", highlight=False, markup=False)
    for parameter in kind(arm, places[0]).parameters:
        console.print(f"      {_parameter(parameter)}", highlight=False, soft_wrap=True, markup=False)


def _acts_on(effect: Effect) -> str:
    """The motions it causes, or the other hook that it uses, at one place."""
    moves = [f"turns or shifts {', '.join(effect.moves)}"] if effect.moves else []
    feels = [f"feels the load on {', '.join(effect.feels)}"] if effect.feels else []
    pushes = [f"loads {', '.join(effect.pushes)}"] if effect.pushes else []
    weighs = ["changes the weight of a body"] if effect.weighs else []
    return "; ".join([*moves, *feels, *pushes, *weighs]) or "what the tracker sees"


def _parameter(parameter: Parameter) -> str:
    typical = f"typically {parameter.typical / parameter.si:g}"
    bounds = f", at least {parameter.lower / parameter.si:g}" if np.isfinite(parameter.lower) else ""
    shape = "" if parameter.fixed is None else ", a shape: searched, not fitted"
    return f"{parameter.name}: {parameter.meaning} ({typical}{bounds}{shape})"


def print_trials(console: Console, trials: Sequence[Trial], refused: Sequence[tuple[Effect, str]]) -> None:
    """The result of `lrm-ident selftest`: what would be named for each truth."""
    confusion = table("What would be named", "hidden", ">moves TCP mm", "outcome", "named")
    for trial in trials:
        named = ", ".join(trial.named[:4]) + (f" and {len(trial.named) - 4} more" if len(trial.named) > 4 else "")
        confusion.add_row(trial.truth, f"{trial.moved * 1e3:.2f}", OUTCOMES[trial.outcome], named or trial.verdict)
    console.print(confusion)
    _print_untestable(console, tuple(refused))
    count = {outcome: sum(trial.outcome == outcome for trial in trials) for outcome in OUTCOMES}
    console.print(f"\n{len(trials)} effects: " + ", ".join(f"{number} {outcome}" for outcome, number in count.items()))
