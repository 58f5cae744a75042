"""Every registered door at random instants: `python -m tests.soak.doors --instants 500`.

ROS 2's processes take real time, six seconds an instant, and cannot be driven side by side in one run: several runs
with other first seeds can. Prints medians and worst cases of the time from a confirmed stop, and from the loss of
contact, to the last change of a command, and of the turn of a joint when torque comes on. Ends with 1 if a door breaks
a law.
"""

from __future__ import annotations

import math
import statistics
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from tests.doors.door import DoorKind
from tests.doors.laws import nothing_moves_after_a_stop, nothing_moves_after_contact_is_lost, torque_on_moves_nothing
from tests.doors.registry import door_kinds
from validation.options import Count, asked
from validation.runner import NO_CASE, refuse


def main() -> int:
    """Prints the table; 1 if a law was broken."""
    chosen = asked(
        __doc__,
        instants=(Count(500), "of each door"),
        first=(1000, "seed of the first instant"),
        abreast=(0, "at most so many side by side of a door that takes real time; 0: as many as it can"),
        door=("", "one door alone"),
    )
    kinds = [kind for kind in door_kinds() if chosen.door in kind.name]
    if not kinds:
        refuse(NO_CASE)
    broken = 0
    print("| door | still after a stop: median | worst (s) | after lost contact: median | worst (s)", end="")
    print(" | turn at torque on: median | worst (deg) |")
    print("|---|---|---|---|---|---|---|")
    for kind in kinds:
        columns = []
        for law, scale in (
            (nothing_moves_after_a_stop, 1.0),
            (nothing_moves_after_contact_is_lost, 1.0),
            (torque_on_moves_nothing, math.degrees(1.0)),
        ):
            seeds = range(chosen.first, chosen.first + chosen.instants)
            found, failed = _measured(law, kind, seeds, min(kind.abreast, chosen.abreast or kind.abreast))
            broken += failed
            columns += [f"{scale * statistics.median(found):.2f}", f"{scale * max(found):.2f}"] if found else ["-", "-"]
        print(f"| {kind.name} | {' | '.join(columns)} |", flush=True)
        kind.close()
    return int(broken > 0)


def _measured(
    law: Callable[[DoorKind, int], float], kind: DoorKind, seeds: range, abreast: int
) -> tuple[list[float], int]:
    """Figures of the instants that kept a law, and how many did not."""

    def one(seed: int) -> float | None:
        try:
            return law(kind, seed)
        except AssertionError as error:
            print(f"{kind.name}, seed {seed}: {error}", file=sys.stderr)
            return None

    if abreast == 1:  # some doors are bound to the thread that opened them
        results = [one(seed) for seed in seeds]
    else:
        with ThreadPoolExecutor(abreast) as pool:
            results = list(pool.map(one, seeds))
    found = [result for result in results if result is not None]
    return found, len(seeds) - len(found)


if __name__ == "__main__":
    sys.exit(main())
