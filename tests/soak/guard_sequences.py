"""Random sequences of requests to the controller of random arms: does the collision guard keep its law in every tick?

python -m tests.soak.guard_sequences --sequences 10000
"""

from __future__ import annotations

import argparse
import sys
import time

from tests.support.daemon.guarded_sequence import GuardedSequence


def main() -> int:
    """Runs the sequences; 1 if one of them broke the law."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sequences", type=int, default=10_000)
    parser.add_argument("--first", type=int, default=1000, help="seed of the first one")
    options = parser.parse_args()
    started, broken, accepted, refused, worst = time.process_time(), [], 0, 0, 0.0
    for seed in range(options.first, options.first + options.sequences):
        result = GuardedSequence(seed).run(contacts=bool(seed % 2))
        accepted, refused = accepted + result.accepted, refused + result.refused
        worst = min(worst, result.least - result.required)
        if not result.kept:
            broken.append(seed)
            print(f"seed {seed}: {result}", flush=True)
    seconds = time.process_time() - started
    print(
        f"{options.sequences} sequences, {accepted} requests carried out, {refused} refused, {seconds:.0f} s: "
        f"{len(broken)} broke the law; least separation below what is required: {-worst * 1e6:.2f} um"
    )
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
