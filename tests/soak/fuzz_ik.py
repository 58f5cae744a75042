"""Random queries against the inverse kinematics: `python -m tests.soak.fuzz_ik [QUERIES] [SEED]`.

Messages as a client would send them, many with something wrong, to models with any effects, loads and goals: at the
limits, singular, out of reach. Violations are an exception other than `MessageError`, an invalid message that is
accepted, a number that is not finite, a command outside the limits, in collision or not where the answer has it.
"""

from __future__ import annotations

import math
import random
import sys
import time
import traceback
from collections.abc import Iterator
from typing import Any

import msgpack

from lrmd.config import load_config
from lrmd.messages.codec import MessageError, pack, unpack
from lrmd.messages.kinematics import IkReply, IkRequest
from tests.soak.fuzz_ik_checks import AnsweredGoal, CommandErrors, check
from tests.soak.fuzz_ik_queries import CORRUPTIONS, ServiceUnderTest, damaged, random_requests, random_service
from tests.soak.fuzz_result import FuzzResult
from tests.support.daemon.in_memory_daemon import CONFIG

QUERIES = 20_000
BLOCK = 1000
"""Queries to one model; then its answers are checked, and another one is drawn."""
HEADER: dict[str, Any] = {"boot_id": "fuzz", "seq": 0, "t_mono_ns": 0, "t_wall_ns": 0}


def summary(result: FuzzResult, errors: CommandErrors) -> str:
    """Counts by verdict, the worst command and the first violations."""
    rows = [f"  {count:9d} {name}" for name, count in result.counts.most_common()]
    rows.append(f"{errors.commands} commands checked, the worst polished one {errors.worst * 1e3:.1e} mm off")
    rows.append(f"{len(result.violations)} violations")
    return "\n".join([*rows, *(f"  {text[:1000]}" for text in result.violations[:20])])


def ask(subject: ServiceUnderTest, data: bytes, corruption: str, result: FuzzResult) -> Iterator[AnsweredGoal]:
    """The answers to one message. `corruption`: why it is invalid and must be refused, or empty."""
    try:
        request = unpack(IkRequest, data)
        answers = list(subject.service.inverse(request))
        if corruption:
            result.violations.append(f"taken although {corruption}: {data!r}")
        pack(IkReply(**HEADER, model="", model_sha256="", left_out=[], answers=answers, elapsed_ms=0.0))
    except MessageError as error:
        result.counts["refused"] += 1
        if not str(error).isprintable() or len(str(error)) > 300:
            result.violations.append(f"not one clear line: {error!r}")
        return
    except Exception as error:
        result.counts["broke"] += 1
        where = traceback.extract_tb(error.__traceback__)[-1]
        result.violations.append(f"{type(error).__name__} in {where.name}, line {where.lineno}: {error}: {data!r}")
        return
    if len(answers) != len(request.goals):
        result.violations.append(f"{len(answers)} answers to {len(request.goals)} goals: {data!r}")
    for number, answer in enumerate(answers):
        result.counts[answer.verdict] += 1
        if not finite(answer.model_dump()):
            result.violations.append(f"not finite: {answer}")
        yield AnsweredGoal(request, number, answer)


def finite(value: Any) -> bool:
    """Whether all numbers in it are."""
    if isinstance(value, dict):
        return all(map(finite, value.values()))
    if isinstance(value, list):
        return all(map(finite, value))
    return not isinstance(value, float) or math.isfinite(value)


def fuzz(queries: int, seed: int) -> tuple[FuzzResult, CommandErrors]:
    """Sends so many queries."""
    rng, config, result, errors = random.Random(seed), load_config(CONFIG), FuzzResult(), CommandErrors()
    sent = 0
    while sent < queries:
        subject = random_service(rng, config)
        answered: list[AnsweredGoal] = []
        for content in random_requests(rng, subject.model, min(BLOCK, queries - sent)):
            corruption = ""
            chance = rng.random()
            if chance < 0.3:
                corrupt = rng.choice(CORRUPTIONS)
                corrupt(rng, content)
                corruption = corrupt.__name__.strip("_").replace("_", " ")
            data = msgpack.packb(content)
            if chance > 0.8:
                data = damaged(rng, data)
            answered += ask(subject, data, corruption, result)
            sent += 1
        for text in check(subject, answered, errors):
            result.violations.append(text)
        if sys.stderr.isatty():
            print(f"\r{sent} of {queries}, {len(result.violations)} violations", end="", file=sys.stderr)
    return result, errors


def main(queries: int = QUERIES, seed: int = 0) -> int:
    """Prints the counts; 1 if there was a violation."""
    began = time.perf_counter()
    result, errors = fuzz(queries, seed)
    spent = time.perf_counter() - began
    print(f"{queries} queries, seed {seed}, in {spent:.0f} s ({queries / spent:.0f} per s, checks included):")
    print(summary(result, errors))
    return bool(result.violations)


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
