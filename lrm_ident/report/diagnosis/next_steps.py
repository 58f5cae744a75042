"""Next steps after a diagnosis: what to do, and the commands for it, the best first."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from dataclasses import astuple, dataclass

from lrm_ident.data.wording import enumerate_words
from lrm_ident.diagnosis.judgement import Verdict
from lrm_ident.report.diagnosis.advice import advice_of, causes_of
from lrm_ident.report.diagnosis.assessment import Assessment
from lrm_ident.report.plain_names import plain_name
from lrm_ident.report.text.advice import next_step, plan_options, provided_words
from lrm_math.effects import constant

NAMED = 2
MORE_POSES = 40
"""Poses to measure where those there lack something."""
DEPLOY = "The daemon takes it; nothing moves. verify drives, and needs your tracker."
VERIFY = "lrm-ident verify --tracker dtrack:5000 --goals 50"
AS_IT_IS = "The arm's daemon takes the model; nothing moves."
STOPGAP = "or, without new poses"
"""Lead of the command for whoever does not measure the poses that the first one writes."""
FOR_THE_CAUSE, FOR_OTHERS = "to learn the cause", "for programs that read a URDF"
"""Leads of commands beside that which gives the model to the arm."""


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


def next_steps(assessment: Assessment, names: CommandNames) -> Iterator[NextStep]:
    """The steps. `names`: of the files in their commands."""
    if assessment.first is None:
        yield from _without_effect(assessment, names)
        return
    model, data, _ = map(shlex.quote, astuple(names))
    add = f"lrm-ident add {model} {data} {shlex.quote(assessment.first.name)} -o better.toml"
    lead, words = "or", "Adds it to the model and refits all parameters."
    if distinguishing := [*_poses_that_distinguish(assessment, names)]:
        yield from distinguishing
        lead, words = STOPGAP, "Adds it, though its cause is not certain."
    if assessment.cause is None:
        yield NextStep("Corrects the error without knowing its cause.", add, lead=STOPGAP)
        return
    yield NextStep(words, add, f"lrm-ident diagnose better.toml {data}", lead)
    if not assessment.cause.equivalent:
        auto = f"lrm-ident auto {model} {data} -o best.toml"
        yield NextStep("In one go: adds this and every further effect until none is missing.", auto)


def _poses_that_distinguish(assessment: Assessment, names: CommandNames, lead: str = "or") -> Iterator[NextStep]:
    """How to measure what distinguishes the causes, where some poses do."""
    model, data, arm = map(shlex.quote, astuple(names))
    advice = advice_of(assessment.report)
    if advice is None or advice.plan is None or not advice.helps:
        return
    rivals = shlex.quote(",".join(causes_of(assessment)))
    poses = f"--separate {rivals} --have {data} {plan_options(advice.plan)} -o next.csv"
    these, there = f"these{provided_words(advice.pairs)}", f"Measure there, append to {names.data}."
    yield NextStep(
        f"Writes poses (--levels any: at any angles) that distinguish {these}. {there}",
        f"lrm-ident design {arm} --model {model} {poses}",
        f"lrm-ident fit {data} --arm {arm} -o new.toml",
        lead,
    )


def _without_effect(assessment: Assessment, names: CommandNames) -> Iterator[NextStep]:
    """The next steps after a verdict without an effect to add."""
    model, data, arm = map(shlex.quote, astuple(names))
    report, deploy = assessment.report, f"lrm deploy {model}"
    match report.verdict:
        case Verdict.NOTHING_MISSING:
            yield NextStep(DEPLOY, deploy, VERIFY)
            yield from _poses_that_distinguish(assessment, names, FOR_THE_CAUSE)
            lost = [plain_name(name) for name, effect in assessment.causes.items() if not constant(effect)]
            without = f" and without {enumerate_words(lost, NAMED)}" if lost else ""
            export = f"lrm-ident arm export {model} -o arm.urdf"
            yield NextStep(f"Writes the rigid part, without springs{without}.", export, lead=FOR_OTHERS)
        case Verdict.UNEXPLAINED_STRUCTURE:
            if report.limitations:
                free = f"--levels any -n {MORE_POSES} -o next.csv"
                design = f"lrm-ident design {arm} --model {model} --have {data} {free}"
                yield NextStep(f"Writes poses at any angles, in random order. Measure there, append to {data}.", design)
            yield NextStep(next_step(report), f"lrm-ident propose {model} {data} -o law.py")
            yield NextStep(AS_IT_IS, deploy)
        case _:
            yield NextStep(next_step(report))
            yield NextStep(AS_IT_IS, deploy, lead=STOPGAP)
