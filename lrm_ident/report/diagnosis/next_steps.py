"""Next steps after a diagnosis, in the order in which they are worth doing."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from lrm_ident.diagnosis.judgement import Verdict
from lrm_ident.report.diagnosis.advice import advice_of, causes_of, effects_of
from lrm_ident.report.diagnosis.assessment import Assessment
from lrm_ident.report.plain_names import place_in_words, plain_name, words_of
from lrm_ident.report.text import next_steps as say
from lrm_ident.report.text.advice import plan_options, provided_words
from lrm_ident.report.text.next_steps import CommandNames, NextStep
from lrm_math.effects import Effect, ModelPart
from lrm_math.model.deployed_model import CORRECTED, on_rover

SHOWN_M = 1e-5
"""m, the last digit of an error in mm that is printed."""


def next_steps(assessment: Assessment, names: CommandNames) -> Iterator[NextStep]:
    """The steps: what is missing, what else must be done by hand, the model on the arm, and what may be done beside.

    `names`: of the files in their commands.
    """
    if assessment.first is not None:
        yield from _of_an_effect(assessment, names)
    elif assessment.quiet:
        yield from _of_a_model(assessment, names)
    elif assessment.report.verdict == Verdict.UNEXPLAINED_STRUCTURE:
        lacking = bool(assessment.report.limitations)
        if lacking:
            options = f"--have {{data}} --levels any -n {say.MORE_POSES}"
            yield say.measure_more(names, "lie at any angles, in random order", options)
        yield say.propose_formula(names, say.WITHOUT_POSES if lacking else "")
        yield _deploy(assessment, names, say.MEANWHILE)
        yield say.no_repair_yet()
    else:
        yield say.diagnose_again(names, say.CHECK_REPEATS)
        yield _deploy(assessment, names, say.MEANWHILE)
        yield say.no_repair_yet()


def _of_an_effect(assessment: Assessment, names: CommandNames) -> Iterator[NextStep]:
    """The steps where an effect is to be added."""
    first, cause = assessment.first, assessment.cause
    assert first is not None
    yield from (distinguishing := tuple(_poses_that_distinguish(assessment, names)))
    words = "Add it to the model, refit all parameters, and diagnose again"
    if cause is None:
        words = "Add it, to correct the error without knowing its cause, and diagnose again"
    elif distinguishing:
        words = "Add it, though its cause is not certain, and diagnose again"
    yield say.add_effect(names, first.name, words, say.WITHOUT_POSES if distinguishing else "")
    if cause is not None and not (cause.equivalent or distinguishing):
        yield say.add_all(names)
    if cause is not None and not assessment.identified and assessment.report.diagnosis.floor.rms is None:
        yield say.diagnose_again(names, say.CHECK_NOISE, say.FOR_THE_CAUSE)
    yield from _more_than_poses(assessment, names)
    if cause is None or not assessment.identified:
        yield say.no_repair_yet()
    else:
        yield from _by_hand(assessment, (cause.name, *cause.equivalent), either=bool(cause.equivalent))


def _of_a_model(assessment: Assessment, names: CommandNames) -> Iterator[NextStep]:
    """The steps where nothing is missing: first what the model does not correct, or all that was measured rests on."""
    certain = [name for name in assessment.causes if name not in assessment.unsure]
    unsure = next(((name, *others) for name, others in assessment.unsure.items() if name in assessment.causes), ())
    repairs = [*_by_hand(assessment, certain, either=False), *_by_hand(assessment, unsure, either=True)]
    yield from (step for step in repairs if not step.lead)
    if assessment.report.verdict == Verdict.NOISE_UNKNOWN:
        yield say.diagnose_again(names, say.CHECK_NOISE)
        yield _deploy(assessment, names, say.MEANWHILE)
    else:
        yield _deploy(assessment, names)
        yield say.verify()
    yield from _poses_that_distinguish(assessment, names, say.FOR_THE_CAUSE)
    yield from _more_than_poses(assessment, names)
    yield from (step for step in repairs if step.lead)
    if assessment.terms and not assessment.causes:
        yield say.no_repair_yet(list(dict.fromkeys(map(place_in_words, assessment.terms))))
    if assessment.report.verdict == Verdict.NOTHING_MISSING:
        yield say.export(replace(names, model=say.BEST) if _is_refitted(assessment) else names)


def _deploy(assessment: Assessment, names: CommandNames, lead: str = "") -> NextStep:
    """How the arm gets the model that was judged."""
    if not _is_refitted(assessment):
        return say.deploy(names, lead)
    return say.deploy_refitted(names, bool(assessment.report.diagnosis.outliers), lead)


def _is_refitted(assessment: Assessment) -> bool:
    """Whether the file's model predicts other positions than the judged one, as far as errors are printed."""
    return assessment.report.moved > SHOWN_M


def _poses_that_distinguish(assessment: Assessment, names: CommandNames, lead: str = "") -> Iterator[NextStep]:
    """How to measure what distinguishes the causes, where some poses do."""
    advice = advice_of(assessment.report)
    if advice is None or advice.plan is None or not advice.helps:
        return
    options = f"--separate {{rivals}} --have {{data}} {plan_options(advice.plan)}"
    what = f"distinguish these{provided_words(advice.pairs)}"
    yield say.measure_more(names, what, options, lead, rivals=",".join(causes_of(assessment)))


def _more_than_poses(assessment: Assessment, names: CommandNames) -> Iterator[NextStep]:
    """What to measure to distinguish causes that follow the order of measuring, which no choice of poses does."""
    if advice_of(assessment.report) is not None:
        return
    first, effects = assessment.first, effects_of(assessment.report)
    alike = next(((name, *others) for name, others in assessment.unsure.items()), ())
    causes = alike if first is None else (first.name, *first.equivalent)
    needs = dict.fromkeys(effects[name].about.needs for name in causes if name in effects)
    if len(causes) > 1 and any(needs):
        yield say.measure_what(names, list(filter(None, needs)))


def _by_hand(assessment: Assessment, names: Sequence[str], either: bool) -> Iterator[NextStep]:
    """What to do by hand about causes; of either of several as about the first, which the model has or gets."""
    effects = effects_of(assessment.report)
    why = {name: "" if name not in effects else _why_by_hand(effects[name]) for name in names}
    for kind in (why[names[0]],) if either and names else (say.OF_MEASURING, say.MAY_CHANGE, ""):
        repairs = {
            plain_name(name): words_of(name, "repair").format(place=place_in_words(name))
            for name in names
            if either or why[name] == kind
        }
        if repairs := {name: words for name, words in repairs.items() if words}:
            yield say.repair(repairs, kind, either and len(names) > 1)


def _why_by_hand(effect: Effect) -> str:
    """Why a cause is to be seen to; empty where the model corrects it."""
    if effect.part is ModelPart.MEASUREMENT:
        return say.OF_MEASURING
    return "" if on_rover(effect) in CORRECTED else say.MAY_CHANGE
