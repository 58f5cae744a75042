"""All attacks in a bounded time, and their table: `python -m tests.soak.hostile [--minutes M] [--only WORD]`."""

from __future__ import annotations

import math
import sys

from tests.soak.hostile.attacks import ALL, carry_out
from tests.soak.hostile.trial import HEAD
from validation.options import asked
from validation.runner import NO_CASE, refuse


def main() -> int:
    """Prints one line per attack; 1 if a law was broken."""
    options = asked(
        __doc__,
        minutes=(10.0, "for all attacks together, without their starts"),
        only=("", "only attacks with this word in their name"),
        shaping=("off", "of the daemon's moves", ["off", "zv", "zvd", "zvdd", "timed"]),
    )
    chosen = [name for name in ALL if options.only in name]
    if not chosen:
        refuse(NO_CASE)
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
