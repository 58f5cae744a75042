"""Next steps in words: an imperative for each, and the commands for it to copy."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from lrm_ident.data.wording import enumerate_words

NAMED = 2
MORE_POSES = 40
"""Poses to measure where those there lack something."""
OR, MEANWHILE, WITHOUT_POSES = "or", "meanwhile", "or, without new poses"
FOR_THE_CAUSE, FOR_OTHERS, BY_HAND = "to learn the cause", "for a URDF", "to repair"
"""Leads of what may be done beside a step, or in its place."""
CHECK_NOISE = (
    "Measure five poses twice or more (column repeat_of) and append the rows, or state the noise of the instrument "
    "(noise_sd_mm). Then diagnose again"
)
CHECK_REPEATS = (
    "Measure some of these poses again in another order, append the rows, and diagnose again. An error that repeats "
    "belongs to the arm; one that does not is a loose part, creep, a load that the file does not state (payload_g), or "
    "noise larger than stated"
)
FIT_ANEW = "lrm-ident fit {data} --arm {arm} -o new.toml", "lrm-ident diagnose new.toml {data}"
BEST = "best.toml"
AUTO = f"lrm-ident auto {{model}} {{data}} -o {BEST}"
OF_MEASURING = "every measured position rests on it"
MAY_CHANGE = "the model does not correct it, and it may change again"
CORRECTED = "or repair, though the model corrects it"


@dataclass(frozen=True)
class CommandNames:
    """Names of the files that commands to copy stand for; in capitals where they are not known."""

    model: str = "MODEL"
    data: str = "DATA"
    arm: str = "ARM"

    def command(self, words: str, **more: str) -> str:
        """A command in which `{model}`, `{data}`, `{arm}` and `more` stand for what a shell reads as one word."""
        names = {"model": self.model, "data": self.data, "arm": self.arm, **more}
        return words.format(**{name: shlex.quote(value) for name, value in names.items()})


UNKNOWN_FILES = CommandNames()


@dataclass(frozen=True)
class NextStep:
    """Something to do: an imperative, and the commands for it, in their order.

    `lead`: empty for what is done after the steps before it; else how it stands beside them, for instance `or`.
    """

    words: str
    commands: tuple[str, ...] = ()
    lead: str = ""

    @property
    def sentence(self) -> str:
        """The words as they stand before the commands, or alone."""
        words = f"{self.words[0].lower()}{self.words[1:]}" if self.lead else self.words
        return f"{words}{':' if self.commands else '.'}"


def labelled(steps: Iterable[NextStep]) -> Iterator[tuple[str, NextStep]]:
    """Steps with their number, or with their lead."""
    number = 0
    for step in steps:
        number += not step.lead
        yield f"{step.lead}:" if step.lead else f"{number}.", step


def add_effect(names: CommandNames, effect: str, words: str, lead: str) -> NextStep:
    """How to add an effect and to see what is left then."""
    add = names.command("lrm-ident add {model} {data} {effect} -o better.toml", effect=effect)
    return NextStep(words, (add, names.command("lrm-ident diagnose better.toml {data}")), lead)


def add_all(names: CommandNames) -> NextStep:
    """How to add every effect that is missing."""
    return NextStep("Add all that is missing", (names.command(AUTO),), OR)


def measure_more(names: CommandNames, what: str, options: str, lead: str = "", **more: str) -> NextStep:
    """How to measure more poses and to fit again. `what` they are for; `options` of `design`, with `more` in them."""
    design = "lrm-ident design {arm} --model {model} " + options + " -o next.csv"
    words = f"Measure poses that {what} (next.csv), append the rows to {names.data}, fit and diagnose again"
    return NextStep(words, tuple(names.command(command, **more) for command in (design, *FIT_ANEW)), lead)


def measure_what(names: CommandNames, needs: Sequence[str]) -> NextStep:
    """What to measure where no choice of poses distinguishes the causes. `needs`: what shows each of them."""
    words = f"Measure what distinguishes these ({'; '.join(needs)}), append the rows, fit and diagnose again"
    return NextStep(words, tuple(map(names.command, FIT_ANEW)), FOR_THE_CAUSE)


def diagnose_again(names: CommandNames, words: str, lead: str = "") -> NextStep:
    """What to measure before the same diagnosis is made once more."""
    return NextStep(words, (names.command("lrm-ident diagnose {model} {data}"),), lead)


def propose_formula(names: CommandNames, lead: str) -> NextStep:
    """How to search for a law that no known effect has."""
    words = "Search for a formula, or write one if you know the cause (docs/effects.md)"
    return NextStep(words, (names.command("lrm-ident propose {model} {data} -o law.py"),), lead)


def deploy(names: CommandNames, lead: str = "") -> NextStep:
    """How the arm gets the model."""
    words = "Give the arm this model" if lead else "Give the arm's daemon the model"
    return NextStep(f"{words} (nothing moves)", (names.command("lrm deploy {model}"),), lead)


def deploy_refitted(names: CommandNames, without_poses: bool, lead: str = "") -> NextStep:
    """How the arm gets the model that was judged, where the file has another one. `without_poses`: those left out."""
    how = "without the poses left out" if without_poses else "to these measurements"
    words = f"Fit again {how}, and give the arm's daemon that model (nothing moves)"
    return NextStep(words, (names.command(AUTO), names.command("lrm deploy {model}", model=BEST)), lead)


def verify() -> NextStep:
    """How the deployed model is checked."""
    words = "Check it: the arm moves to 50 goals; name your tracker (here: DTrack)"
    return NextStep(words, ("lrm-ident verify --tracker dtrack:5000 --goals 50",))


def export(names: CommandNames) -> NextStep:
    """How other programs get the rigid part of the model; the command prints what it lacks."""
    return NextStep("Write the rigid part", (names.command("lrm-ident arm export {model} -o arm.urdf"),), FOR_OTHERS)


def repair(repairs: Mapping[str, str], why: str, either: bool) -> NextStep:
    """What to do by hand about causes (their plain names, and the repair of each).

    Args:
        why: why it must be done; empty where the model corrects them, so that it need not.
        either: whether only one of them is there, and it is not known which.
    """
    since, because = (f", since {why}", f": {why}") if why else ("", "")
    if either:
        each = ", or ".join(f"{name} ({words})" for name, words in repairs.items())
        words = f"Find out which it is{since}: {each}; then measure and fit again"
    else:
        what = "; ".join(dict.fromkeys(repairs.values()))
        words = f"{what[0].upper()}{what[1:]}, then measure and fit again{because}"
    return NextStep(words, lead="" if why else CORRECTED)


def no_repair_yet(places: Sequence[str] = ()) -> NextStep:
    """That nothing is to be repaired while the cause is not certain. `places` (in words) of what explains the error."""
    where = f"; look first at {enumerate_words(list(places), NAMED)}" if places else ""
    return NextStep(f"Nothing yet, since the cause is not certain{where}", lead=BY_HAND)
