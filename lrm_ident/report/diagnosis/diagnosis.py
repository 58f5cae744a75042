"""Report of `diagnose`: the verdict, the ranking, what the data cannot show."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Collection, Iterator, Sequence

import numpy as np

from lrm_ident.data.wording import enumerate_words, in_mm, in_percent, named_joints, p_words, poses_words
from lrm_ident.diagnosis.attribution import unexplained_mean_square, unexplained_ratio
from lrm_ident.diagnosis.contradiction import can_be_contradicted
from lrm_ident.diagnosis.diagnose import Diagnosis
from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport, RankedCandidate
from lrm_ident.report.document import Block, Document, FoldedSection, ResultTable, heading, section
from lrm_ident.report.plain_names import in_words, plain_name
from lrm_ident.residual.data_audit import where_it_holds
from lrm_ident.residual.residual_patterns import ResidualPatterns
from lrm_ident.residual.thresholds import MAX_UNEXPLAINED_RATIO, MIN_GAIN
from lrm_math.arm.arm import JointLimits
from lrm_math.arrays import Array
from lrm_math.effects import Effect, compensable, variants

SHOWN, REFUSED_SHOWN, RANKED = 8, 4, 30
VERDICTS = {
    "effect_missing": "An effect is missing.",
    "effect_describes": "An effect predicts better, but only describes: it shows no new cause.",
    "nothing_missing": "Nothing is missing: what is left looks like the noise of the measurement.",
    "unexplained_structure": "There is structure left that no known effect explains.",
    "unpredictable": "Something is missing that follows no pose, load or order we know",
    "noise_unknown": "Nothing that we know predicts what is left. Whether something is missing cannot be known",
}
MARKS = {
    "supported": "● supported",
    "indistinguishable": "◐ one of a class",
    "no_evidence": "○ no evidence, or no need beside those above",
}


def diagnosis_document(report: DiagnosisReport) -> Document:
    """Result of `lrm-ident diagnose`, schema `lrm/diagnosis/1`."""
    return Document(_blocks(report), "lrm/diagnosis/1", _values(report))


def _values(report: DiagnosisReport) -> dict[str, object]:
    """Values for machines."""
    found = report.diagnosis
    return {
        "poses": len(found.data),
        "parameters": len(found.fit.model.free),
        "error": {"fit": report.fit, "held_out": report.held_out, "as_deployed": report.deployed},
        "noise_floor_rms_mm": _floor_mm(report),
        "noise_floor_source": found.floor.source,
        **left_values(report.left),
        "structure": {
            "moran_i": found.structure.moran_i,
            "p_value": found.structure.p_value,
            "order_p_value": found.structure.order_p_value,
        },
        "verdict": report.verdict,
        "share_of_excess": report.share,
        "unexplained_per_explained": unexplained_ratio(report),
        "unexplained_mean_square_mm2": unexplained_mean_square(report) * 1e6,
        "motion_bounds_rms_mm": {name: bound * 1e3 for name, bound in found.motion_bounds.items()},
        "approximate_of": "everything measured, weighted by its noise" if found.data.several_kinds else "TCP error",
        "ranking": [_advice(rank, advice, report) for rank, advice in enumerate(report.ranking[:RANKED], 1)],
        "unexplained": [
            {"acts_like": function.name, "place": function.place, "follows": function.covariates}
            for function in found.unexplained.functions
        ],
        "anatomy": [
            {"place": function.place, "follows": function.covariates, "held_out_rms_mm": rms * 1e3}
            for function, rms in found.unexplained.ranking
        ],
        "outliers": found.outliers,
        "shifted": [one.sentence for one in found.shifted],
        "far_poses": [int(found.data.pose[row]) for row in report.far_rows],
        "audit": report.limitations,
        "holds": _holds(report),
        "hints": report.hints,
        "not_testable": [_refusal(effect, reason) for effect, reason in found.not_testable],
        "next_poses_hint": in_words(report.hint),
    }


def _blocks(report: DiagnosisReport) -> list[Block]:
    """Blocks for a person."""
    found = report.diagnosis
    noise = noise_words(_floor_mm(report), found.floor.source, report.left)
    blocks: list[Block] = [
        heading(_verdict(report)),
        f"{len(found.data)} poses, {len(found.fit.model.free)} parameters: RMS {in_mm(report.fit.rms)} mm in the "
        f"fit, {in_mm(report.held_out.rms)} mm held out, {in_mm(report.deployed.now.rms)} mm as deployed; "
        f"noise floor {noise}; "
        f"likeness of neighbours (Moran's I) {found.structure.moran_i:.2f}, p {p_words(found.structure.p_value)}"
        f"{named_joints(found.fit.model.arm)}",
        *_far_poses(report),
        *_may_hide(report),
        in_words(report.left.predictable.sentence),
        *section(_concentrated(found), (in_words(one.sentence) for one in report.left.regimes)),
        _ranking_table(report),
    ]
    if found.data.several_kinds:
        blocks.append(
            "≈ stands for all that was measured of a pose, each number weighed by its noise, as if it were a position: "
            "compare such figures with one another only. Figures without it are errors of the TCP."
        )
    if report.verdict == "unexplained_structure":
        ranking = found.unexplained.ranking
        lines = (f"{in_words(function.name)} would leave {in_mm(rms)} mm held out" for function, rms in ranking)
        blocks += section("\nIts anatomy: what it acts like, and what that follows", lines)
    if found.outliers:
        blocks.append(f"\nOutliers, left out: {poses_words(found.outliers)}")
    blocks += [f"{one.sentence[0].upper()}{one.sentence[1:]}." for one in found.shifted]
    blocks += section("\nHints that are no effects", map(in_words, report.hints))
    blocks += section("\nWhat these data cannot show", report.limitations)
    if refused := tuple(untestable(found.not_testable)):
        names = ", ".join(_untestable_names(found))
        blocks.append(FoldedSection("\nNot testable", refused, f"{names}; --all says where and why"))
    return [*blocks, f"\nNext: {in_words(report.hint)}"]


def _concentrated(found: Diagnosis) -> str:
    """Heading of the regimes."""
    return f"\nWhere what is left is concentrated{', outliers included' if found.outlier_distances else ''}"


def _untestable_names(found: Diagnosis) -> Iterator[str]:
    """Effects that are not testable, and at how many of their places, where they are at others."""
    refused = Counter(effect.id for effect, _ in found.not_testable)
    tested = Counter(scored.candidate.effect.id for scored in found.scored)
    for name, count in refused.items():
        yield f"{name} at {count} of {count + tested[name]} places" if tested[name] else name


def _floor_mm(report: DiagnosisReport) -> float | None:
    floor = report.diagnosis.floor.rms
    return None if floor is None else floor * 1e3


def _refusal(effect: Effect, reason: str) -> dict[str, str]:
    needs = effect.about.needs or "poses where it moves the TCP more"
    return {"effect": effect.id, "place": effect.place, "reason": reason, "would_need": needs}


def _verdict(report: DiagnosisReport) -> str:
    """The verdict in words; nothing found above the noise floor is not the same as nothing missing."""
    floor, sigma = report.diagnosis.floor.sd, report.diagnosis.fit.sigma
    if report.verdict == "unpredictable" and floor is not None:
        return (
            f"{VERDICTS[report.verdict]}: the error is {sigma / floor:.2f} times the noise. It may be creep, something "
            "loose, a target that moved, or noise larger than said; with more poses it may show what it follows."
        )
    if report.verdict == "noise_unknown":
        bound = report.left.predictable.noise_bound
        return f"{VERDICTS[report.verdict]}: the noise is not known, and at most {in_mm(bound)} mm."
    if report.verdict == "unexplained_structure":
        return f"{VERDICTS[report.verdict]}{_looks_like(report)}"
    if report.first is not None:
        why = in_words(report.first.why)
        reason = _describes_because(report) if report.verdict == "effect_describes" else _possible_because(report)
        return f"{VERDICTS[report.verdict]} {why[0].upper()}{why[1:]}.{reason}"
    return VERDICTS[report.verdict]


def _describes_because(report: DiagnosisReport) -> str:
    """Sentence on why the first effect names no cause."""
    found = report.diagnosis
    if report.first is None:
        return ""
    present, known = {effect.name for effect in found.fit.model.effects}, found.floor.rms is not None
    reason = no_cause(report.first.scored.candidate.effect, found.data.poses.q, present, known)
    return f" It {took_words(report.share, known)}: {reason}."


def _possible_because(report: DiagnosisReport) -> str:
    """Sentence on what the first effect would leave, if another cause may stand behind it."""
    left = unexplained_ratio(report)
    if left is None or left <= MAX_UNEXPLAINED_RATIO:
        return ""
    return (
        f" It would leave {left:.1f} times as much of the mean square above the noise as it takes: a possible cause, "
        "until it is known what else is there (auto goes on)."
    )


def _looks_like(report: DiagnosisReport) -> str:
    """The free function that explains most of unexplained structure, if one saves enough to be worth a word."""
    found, held_out = report.diagnosis.unexplained, report.held_out.rms
    named = {function.name: rms for function, rms in found.ranking}
    best = found.functions[0].name if found.functions else next(iter(named), "")
    if best not in named or named[best] > (1.0 - MIN_GAIN) * held_out:
        return ""
    left = f"{in_mm(named[best])} of {in_mm(held_out)} mm held out"
    return f" It looks most like {in_words(best)}, which would leave {left}."


def _far_poses(report: DiagnosisReport) -> Iterator[str]:
    """The few poses that hold what is left, if others show much less."""
    rows = report.far_rows
    if not rows:
        return
    fit, data, floor = report.diagnosis.fit, report.diagnosis.data, report.diagnosis.floor.sd
    distance = np.linalg.norm(fit.residual, axis=1)
    poses = enumerate_words([f"{data.pose[row]} ({in_mm(distance[row])} mm)" for row in rows], SHOWN)
    others = np.delete(distance, rows)
    sigma = fit.sigma * np.sqrt((others @ others) / (distance @ distance))
    noise = "" if floor is None else f", {sigma / floor:.2f} times the noise"
    which, they = ("pose", "it") if len(rows) == 1 else ("poses", "they")
    yield (
        f"Far off: {which} {poses}; the RMS of the others is {in_mm(float(np.sqrt(np.mean(others**2))))} mm{noise}. "
        f"Measure there again, and near there: either {they} went wrong, or what is missing shows only there."
    )
    side = data.poses.direction
    directed = any("direction" in effect.depends_on for effect in fit.model.effects)
    if directed and side is not None and (blind := [str(data.pose[row]) for row in rows if not side[row].any()]):
        yield (
            f"From which side the joints came to pose {enumerate_words(blind, SHOWN)} is not known, and the model asks "
            "for it: state start_q_deg in the file beside the data, or approach."
        )


def _may_hide(report: DiagnosisReport) -> Iterator[str]:
    """How much a known cause may move the TCP without being shown, where none is."""
    bounds = report.diagnosis.motion_bounds
    if bounds and report.verdict in ("nothing_missing", "noise_unknown") and not report.diagnosis.data.several_kinds:
        name = next(iter(bounds))
        yield (
            f"A known cause that these poses do not show moves the TCP by at most {in_mm(bounds[name])} mm RMS there "
            f"(95 %; {plain_name(name)} the most), beyond what the fit takes up."
        )
    if report.verdict in ("nothing_missing", "noise_unknown") and (words := _holds(report)):
        yield words


def _holds(report: DiagnosisReport) -> str:
    """Levels and ranges at which the verdict holds that nothing is missing; empty where poses cover the arm's range."""
    limits = JointLimits.of(report.diagnosis.fit.model.arm)
    return where_it_holds(report.diagnosis.data.poses.q, np.array(limits.lower), np.array(limits.upper))


def _ranking_table(report: DiagnosisReport) -> ResultTable:
    supported = sum(advice.verdict != "no_evidence" for advice in report.ranking)
    rows = []
    for rank, advice in enumerate(report.ranking[: min(supported, SHOWN) + REFUSED_SHOWN], start=1):
        rms = ("" if advice.exact else "≈ ") + in_mm(advice.held_out_rms)
        name, mark, why = advice.scored.name, MARKS[advice.verdict].split()[0], in_words(advice.why)
        rows.append((rank, mark, name, rms, why if advice.verdict != "no_evidence" else f"{plain_name(name)}: {why}"))
    return ResultTable(("|", "", "effect", "held out mm|", "why"), rows, "   ".join(MARKS.values()))


def _advice(rank: int, advice: RankedCandidate, report: DiagnosisReport) -> dict[str, object]:
    effect = advice.scored.candidate.effect
    return {
        "rank": rank,
        "effect": effect.id,
        "place": effect.place,
        "verdict": advice.verdict,
        "held_out_rms_mm": advice.held_out_rms * 1e3,
        "approximate": not advice.exact,
        "gain_mm": (report.held_out.rms - advice.held_out_rms) * 1e3,
        "p_value": min(1.0, report.diagnosis.adjusted_p_values[advice.scored.name]),
        "parameters": {name: {"value": value, "se": error} for name, value, error in advice.estimates},
        "indistinguishable_from": advice.equivalent,
        "online": compensable(effect),
        "why": in_words(advice.why),
    }


def untestable(refused: Sequence[tuple[Effect, str]]) -> Iterator[str]:
    """One line for all places of an effect that the data cannot test for the same reason."""
    by_reason: dict[tuple[str, str], list[str]] = defaultdict(list)
    for effect, reason in refused:
        general = re.sub(rf"\b{re.escape(effect.place)}\b", "the joint", reason)
        general += f" (needs {effect.about.needs})" if effect.about.needs else ""
        if "typical size" in reason:
            general = "its typical size would hardly show in what is left now"
        by_reason[effect.id, general].append(effect.place)
    for (name, reason), places in by_reason.items():
        yield in_words(f"{name} at {', '.join(places)}: {reason}")


def took_words(share: float, floor_known: bool) -> str:
    """Share of the error that an effect took away."""
    return f"took {in_percent(share)} % of the mean square{' above the noise' if floor_known else ''}"


def no_cause(effect: Effect, q: Array, present: Collection[str], floor_known: bool) -> str:
    """Reason why an effect that predicts better shows no new cause.

    Args:
        q: (N, n), measured commands (rad). present: effects (`effect@place`) of the model.
    """
    refines = variants(effect)
    if there := [name for name in refines if name in present]:
        return f"another form of {in_words(' and '.join(there))}, no new cause"
    if refines:
        return f"a free curve that stands for {in_words(' or '.join(refines))}, no cause that was shown"
    if not can_be_contradicted(effect, q):
        return (
            "any function of that angle fits as well: measure the joint at more angles, each with several of the others"
        )
    return f"too little to name a cause while {'so much' if floor_known else 'more'} stays"


def left_values(left: ResidualPatterns) -> dict[str, object]:
    """The entries `nameless`, `noise_bound_rms_mm` and `regimes` of a diagnosis."""
    return {
        "nameless": left.predictable,
        "noise_bound_rms_mm": left.predictable.noise_bound * 1e3,
        "regimes": left.regimes,
    }


def noise_words(floor_mm: float | None, source: str, left: ResidualPatterns) -> str:
    """The noise floor, or its upper bound where it is not known."""
    if floor_mm is None:
        most = f"at most {in_mm(left.predictable.noise_bound)} mm"
        return f"unknown ({most}: the rest can be predicted)" if left.predictable.more_to_find else f"unknown ({most})"
    return f"{in_mm(floor_mm * 1e-3)} mm ({source})"
