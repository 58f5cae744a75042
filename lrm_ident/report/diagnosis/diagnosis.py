"""Report of `diagnose`: the verdict, the ranking, what the data cannot show."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence

from lrm_ident.data.wording import in_mm, named_joints, p_words, poses_words
from lrm_ident.diagnosis.attribution import (
    attribution_of,
    explained_by_first,
    unexplained_mean_square,
    unexplained_ratio,
)
from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport, RankedCandidate
from lrm_ident.diagnosis.judgement import Support, Verdict
from lrm_ident.diagnosis.reason import Reason, ReasonKind
from lrm_ident.diagnosis.screening.candidates import Refusal
from lrm_ident.report.diagnosis.advice import advice_of
from lrm_ident.report.diagnosis.conclusion import Conclusion, conclude
from lrm_ident.report.diagnosis.pose_facts import valid_where
from lrm_ident.report.diagnosis.standing import standing_of
from lrm_ident.report.document import Block, Document, Facts, ResultTable, room_below, section, stated
from lrm_ident.report.plain_names import plain_name
from lrm_ident.report.text.advice import advice_sentence
from lrm_ident.report.text.next_steps import UNKNOWN_FILES, CommandNames
from lrm_ident.report.text.poses import limitation_sentence
from lrm_ident.report.text.reasons import reason_words
from lrm_ident.report.text.residuals import (
    hint_sentence,
    noise_words,
    predictable_sentence,
    regime_sentence,
    regime_values,
    shifted_sentence,
)
from lrm_ident.report.text.variables import function_name, place_of
from lrm_ident.residual.free_functions import FreeFunction
from lrm_ident.residual.residual_patterns import ResidualPatterns
from lrm_math.arm.place_names import place_words
from lrm_math.effects import Effect
from lrm_math.model.deployed_model import CORRECTED, on_rover

SHOWN, REFUSED_SHOWN, RANKED, FEWEST = 4, 2, 30, 2
BAR = 16
HARDLY_SHOWS = "of typical size it would be too small to show in the remaining error"
BLACK_BOX = "black-box model"
MORAN = "spatial autocorrelation (Moran's I)"
ABOUT = "every candidate, its reason, and what these poses cannot show"


def diagnosis_document(report: DiagnosisReport, names: CommandNames = UNKNOWN_FILES) -> Document:
    """Result of `lrm-ident diagnose`, schema `lrm/diagnosis/1`. `names`: of the files in the commands to copy."""
    concluded = conclude(report, names)
    said = concluded.blocks()
    counts = attribution_of(report) in (Support.FINDING, Support.POSSIBLE_CAUSE)
    blocks = [*said, *(_candidates(report, room_below(said)) if counts else ())]
    details = [*_candidates(report, RANKED), *_details(report)]
    return Document(blocks, "lrm/diagnosis/1", _values(report, concluded), details=details, about=ABOUT)


def _values(report: DiagnosisReport, concluded: Conclusion) -> dict[str, object]:
    """Values for machines."""
    diagnosis, squares = report.diagnosis, explained_by_first(report)
    return {
        "conclusion": concluded,
        "poses": len(diagnosis.data),
        "parameters": len(diagnosis.fit.model.free),
        "error": {"fit": report.fitted, "held_out": report.held_out, "as_deployed": report.deployed},
        "noise_floor_rms_mm": _floor_mm(report),
        "noise_floor_source": diagnosis.floor.source,
        **left_values(report.patterns),
        "structure": {
            "moran_i": diagnosis.structure.moran_i,
            "p_value": diagnosis.structure.p_value,
            "order_p_value": diagnosis.structure.order_p_value,
        },
        "verdict": report.verdict,
        "share_of_excess": report.share,
        "unexplained_per_explained": None if squares is None else unexplained_ratio(*squares),
        "unexplained_mean_square_mm2": unexplained_mean_square(report) * 1e6,
        "misspecified": report.misspecified,
        "motion_bounds_rms_mm": {name: bound * 1e3 for name, bound in diagnosis.motion_bounds.items()},
        "approximate_of": "everything measured, weighted by its noise" if diagnosis.data.several_kinds else "TCP error",
        "ranking": [_advice(rank, advice, report) for rank, advice in enumerate(report.ranking[:RANKED], 1)],
        "unexplained": [
            {"acts_like": function_name(function), **_place_and_variables(function)}
            for function in diagnosis.unexplained.functions
        ],
        "anatomy": [
            {**_place_and_variables(function), "held_out_rms_mm": rms * 1e3} for function, rms in report.functions
        ],
        "outliers": diagnosis.outliers,
        "shifted": stated(diagnosis.shifted, shifted_sentence),
        "far_poses": [int(diagnosis.data.pose[row]) for row in report.far_rows],
        "audit": stated(report.limitations, limitation_sentence),
        "holds": valid_where(report),
        "hints": stated(report.hints, hint_sentence),
        "not_testable": [_refusal(effect, reason) for effect, reason in diagnosis.not_testable],
    }


def _place_and_variables(function: FreeFunction) -> dict[str, object]:
    return {"place": place_of(function), "follows": [covariate.symbol for covariate in function.covariates]}


def _candidates(report: DiagnosisReport, most: int) -> Iterator[Block]:
    """The supported candidates and the best causes among the others, with what each would leave if added.

    `most`: rows of the table; none where fewer than `FEWEST` fit.
    """
    if most < FEWEST:
        return
    before = report.held_out.rms
    counted = [candidate for candidate in report.ranking if candidate.verdict != Support.NO_EVIDENCE][:SHOWN]
    others = [candidate for candidate in report.ranking if candidate.verdict == Support.NO_EVIDENCE]
    causes = [candidate for candidate in others if not candidate.effect.is_free_form]
    rows = []
    for advice in [*counted, *causes[:REFUSED_SHOWN]][:most]:
        rms, approximate = advice.held_out_rms, "" if advice.exact else "≈ "
        bar = "█" * max(1, min(round(BAR * rms / before), BAR))
        rows.append((advice.name, f"{approximate}{in_mm(rms)}", bar, standing_of(report, advice)))
    if counted or report.verdict == Verdict.UNEXPLAINED_STRUCTURE:
        columns = ("candidate", "mm RMS|", f"bar: 0 to {in_mm(before)} mm", "status")
        yield ResultTable(columns, rows, "\nHeld-out error with each candidate added (≈: estimated without a refit)")


def _details(report: DiagnosisReport) -> list[Block]:
    """Evidence behind the conclusion, for a person."""
    diagnosis = report.diagnosis
    noise = noise_words(_floor_mm(report), diagnosis.floor.source, report.patterns)
    concentrated = f"\nWhere the error is concentrated{', outliers included' if diagnosis.outlier_distances else ''}"
    blocks: list[Block] = [
        f"\n{len(diagnosis.data)} poses, {len(diagnosis.fit.model.free)} parameters"
        f"{named_joints(diagnosis.fit.model.arm)}",
        Facts(
            (
                ("fit error", f"{in_mm(report.fitted.rms)} mm RMS"),
                ("noise", noise),
                ("residuals", f"{MORAN} {diagnosis.structure.moran_i:.2f}, p {p_words(diagnosis.structure.p_value)}"),
                (BLACK_BOX, predictable_sentence(report.patterns.predictable)),
            )
        ),
        *section(concentrated, map(regime_sentence, report.patterns.regimes)),
        *section("\nCandidates, one by one", _reasons(report)),
    ]
    if diagnosis.data.several_kinds:
        blocks.append(
            "≈ stands for all that was measured of a pose, each number weighed by its noise, as if it were a position: "
            "compare such figures with one another only. Figures without it are errors of the TCP."
        )
    if report.verdict == Verdict.UNEXPLAINED_STRUCTURE:
        functions = report.functions
        lines = (f"{function_name(function)} would leave {in_mm(rms)} mm held out" for function, rms in functions)
        blocks += section("\nStructure of the residuals: what it acts like, and what that depends on", lines)
    if diagnosis.outliers:
        blocks.append(f"\nOutliers, left out: {poses_words(diagnosis.outliers)}")
    blocks += section("\nPatterns in the estimates, which are no effects", map(hint_sentence, report.hints))
    blocks += section("\nWhat these poses cannot show", map(limitation_sentence, report.limitations))
    advice = advice_of(report)
    blocks += section("\nPoses that would distinguish the causes", () if advice is None else (advice_sentence(advice),))
    return [*blocks, *section("\nNot testable with these poses", untestable(diagnosis.not_testable))]


def _reasons(report: DiagnosisReport) -> Iterator[str]:
    """One line on every candidate that is ranked."""
    for advice in report.ranking[:RANKED]:
        name = "" if advice.verdict != Support.NO_EVIDENCE else f"{plain_name(advice.name)}: "
        yield f"{name}{reason_words(advice.reason, plain_name)}"


def _floor_mm(report: DiagnosisReport) -> float | None:
    floor = report.diagnosis.floor.rms
    return None if floor is None else floor * 1e3


def _refusal(effect: Effect, reason: Reason) -> dict[str, str]:
    needs = effect.about.needs or "poses where it moves the TCP more"
    why = {"reason": reason_words(reason), "kind": reason.kind}
    return {"effect": effect.id, "place": effect.place, **why, "would_need": needs}


def _advice(rank: int, advice: RankedCandidate, report: DiagnosisReport) -> dict[str, object]:
    effect = advice.effect
    return {
        "rank": rank,
        "effect": effect.id,
        "place": effect.place,
        "verdict": advice.verdict,
        "standing": standing_of(report, advice),
        "held_out_rms_mm": advice.held_out_rms * 1e3,
        "approximate": not advice.exact,
        "gain_mm": (report.held_out.rms - advice.held_out_rms) * 1e3,
        "p_value": min(1.0, report.diagnosis.adjusted_p_values[advice.scored.name]),
        "parameters": {name: {"value": value, "se": error} for name, value, error in advice.estimates},
        "indistinguishable_from": advice.equivalent,
        "online": on_rover(effect) in CORRECTED,
        "is_form": effect.is_free_form,
        "reason": advice.reason.kind,
        "why": reason_words(advice.reason, plain_name),
    }


def untestable(refused: Sequence[Refusal]) -> Iterator[str]:
    """One line for all places of an effect that the data cannot test for the same reason."""
    by_reason: dict[tuple[str, str], list[str]] = defaultdict(list)
    for effect, reason in refused:
        needs = f" (needs {effect.about.needs})" if effect.about.needs else ""
        hardly = reason.kind is ReasonKind.HARDLY_MOVES
        by_reason[effect.id, HARDLY_SHOWS if hardly else f"{reason_words(reason)}{needs}"].append(
            place_words(effect.place)
        )
    for (name, why), places in by_reason.items():
        yield f"{name} at {', '.join(places)}: {why}"


def left_values(patterns: ResidualPatterns) -> dict[str, object]:
    """The entries `nameless`, `noise_bound_rms_mm` and `regimes` of a diagnosis."""
    return {
        "nameless": patterns.predictable,
        "noise_bound_rms_mm": patterns.predictable.noise_bound * 1e3,
        "regimes": list(map(regime_values, patterns.regimes)),
    }
