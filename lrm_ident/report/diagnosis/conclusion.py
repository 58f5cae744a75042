"""Conclusion of a diagnosis: what is missing, its figures, how certain that is, and what to do next.

The one source of a verdict in words: terminal, page, report and notebook show these lines.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass

import numpy as np

from lrm_ident.data.observations.distances import Distances
from lrm_ident.data.wording import UNSEEN, arrow, enumerate_words, in_mm, poses_count
from lrm_ident.diagnosis.attribution import attribution_of, explained_by_first, unexplained_ratio
from lrm_ident.diagnosis.contradiction import can_be_contradicted
from lrm_ident.diagnosis.diagnose import Diagnosis
from lrm_ident.diagnosis.diagnosis_report import DiagnosisReport, RankedCandidate
from lrm_ident.diagnosis.judgement import Support, Verdict
from lrm_ident.diagnosis.reason import ReasonKind
from lrm_ident.fitting.model_fit import DEFAULT_EFFECTS
from lrm_ident.report.diagnosis.advice import advice_of, causes_of, unsure_of
from lrm_ident.report.document import Block, CommandLine, Facts, heading, section
from lrm_ident.report.plain_names import (
    enumerate_effects,
    place_in_words,
    plain_name,
    repair_advice,
    with_id,
    words_of,
)
from lrm_ident.report.story import BY_THE_TRACKER, ON_THE_ARM
from lrm_ident.report.text.advice import hopeless_words, next_step, plan_options, provided_words
from lrm_ident.report.text.claims import claim_sentence
from lrm_ident.report.text.poses import (
    limitation_sentence,
    paced_words,
    rounding_words,
    rows_in_order_of,
    where_measured,
)
from lrm_ident.report.text.residuals import (
    A_LENGTH,
    BLACK_BOX,
    WHY_OFF,
    predictable_brief,
    regime_brief,
    scale_sentence,
    shifted_sentence,
)
from lrm_ident.report.text.variables import function_name, what_may_change
from lrm_ident.residual.data_audit import LimitationKind, MeasuredAngles, where_it_holds
from lrm_ident.residual.rounded_commands import rounded_commands
from lrm_ident.residual.scale_uncertainty import distance_from_centre, scale_uncertainty
from lrm_ident.residual.thresholds import MAX_UNEXPLAINED_RATIO
from lrm_math.arm.arm import JointLimits
from lrm_math.arm.place_names import joint_numbers
from lrm_math.effects import CATALOGUE, Effect, constant, variants
from lrm_math.effects.targets import FRAME_PLACE
from lrm_math.kinematics.history import PACE_S
from lrm_math.model.deployed_model import CORRECTED, on_rover

LISTED, IN_HEADLINE, REASONS, REASONS_SHOWN = 4, 2, 3, 2
DEPLOY = "The daemon takes the model; nothing moves. verify then drives to 50 goals."
VERIFY = "lrm-ident verify --tracker dtrack:5000 --goals 50"
LACKS = "what these poses lack"
FIRST = (
    "estimate", "as deployed", "add as well", "certainty", "repair", "empirical term", "could be", "acts most like",
    "in the model", "chosen again", LACKS,
)  # fmt: skip
"""Facts that page and report show before the others are unfolded."""
FOLDED = ("black-box model",)
"""Facts that a terminal shows with `--all` only."""
STOPGAP = "or, without new poses"
"""Lead of the command for whoever does not measure the poses that the first one writes."""
FOR_THE_CAUSE, FOR_OTHERS = "to learn the cause", "for programs that read a URDF"
"""Leads of commands beside that which gives the model to the arm."""
NOT_YET = "nothing yet: the cause is not certain"
"""What to repair while the cause is not sure; the next step on a terminal says as much."""
MISSING = "Missing from the model"
OTHERWISE = "what it follows also moves the arm elsewhere, or otherwise at other angles, so the cause may be another"
MORE_POSES = 40
"""Poses to measure where those there lack something."""
ORDERED = frozenset({"direction", "time", "session"})
"""What an effect depends on if the order of the poses decides it."""
PART = 0.15
"""Share of the squared error from which an effect is said to explain part of it."""
NOT_LASTING = frozenset({ReasonKind.NOT_BETTER_LATER, ReasonKind.WORSE_DEPLOYED})
"""Reasons that refuse an effect for later poses, not for these."""
NONE_FOUND, NOT_IDENTIFIED = "No missing effect found", "No cause identified"
WHY_NOT = {
    Verdict.EFFECT_DESCRIBES: "the error is systematic, but these poses do not show why.",
    Verdict.UNEXPLAINED_STRUCTURE: "the error is systematic, but no known effect explains it.",
    Verdict.UNPREDICTABLE: "the error exceeds the noise, but nothing measured predicts it.",
}
"""Why no cause was identified."""
LEFT = {
    Verdict.NOTHING_MISSING: "no further systematic error is seen.",
    Verdict.NOISE_UNKNOWN: "but the measurement noise is not known, so one may be hidden in it.",
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


@dataclass(frozen=True)
class CommandNames:
    """Names of the files that commands to copy stand for; in capitals where they are not known."""

    model: str = "MODEL"
    data: str = "DATA"
    arm: str = "ARM"


UNKNOWN_FILES = CommandNames()


@dataclass(frozen=True)
class NextStep:
    """Next thing to do: an imperative, the command for it where there is one, and the command after that.

    `lead`: how it stands to the step before it.
    """

    words: str
    command: str = ""
    then: str = ""
    lead: str = "or"


@dataclass(frozen=True)
class Conclusion:
    """A verdict for people.

    Attributes:
        headline: one sentence. facts: labelled figures, among them how certain the headline is.
        reasons: why these poses determine no more, where that matters. next: what to do, the best first.
    """

    headline: str
    facts: tuple[tuple[str, str], ...]
    reasons: tuple[str, ...]
    next: tuple[NextStep, ...]

    def blocks(self) -> list[Block]:
        """The conclusion on a terminal."""
        steps: list[Block] = [""]
        for number, step in enumerate(self.next):
            lead = "Next: " if number == 0 else f"  {step.lead}: "
            if step.command:
                then = [CommandLine(f"      Then: {step.then}")] if step.then else []
                steps += [CommandLine(f"{lead}{step.command}"), f"      {step.words}", *then]
            else:
                steps.append(f"{lead}{step.words}")
        why = section(LACKS[0].upper() + LACKS[1:], self.reasons[:REASONS_SHOWN])
        shown = tuple(fact for fact in self.facts if fact[0] not in FOLDED and fact[1] != NOT_YET)
        return [heading(self.headline), Facts(shown), *why, *(steps if self.next else ())]

    def as_json(self) -> dict[str, object]:
        """The table `conclusion`."""
        return {
            "headline": self.headline,
            "facts": dict(self.facts),
            "reasons": self.reasons,
            "next": [{"do": one.words, "command": one.command or None, "then": one.then or None} for one in self.next],
        }


def conclude(report: DiagnosisReport, names: CommandNames = UNKNOWN_FILES) -> Conclusion:
    """The conclusion of a diagnosis. `names`: of the files in its commands."""
    attribution, rivals = attribution_of(report), report.first.equivalent if report.first else ()
    advice = advice_of(report)
    hopeless = () if advice is None or advice.helps else (hopeless_words(advice),)
    tells_why = attribution != Support.FINDING or rivals or report.verdict == Verdict.UNEXPLAINED_STRUCTURE
    quiet = report.verdict.quiet
    facts = tuple((label, words) for label, words in _facts(report, attribution) if words)
    lacks = [one for one in report.limitations if one.kind is not LimitationKind.ORDER or "order" not in dict(facts)]
    return Conclusion(
        headline=_headline(report, attribution),
        facts=facts,
        reasons=(*hopeless, *map(limitation_sentence, lacks))[:REASONS] if tells_why and not quiet else (),
        next=tuple(_next_steps(report, attribution, names)),
    )


def _has_already(report: DiagnosisReport) -> dict[str, Effect]:
    """The causes that the model has already, by their names."""
    here = [effect for effect in report.diagnosis.fit.model.effects if type(effect) in CATALOGUE]
    return {effect.name: effect for effect in here if effect.id not in DEFAULT_EFFECTS}


def _empirical(report: DiagnosisReport) -> list[str]:
    """The empirical terms that the model has already."""
    return [effect.name for effect in report.diagnosis.fit.model.effects if effect.is_free_form]


def _headline(report: DiagnosisReport, attribution: Support | None) -> str:
    first = report.first
    if first is None or attribution is None:
        return _quiet_headline(report) if report.verdict.quiet else _not_identified(report, WHY_NOT[report.verdict])
    if attribution == Support.DESCRIPTION:
        return _empirical_headline(report, first)
    what = with_id(first.name)
    if attribution == Support.POSSIBLE_CAUSE:
        return f"An effect is missing from the model. The best candidate: {what}"
    if first.equivalent:
        return f"{MISSING}: {what}, or another that these poses cannot distinguish from it"
    return f"{MISSING}: {what}"


def _not_identified(report: DiagnosisReport, why: str) -> str:
    """That no cause was identified: for what the causes leave that the model has already, if it has any."""
    return f"{NOT_IDENTIFIED}{' for the remaining error' if _has_already(report) else ''}: {why}"


def _quiet_headline(report: DiagnosisReport) -> str:
    """That nothing more is missing; what the model has already stands first, and whether it may be another cause."""
    known = list(_has_already(report))
    changes = report.deployed.among_measured is not None
    left = f", {CHANGES}" if changes else f"; {LEFT[report.verdict]}"
    if not known and (terms := _empirical(report)):
        what = enumerate_effects(terms, IN_HEADLINE)
        corrects = "an empirical term, corrects" if len(terms) == 1 else "empirical terms, correct"
        return f"{NOT_IDENTIFIED}; {what}, {corrects} the error{left}"
    if not known:
        return f"{NONE_FOUND} in this session, {CHANGES}" if changes else HEADLINES[report.verdict]
    named = enumerate_effects(known, IN_HEADLINE)
    unsure = list(unsure_of(report))
    it = "it" if len(known) == 1 else "them" if len(unsure) == len(known) else enumerate_effects(unsure, IN_HEADLINE)
    other = f", or another cause that these poses cannot distinguish from {it}" if unsure else ""
    all_corrected = all(on_rover(effect) in CORRECTED for effect in _has_already(report).values())
    return f"Found: {named}{other}, now {'corrected' if all_corrected else 'in the model'}{left}"


def _empirical_headline(report: DiagnosisReport, first: RankedCandidate) -> str:
    refined = set(variants(first.effect)) & {one.name for one in report.diagnosis.fit.model.effects}
    if refined:
        return f"No new cause: the formula of {enumerate_words(sorted(map(plain_name, refined)), LISTED)} is not exact."
    if first.effect.is_free_form:
        return _not_identified(report, WHY_NOT[Verdict.EFFECT_DESCRIBES])
    if not can_be_contradicted(first.effect, report.diagnosis.data.poses.q):
        return _not_identified(report, "with so few angles of its joint, any function of the angle fits as well.")
    return _not_identified(report, "the best effect explains too little of the error to be called its cause.")


def _facts(report: DiagnosisReport, attribution: Support | None) -> Iterator[tuple[str, str]]:
    """Labelled facts; those without words are left out."""
    first = report.first
    if first is not None and attribution != Support.DESCRIPTION:
        yield "estimate", "" if first.claim is None else claim_sentence(first.claim)
    yield "held-out error", _held_out(report)
    yield "as deployed", _deployed(report)
    if report.beside:
        both = "only with both does the model surely predict later poses better"
        yield "add as well", f"{with_id(report.beside)}: {both}"
    fit = report.diagnosis.fit if first is None or first.fit is None else first.fit
    yield "tracker's scale", scale_sentence(scale_uncertainty(fit))
    if first is not None and attribution is not None:
        label = "empirical term" if attribution == Support.DESCRIPTION else "certainty"
        yield label, _certainty(report, first, attribution)
        yield "could be", _stands_for(report, first) if attribution == Support.DESCRIPTION else ""
    if report.verdict.quiet:
        yield "certainty", _unsure(report)
    if (first is None or attribution != Support.FINDING) and not _bounds_noise(report):
        yield "black-box model", predictable_brief(report.patterns.predictable)
    if report.verdict == Verdict.UNEXPLAINED_STRUCTURE:
        yield "acts most like", _looks_like(report)
    yield "order", _order(report)
    yield "where", regime_brief(report.patterns.regimes[0]) if report.patterns.regimes else ""
    yield "far off", " ".join(_far_poses(report))
    rows = map(shifted_sentence, report.diagnosis.shifted)
    yield "rows", " ".join(f"{words[0].upper()}{words[1:]}." for words in rows)
    yield "left out", _left_out(report.diagnosis)
    if report.verdict.quiet and len(known := _has_already(report)) > IN_HEADLINE:
        yield "in the model", enumerate_effects(known, LISTED)
    yield "repair", _repair(report, attribution)
    yield "rounding", _rounding(report)
    if report.verdict.quiet:
        yield "hidden at most", _may_hide(report)
        yield "valid", where_measured(valid_where(report))
        yield "not tested", _not_tested(report)


def _rounding(report: DiagnosisReport) -> str:
    """That an error that nothing predicts is as large as the rounding of the angles would make it."""
    found = report.diagnosis
    if report.verdict not in (Verdict.UNPREDICTABLE, Verdict.NOISE_UNKNOWN):
        return ""
    rounded = rounded_commands(found.data.poses.q, found.joint_jacobian)
    if rounded is None or not rounded.explains(report.held_out.rms, found.floor.rms or 0.0):
        return ""
    return rounding_words(np.degrees(rounded.step), rounded.tip)


def _repair(report: DiagnosisReport, attribution: Support | None) -> str:
    """What to do with one's hands: about the identified cause, or about those that the model has already."""
    first = report.first
    if report.verdict.quiet:
        known = _has_already(report)
        certain = [effect for name, effect in known.items() if name not in unsure_of(report)]
        if not known and (terms := _empirical(report)):
            places = dict.fromkeys(map(place_in_words, terms))
            return f"{NOT_YET}; look there first: {enumerate_words(list(places), LISTED)}"
        if known and not certain:
            return _repair_of_either(next((name, *others) for name, others in unsure_of(report).items()))
        return repair_advice(*certain[:LISTED])
    if first is not None and attribution == Support.FINDING:
        effect = first.effect
        return _repair_of_either((first.name, *first.equivalent)) if first.equivalent else repair_advice(effect)
    return NOT_YET


def _repair_of_either(names: Sequence[str]) -> str:
    """What to do with one's hands about each of several causes, of which one is there."""
    repairs = (
        (plain_name(name), words_of(name, "repair").format(place=place_in_words(name))) for name in names[:LISTED]
    )
    either = "; ".join(f"if {name}: {repair}" for name, repair in repairs if repair)
    return f"not yet known which: {either}" if either else NOT_YET


def valid_where(report: DiagnosisReport) -> tuple[MeasuredAngles, ...]:
    """Angles and ranges at which the verdict holds alone; empty where the poses cover the arm's range."""
    limits = JointLimits.of(report.diagnosis.fit.model.arm)
    return where_it_holds(report.diagnosis.data.poses.q, np.array(limits.lower), np.array(limits.upper))


def _not_tested(report: DiagnosisReport) -> str:
    """The scale of a tracker that is taken as right: what a wrong one would cost, and what decides; empty otherwise."""
    data, fit = report.diagnosis.data, report.diagnosis.fit
    decided = data.of(Distances) or data.touched or not data.positions.measured.any()
    if decided or scale_uncertainty(fit) is not None:
        return ""
    return f"the tracker's scale (1 mm/m costs {in_mm(1e-3 * distance_from_centre(fit))} mm at the tip). {A_LENGTH}"


def _held_out(report: DiagnosisReport) -> str:
    floor, sd = report.diagnosis.floor.rms, report.diagnosis.floor.sd
    bound = f"noise at most {in_mm(report.patterns.predictable.noise_bound)} mm"
    error, first = report.held_out.rms, report.first
    alone = first is None or attribution_of(report) == Support.DESCRIPTION
    noise = bound if floor is None else f"{'measurement ' if alone else ''}noise {in_mm(floor)} mm"
    if report.verdict == Verdict.UNPREDICTABLE and sd is not None:
        noise += f": the error is {report.diagnosis.fit.sigma / sd:.2f} times as large"
    elif report.verdict == Verdict.NOTHING_MISSING and floor is not None:
        interval = report.diagnosis.floor.interval
        repeats = "" if interval is None else "; by repeated poses between {} and {} mm".format(*map(in_mm, interval))
        noise = f"{error / floor:.1f} times the {noise}{repeats}"
    if first is None or alone:
        predicted = f", systematic: {BLACK_BOX} reaches {in_mm(report.patterns.predictable.error.rms)} mm"
        return f"{in_mm(error)} mm RMS {UNSEEN}{predicted if _bounds_noise(report) else f' ({noise})'}"
    return f"{arrow(error, first.held_out_rms)} mm RMS with it, at unseen poses ({noise})"


def _bounds_noise(report: DiagnosisReport) -> bool:
    """Whether nothing but the black-box model tells how small the noise is at most."""
    return report.diagnosis.floor.rms is None and report.patterns.predictable.more_to_find


def _deployed(report: DiagnosisReport) -> str:
    """The error as deployed, where it is another than in the session."""
    deployed, shown, first = report.deployed, report.held_out.rms, report.first
    if first is not None and first.deployed is not None:
        after, fewer = in_mm(first.deployed.now.rms), first.deployed.fewer
        if first.deployed.among_measured is not None:
            return f"{after} mm RMS with it at later poses, as the arm goes on changing"
        if deployed.among_measured is not None:
            return f"{after} mm RMS with it, {_where_expected(report)}"
        before = in_mm((first.deployed_without or deployed.now).rms)
        same = (before, after) == (in_mm(shown), in_mm(first.held_out_rms))
        part = "" if fewer is None else f"at the {fewer} poses where its state held, "
        return "" if same else f"{before} → {after} mm RMS {part}{_where_expected(report)}"
    if deployed.among_measured is not None:
        among = f"{in_mm(deployed.among_measured.rms)} mm among the measured poses"
        return f"{in_mm(deployed.now.rms)} mm RMS at later poses ({among}), as the arm goes on changing"
    size = f"{in_mm(deployed.now.rms)} mm RMS, largest {in_mm(deployed.now.max)} mm{_without_noise(report)}"
    if in_mm(deployed.now.rms) == in_mm(shown) and deployed.otherwise is None:
        return size
    earlier = "" if deployed.otherwise is None else f" (earlier in this session {in_mm(deployed.otherwise.rms)} mm)"
    return f"{size}; {_where_expected(report)}{earlier}"


def _without_noise(report: DiagnosisReport) -> str:
    """How much of the error as deployed is the arm's own, where the noise is known."""
    diagnosis, error = report.diagnosis, report.deployed.now.rms
    bounds = diagnosis.floor.error_without(error, report.deployed.fewer or len(diagnosis.data))
    if bounds is None or diagnosis.floor.rms is None or diagnosis.data.several_kinds:
        return ""
    if bounds[0]:
        own = float(np.sqrt(error**2 - diagnosis.floor.rms**2))
        return f"; arm and fit without the noise ≈ {in_mm(own)} mm"
    return f"; arm and fit without the noise ≤ {in_mm(bounds[1])} mm (95 %)" if bounds[1] else ""


def _where_expected(report: DiagnosisReport) -> str:
    """What an error as deployed is of: a tracker that errs sees its own error, left out of the arm, there too."""
    first = report.first
    effects = [*report.diagnosis.fit.model.effects, *([] if first is None else [first.effect])]
    return BY_THE_TRACKER if any(effect.place == FRAME_PLACE for effect in effects) else ON_THE_ARM


def _certainty(report: DiagnosisReport, first: RankedCandidate, attribution: Support) -> str:
    if attribution == Support.DESCRIPTION:
        return f"{plain_name(first.name)}: {arrow(report.held_out.rms, first.held_out_rms)} mm RMS"
    beside = enumerate_effects(first.equivalent, LISTED)
    if attribution == Support.POSSIBLE_CAUSE:
        rivals = f" These poses cannot distinguish it from {beside}." if beside else ""
        why = why_candidate(report, first.name, report.replicates, *(explained_by_first(report) or (0.0, 0.0)))
        return f"only a candidate cause: {why}.{rivals}"
    if beside:
        return f"it, or {beside}: indistinguishable with these poses"
    unsure = "" if report.diagnosis.floor.rms is not None else "; how much stays unexplained is not known"
    return f"identified: {_runner_up(report, first)}{unsure}"


def _unsure(report: DiagnosisReport) -> str:
    """Which effects of the model may be which others, and whether no poses would tell; empty: all are sure."""
    unsure = unsure_of(report)
    if not unsure:
        return ""
    either = (f"{plain_name(name)}, or {enumerate_effects(others, LISTED)}" for name, others in unsure.items())
    advice = advice_of(report)
    none = len(unsure) == 1 and advice is not None and advice.plan is not None and not advice.helps
    others = ", and with all others that were tried" if none else ""
    return f"{'; '.join(either)}: indistinguishable with these poses{others}"


def why_candidate(report: DiagnosisReport, name: str, replicates: bool, explained: float, left: float) -> str:
    """Why an effect is a candidate cause and no identified one.

    Args:
        replicates: whether both halves of the data choose it. explained, left: squared errors that it explains, and
            that stay unexplained, in one unit.
    """
    if not replicates:
        return "the two halves of the data do not agree on it"
    if name in report.misspecified:
        return OTHERWISE
    if explained <= 0.0:
        return "it does not lower the error of the tip, so the cause may be another"
    ratio = unexplained_ratio(explained, left)
    return (
        f"{ratio:.1f} times the squared error that it explains stays unexplained (limit {MAX_UNEXPLAINED_RATIO:.2f}), "
        "so the cause may be another"
    )


def _runner_up(report: DiagnosisReport, first: RankedCandidate) -> str:
    """What the next best effect leaves that could be the cause; splines, which follow any cause, are none."""
    own = {first.name, *variants(first.effect)}
    others = [
        one
        for one in report.ranking
        if one is not first
        and one.effect.names_a_cause
        and not one.effect.is_free_form
        and one.name not in own
        and not one.scored.implausible
    ]
    if not others:
        return "no other known cause explains any of it"
    least = min(one.held_out_rms for one in others)
    curves = (one for one in report.ranking if one is not first and one.effect.is_free_form)
    if any(one.held_out_rms < least for one in curves):
        return f"other causes leave ≈ {in_mm(least)} mm or more, splines less"
    return f"every other known cause leaves ≈ {in_mm(least)} mm or more"


def _stands_for(report: DiagnosisReport, first: RankedCandidate) -> str:
    """The causes that an empirical term may stand for."""
    present = {effect.name for effect in report.diagnosis.fit.model.effects}
    return enumerate_effects([name for name in variants(first.effect) if name not in present], LISTED)


def _looks_like(report: DiagnosisReport) -> str:
    """What explains most of an unexplained error, if enough to be worth a word: a free function, or a known effect that
    is not named since later poses speak against it."""
    found, held_out = report.diagnosis.unexplained, report.held_out.rms
    left = dict(report.functions)
    best = found.functions[0] if found.functions else next(iter(left), None)
    function_left = left.get(best, np.inf) if best is not None else np.inf
    known = min(_passing(report), key=lambda one: one.held_out_rms, default=None)
    if known is not None and known.held_out_rms < function_left and explains_part(known.held_out_rms, held_out):
        of = f"{with_id(known.name)}, which leaves ≈ {in_mm(known.held_out_rms)} mm here"
        return f"{of}. Not named, since it does not surely help at later poses"
    if best is None or not explains_part(function_left, held_out):
        return ""
    question = what_may_change(best)
    return f"{function_name(best)}, which leaves {in_mm(function_left)} mm{question and f'. {question}'}"


def _passing(report: DiagnosisReport) -> Iterator[RankedCandidate]:
    """The known effects that fit the session, and are refused for what the arm does later."""
    for one in report.ranking:
        why = one.reason.because
        if why is not None and why.kind in NOT_LASTING and not one.effect.is_free_form:
            yield one


def explains_part(left: float, before: float) -> bool:
    """Whether an effect or a function that leaves one held-out RMS of another explains enough to be worth a word."""
    return 1.0 - (left / before) ** 2 >= PART


def _left_out(diagnosis: Diagnosis) -> str:
    """The outliers that no figure counts: how many, how far off, and what they may be; empty where there are none."""
    outliers = diagnosis.outliers
    if not outliers:
        return ""
    distances = [diagnosis.outlier_distances[number] for number in outliers if number in diagnosis.outlier_distances]
    far = f", up to {in_mm(max(distances))} mm off" if distances else ""
    count = f"{len(outliers)} of {poses_count(len(diagnosis.data) + len(outliers))}"
    return f"{count}, as outliers{far}: {enumerate_words(list(map(str, outliers)), 2 * LISTED)}. {WHY_OFF}"


def _far_poses(report: DiagnosisReport) -> Iterator[str]:
    """The few poses that hold most of the error, if the others show much less."""
    rows = report.far_rows
    if not rows:
        return
    fit, data, floor = report.diagnosis.fit, report.diagnosis.data, report.diagnosis.floor.sd
    distance = np.linalg.norm(fit.residual, axis=1)
    poses = enumerate_words([f"{data.pose[row]} ({in_mm(distance[row])} mm)" for row in rows], 2 * LISTED)
    others = np.delete(distance, rows)
    sigma = fit.sigma * np.sqrt((others @ others) / (distance @ distance))
    noise = "" if floor is None else f", {sigma / floor:.2f} times the noise"
    which = "pose" if len(rows) == 1 else "poses"
    yield (
        f"{which} {poses}; the others have {in_mm(float(np.sqrt(np.mean(others**2))))} mm RMS{noise}. Measure there "
        "again and nearby: either these measurements are wrong, or the missing effect shows only there."
    )
    side = data.poses.direction
    directed = any("direction" in effect.depends_on for effect in fit.model.effects)
    if directed and side is not None and (blind := [str(data.pose[row]) for row in rows if not side[row].any()]):
        yield (
            f"The direction of approach of pose {enumerate_words(blind, 2 * LISTED)} is not known, and the model needs "
            "it: state start_q_deg in the file beside the data, or the columns approach."
        )


def _order(report: DiagnosisReport) -> str:
    """What rows without a time leave open, where an effect depends on the order of the poses or on a joint that the
    order follows."""
    if report.diagnosis.data.poses.t is not None:
        return ""
    first = report.first
    effects = [*_has_already(report).values(), *([] if first is None else [first.effect])]
    timed = any(effect.remembers or "time" in effect.depends_on for effect in effects)
    return "; ".join(filter(None, (_follows_joint(report, effects), paced_words(PACE_S) if timed else "")))


def _follows_joint(report: DiagnosisReport, effects: Sequence[Effect]) -> str:
    """That the order of the rows may not be that of the measurement."""
    follows = [one for one in report.limitations if one.kind is LimitationKind.ORDER]
    joints = {joint - 1 for one in follows for joint in one.joints}
    concerned = [
        effect.name
        for effect in effects
        if effect.remembers or not ORDERED.isdisjoint(effect.depends_on) or joints & {*joint_numbers(effect.place)}
    ]
    return rows_in_order_of(follows[0], enumerate_effects(concerned, IN_HEADLINE)) if follows and concerned else ""


def _may_hide(report: DiagnosisReport) -> str:
    """How far a known effect may move the TCP without being shown."""
    bounds = report.diagnosis.motion_bounds
    if not bounds or report.diagnosis.data.several_kinds:
        return ""
    most = in_mm(max(bounds.values()))
    return f"{most} mm RMS at the tip, by one further known effect (95 %)"


def _next_steps(report: DiagnosisReport, attribution: Support | None, names: CommandNames) -> Iterator[NextStep]:
    model, data, _ = map(shlex.quote, astuple(names))
    first = report.first
    if first is None or attribution is None:
        yield from _without_effect(report, names)
        return
    add = f"lrm-ident add {model} {data} {shlex.quote(first.name)} -o better.toml"
    lead, words = "or", "Adds it to the model and refits all parameters."
    if distinguishing := list(_poses_that_distinguish(report, names)):
        yield from distinguishing
        lead, words = STOPGAP, "Adds it, though its cause is not certain."
    if attribution == Support.DESCRIPTION:
        yield NextStep("Corrects the error without knowing its cause.", add, lead=STOPGAP)
        return
    yield NextStep(words, add, f"lrm-ident diagnose better.toml {data}", lead)
    if not first.equivalent:
        auto = f"lrm-ident auto {model} {data} -o best.toml"
        yield NextStep("In one go: adds this and every further effect until none is missing.", auto)


def _poses_that_distinguish(report: DiagnosisReport, names: CommandNames, lead: str = "or") -> Iterator[NextStep]:
    """How to measure what distinguishes the causes, where some poses do."""
    model, data, arm = map(shlex.quote, astuple(names))
    advice = advice_of(report)
    if advice is None or advice.plan is None or not advice.helps:
        return
    rivals = shlex.quote(",".join(causes_of(report)))
    poses = f"--separate {rivals} --have {data} {plan_options(advice.plan)} -o next.csv"
    these, there = f"these{provided_words(advice.pairs)}", f"Measure there, append to {names.data}."
    yield NextStep(
        f"Writes poses (--levels any: at any angles) that distinguish {these}. {there}",
        f"lrm-ident design {arm} --model {model} {poses}",
        f"lrm-ident fit {data} --arm {arm} -o new.toml",
        lead,
    )


def _without_effect(report: DiagnosisReport, names: CommandNames) -> Iterator[NextStep]:
    """The next steps after a verdict without an effect to add."""
    model, data, arm = map(shlex.quote, astuple(names))
    if report.verdict == Verdict.NOTHING_MISSING:
        yield NextStep(DEPLOY, f"lrm deploy {model}", VERIFY)
        yield from _poses_that_distinguish(report, names, FOR_THE_CAUSE)
        lost = [plain_name(name) for name, effect in _has_already(report).items() if not constant(effect)]
        without = f" and without {enumerate_words(lost, IN_HEADLINE)}" if lost else ""
        export = f"lrm-ident arm export {model} -o arm.urdf"
        yield NextStep(f"Writes the rigid part, without springs{without}.", export, lead=FOR_OTHERS)
    elif report.verdict == Verdict.UNEXPLAINED_STRUCTURE:
        if report.limitations:
            design = f"lrm-ident design {arm} --model {model} --have {data} --levels any -n {MORE_POSES} -o next.csv"
            yield NextStep(f"Writes poses at any angles, in random order. Measure there, append to {data}.", design)
        yield NextStep(next_step(report), f"lrm-ident propose {model} {data} -o law.py")
    else:
        yield NextStep(next_step(report))
    if report.verdict != Verdict.NOTHING_MISSING:
        lead = "or" if report.verdict == Verdict.UNEXPLAINED_STRUCTURE else STOPGAP
        yield NextStep("Gives the model to lrmd as it is.", f"lrm deploy {model}", lead=lead)
