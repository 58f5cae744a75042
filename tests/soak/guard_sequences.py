"""Random sequences of requests to the controller of random arms: does the collision guard keep its law in every tick?

Contacts that requests permit, obstacles that come and go, loads and another client are among them. The distances are
those of `independent_distances`.

python -m tests.soak.guard_sequences --sequences 10000
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass

import numpy as np

from tests.support.daemon.guarded_sequence import GuardedSequence, SequenceResult
from validation.options import Count, asked


class SequenceWithCentres(GuardedSequence):
    """Its loads have their centres anywhere; all else is as in the sequence of the same seed."""

    def __init__(self, seed: int) -> None:
        super().__init__(seed, FASTER)
        self.centres = np.random.default_rng([seed, 1])

    def load_at(self) -> list[float]:
        """Anywhere within what a message may say (m)."""
        return [float(x) for x in self.centres.uniform(-0.2, 0.2, 3)]


FASTER = 5
"""So that more happens in a tick."""


def main() -> int:
    """Runs the sequences; 1 if one of them broke the law."""
    options = asked(
        __doc__,
        sequences=Count(10_000),
        first=(1000, "seed of the first one"),
        requests=(Count(4), "kinds of behaviour in a row, of each sequence"),
        tell=(Count(500), "sequences between two lines of the output"),
    )
    started, total, broken = time.process_time(), Totals(), 0
    for seed in range(options.first, options.first + options.sequences):
        result = SequenceWithCentres(seed).run(options.requests, contacts=True)
        total = total.with_result(result)
        if not result.kept:
            print(f"seed {seed}: {result}", flush=True)
            broken += 1
        if total.sequences % options.tell == 0 or total.sequences == options.sequences:
            print(f"{total}, {time.process_time() - started:.0f} s: {broken} broke the law", flush=True)
    return 1 if broken else 0


@dataclass(frozen=True)
class Totals:
    """Counts over sequences, and the least separation (m) against what is required."""

    sequences: int = 0
    accepted: int = 0
    refused: int = 0
    touched: int = 0
    worst: float = 0.0

    def with_result(self, result: SequenceResult) -> Totals:
        """With another sequence."""
        return Totals(
            self.sequences + 1, self.accepted + result.accepted, self.refused + result.refused,
            self.touched + result.touched, min(self.worst, result.least - result.required),
        )  # fmt: skip

    def __str__(self) -> str:
        return (
            f"{self.sequences} sequences, {self.accepted} requests carried out, {self.refused} refused, {self.touched} "
            f"pairs nearer as permitted, least separation below what is required: {-self.worst * 1e6:.2f} um"
        )


if __name__ == "__main__":
    sys.exit(main())
