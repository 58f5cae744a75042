"""Every registered door at random instants: `python -m tests.soak.doors --instants 500`.

Prints medians and worst cases of the time from a confirmed stop, and from the loss of contact, to the last change of a
command, and of the turn of a joint when torque comes on. Ends with 1 if a door breaks a law.
"""

from __future__ import annotations

import argparse
import math
import statistics
import sys
from collections.abc import Callable

from tests.doors.door import DoorKind
from tests.doors.laws import (
    nothing_moves_after_a_stop,
    nothing_moves_after_contact_is_lost,
    torque_on_moves_nothing,
)
from tests.doors.registry import door_kinds


def main() -> int:
    """Prints the table; 1 if a law was broken."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--instants", type=int, default=500, help="of each door")
    parser.add_argument("--door", default="", help="one door alone")
    chosen = parser.parse_args()
    broken = 0
    print("| door | still after a stop: median | worst (s) | after lost contact: median | worst (s)", end="")
    print(" | turn at torque on: median | worst (deg) |")
    print("|---|---|---|---|---|---|---|")
    for kind in (kind for kind in door_kinds() if chosen.door in kind.name):
        columns = []
        for law, scale in (
            (nothing_moves_after_a_stop, 1.0),
            (nothing_moves_after_contact_is_lost, 1.0),
            (torque_on_moves_nothing, math.degrees(1.0)),
        ):
            found, failed = _measured(law, kind, chosen.instants)
            broken += failed
            columns += [f"{scale * statistics.median(found):.2f}", f"{scale * max(found):.2f}"] if found else ["-", "-"]
        print(f"| {kind.name} | {' | '.join(columns)} |", flush=True)
    return int(broken > 0)


def _measured(law: Callable[[DoorKind, int], float], kind: DoorKind, instants: int) -> tuple[list[float], int]:
    found, failed = list[float](), 0
    for seed in range(1000, 1000 + instants):
        try:
            found.append(law(kind, seed))
        except AssertionError as error:
            failed += 1
            print(f"{kind.name}, seed {seed}: {error}", file=sys.stderr)
    return found, failed


if __name__ == "__main__":
    sys.exit(main())
