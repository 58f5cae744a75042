"""Made-up questions against the inverse kinematics: `python -m tests.soak.fuzz_ik [QUERIES] [SEED]`.

Messages as a client would send them, many with something wrong, to models with any effects, loads and goals: at the
limits, singular, out of reach. Counts what may never be: an exception that is no refusal, a wrong message that is
taken, a number that is not finite, a command outside the limits, in collision or not where it was said to be.
"""

from __future__ import annotations

import math
import random
import sys
import time
import traceback
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import msgpack

from lrmd.config import load_config
from lrmd.messages.control import MessageError, pack, unpack
from lrmd.messages.kinematics import IkReply, IkRequest
from tests.soak.fuzz_ik_checks import Figures, Said, check
from tests.soak.fuzz_ik_queries import WRONGS, Subject, damaged, some_requests, some_subject
from tests.support.in_memory_daemon import CONFIG

QUERIES = 20_000
BLOCK = 1000
"""Queries to one model; then it is checked what it said, and another one is made up."""
HEADER: dict[str, Any] = {"boot_id": "fuzz", "seq": 0, "t_mono_ns": 0, "t_wall_ns": 0}


@dataclass
class Tally:
    """What came of the queries."""

    verdicts: Counter[str] = field(default_factory=Counter)
    violations: list[str] = field(default_factory=list)
    figures: Figures = field(default_factory=Figures)

    def text(self) -> str:
        """For people."""
        rows = [f"  {count:9d} {name}" for name, count in self.verdicts.most_common()]
        rows.append(
            f"{self.figures.commands} commands checked, the worst polished one {self.figures.worst * 1e3:.1e} mm off"
        )
        rows.append(f"{len(self.violations)} violations")
        return "\n".join([*rows, *(f"  {text[:1000]}" for text in self.violations[:20])])


def ask(subject: Subject, data: bytes, wrong: str, tally: Tally) -> Iterator[Said]:
    """Sends a message; what was answered. Notes what should have been refused, and what should not break."""
    try:
        request = unpack(IkRequest, data)
        answers = subject.service.inverse(request, lambda: None)
        if wrong:
            tally.violations.append(f"taken although {wrong}: {data!r}")
        pack(IkReply(**HEADER, model="", model_sha256="", left_out=[], answers=answers, elapsed_ms=0.0))
    except MessageError as error:
        tally.verdicts["refused"] += 1
        if not str(error).isprintable() or len(str(error)) > 300:
            tally.violations.append(f"not one clear line: {error!r}")
        return
    except Exception as error:
        tally.verdicts["broke"] += 1
        where = traceback.extract_tb(error.__traceback__)[-1]
        tally.violations.append(f"{type(error).__name__} in {where.name}, line {where.lineno}: {error}: {data!r}")
        return
    if len(answers) != len(request.goals):
        tally.violations.append(f"{len(answers)} answers to {len(request.goals)} goals: {data!r}")
    for number, answer in enumerate(answers):
        tally.verdicts[answer.verdict] += 1
        if not finite(answer.model_dump()):
            tally.violations.append(f"not finite: {answer}")
        yield Said(request, number, answer)


def finite(value: Any) -> bool:
    """Whether all numbers in it are."""
    if isinstance(value, dict):
        return all(map(finite, value.values()))
    if isinstance(value, list):
        return all(map(finite, value))
    return not isinstance(value, float) or math.isfinite(value)


def fuzz(queries: int, seed: int) -> Tally:
    """Asks so many questions."""
    rng, config, tally = random.Random(seed), load_config(CONFIG), Tally()
    asked = 0
    while asked < queries:
        subject = some_subject(rng, config)
        said: list[Said] = []
        for content in some_requests(rng, subject.model, min(BLOCK, queries - asked)):
            wrong = ""
            chance = rng.random()
            if chance < 0.3:
                break_it = rng.choice(WRONGS)
                break_it(rng, content)
                wrong = break_it.__name__.strip("_").replace("_", " ")
            data = msgpack.packb(content)
            if chance > 0.8:
                data = damaged(rng, data)
            said += ask(subject, data, wrong, tally)
            asked += 1
        for text in check(subject, said, tally.figures):
            tally.violations.append(text)
        if sys.stderr.isatty():
            print(f"\r{asked} of {queries}, {len(tally.violations)} violations", end="", file=sys.stderr)
    return tally


def main() -> int:
    """Exit code 1 if there was a violation."""
    queries, seed = (int(word) for word in (*sys.argv[1:3], *(str(QUERIES), "0")[len(sys.argv) - 1 :]))
    began = time.perf_counter()
    tally = fuzz(queries, seed)
    spent = time.perf_counter() - began
    print(f"{queries} queries, seed {seed}, in {spent:.0f} s ({queries / spent:.0f} per s, checks included):")
    print(tally.text())
    return 1 if tally.violations else 0


if __name__ == "__main__":
    sys.exit(main())
