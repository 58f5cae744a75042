"""Scorer of the benchmark: `python -m validation.missing_effect.score ANSWERS.json`. It needs Python alone.

ANSWERS.json has a list of names for each data set: {"play": ["backlash@joint3"], "two": [], "nothing": []}. A name is
`effect@place`. An entry of the list may be a list itself: names that the program cannot distinguish; it is right if one
of them is, and counts once.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

DATA = Path(__file__).with_name("data")
EFFECTS = (
    "anchor", "axial_play", "backlash", "base_compliance", "cable_spring", "change_point", "common_gain", "coupling",
    "creep", "depth_scale", "drift", "eccentricity", "gear_ripple", "gravity", "hysteresis", "lateral_compliance",
    "mass", "measurement_frame", "nonlinear_stiffness", "payload", "quantisation", "self_heating", "servo_droop",
    "servo_gain", "session", "settling_error", "slip", "tool_compliance",
)  # fmt: skip
"""Kinds of effects; places are joint1 to joint6, link1 to link6, base, tool, frame, servos, arm and distance."""
PLACES = tuple(f"{part}{n}" for part in ("joint", "link") for n in range(1, 7))
PLACES += ("base", "tool", "frame", "servos", "arm", "distance")
Answer = Sequence[str]


@dataclass(frozen=True)
class Score:
    """Counts of one data set: true effects that were named, that were missed, and names that are not true."""

    right: int
    missed: int
    false: int


def score(answers: Sequence[Answer], truth: Sequence[Answer]) -> Score:
    """The score of one data set: each true effect, and each answer, counts once."""
    left = [set(names) for names in truth]
    false = 0
    for answer in answers:
        hit = next((names for names in left if names & set(answer)), None)
        if hit is None:
            false += 1
        else:
            left.remove(hit)
    return Score(len(truth) - len(left), len(left), false)


def scores(answers: Mapping[str, Sequence[Answer]], truth: Mapping[str, Sequence[Answer]]) -> dict[str, Score]:
    """The score of every data set."""
    return {name: score(answers[name], effects) for name, effects in truth.items()}


def read_truth(folder: Path = DATA) -> dict[str, list[list[str]]]:
    """True effects of every data set; of each the names that count for it."""
    return dict(json.loads((folder / "truth.json").read_text(encoding="utf-8")))


def read_answers(path: Path, known: Mapping[str, object]) -> dict[str, list[list[str]]]:
    """Answers of a file. Raises `ValueError`: in one line, what is wrong with it."""
    try:
        given = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ValueError(f"{path}: cannot be read ({error.strerror})") from None
    except ValueError as error:
        raise ValueError(f"{path}: is no JSON ({error})") from None
    if not isinstance(given, dict) or set(given) != set(known):
        raise ValueError(f"{path}: should have a list of names for each of {', '.join(known)}, and nothing else")
    return {name: [_answer(path, name, one) for one in _list(path, name, given[name])] for name in known}


def _list(path: Path, name: str, value: object) -> list[object]:
    if not isinstance(value, list):
        raise ValueError(f"{path}: {name} should be a list of names")
    return value


def _answer(path: Path, name: str, one: object) -> list[str]:
    names = [one] if isinstance(one, str) else one
    if not isinstance(names, list) or not names:
        raise ValueError(f"{path}: {name}: {one!r} is no name, nor a list of names")
    for each in names:
        effect, _, place = str(each).partition("@")
        if effect not in EFFECTS or place.partition("<-")[0] not in PLACES:
            raise ValueError(f"{path}: {name}: {each!r} should be effect@place, such as backlash@joint3; see --names")
    return [str(each) for each in names]


def main(argv: Sequence[str] | None = None) -> int:
    """Prints the score. Exit code 2 if the answers cannot be read."""
    parser = argparse.ArgumentParser("python -m validation.missing_effect.score", description=__doc__)
    parser.add_argument("answers", type=Path, nargs="?", help="a JSON file of names")
    parser.add_argument("--names", action="store_true", help="print the names that count, and stop")
    options = parser.parse_args(argv)
    if options.names:
        print("effects:", *EFFECTS, "\nplaces:", *PLACES, "\na coupling is coupling@joint3<-joint2")
        return 0
    if options.answers is None:
        parser.error("name a file of answers")
    truth = read_truth()
    try:
        found = scores(read_answers(options.answers, truth), truth)
    except ValueError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(f"{'data set':12} {'right':>6} {'missed':>7} {'false':>6}")
    total = Score(*(sum(getattr(one, part) for one in found.values()) for part in ("right", "missed", "false")))
    for name, one in (*found.items(), ("all", total)):
        print(f"{name:12} {one.right:6} {one.missed:7} {one.false:6}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
