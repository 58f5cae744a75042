"""All attacks in a bounded time, and their table: `python -m tests.soak.hostile [--minutes M] [--only WORD]`."""

from __future__ import annotations

import argparse
import math
import sys

from tests.soak.hostile.attacks import ALL, carry_out
from tests.soak.hostile.trial import HEAD


def main() -> int:
    """Prints one line per attack; 1 if a law was broken."""
    parser = argparse.ArgumentParser("tests.soak.hostile", description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0, help="for all attacks together, without their starts")
    parser.add_argument("--only", default="", metavar="WORD", help="only attacks with this word in their name")
    parser.add_argument(
        "--shaping", default="off", choices=["off", "zv", "zvd", "zvdd", "timed"], help="of the daemon's moves"
    )
    options = parser.parse_args()
    chosen = [name for name in ALL if options.only in name]
    print(HEAD, flush=True)
    broken, worst = 0, 0.0
    for name in chosen:
        try:
            result = carry_out(name, 60 * options.minutes / len(chosen), options.shaping)
        except AssertionError as error:
            broken += 1
            print(f"{name:<28}broken: {error}", flush=True)
        else:
            worst = max(worst, *result.estops_ms, 0.0)
            broken += math.inf in result.estops_ms
            print(result.row(), flush=True)
    print(f"{len(chosen)} attacks, {broken} with a broken law; e-stop at worst {worst:.0f} ms")
    return bool(broken)


if __name__ == "__main__":
    sys.exit(main())
