"""Memory of the daemon after all floods at once: `python -m tests.soak.hostile.steady_memory [MINUTES]`.

Prints for each process the resident memory (MB) before, at most, and after a pause; the law is that it returns to
within 5 % of what it was. Before: after the first three minutes of the same, when every part of the code has been
loaded.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

from tests.soak.hostile.client_memory import resident
from tests.soak.hostile.flood import KINDS, flooded
from tests.soak.hostile.process_memory import BROKEN, ROLES, PeakMemory
from tests.soak.hostile.trial import Trial, trial
from tests.support.daemon.daemon_process import COOL, children, role

WARM_UP_S, PAUSE_S, ALLOWED = 180.0, 20.0, 1.05


def memory(t: Trial) -> dict[str, float]:
    """Resident memory (MB) of each process by role."""
    return {"api": resident(t.daemon.pid)} | {role(pid): resident(pid) for pid in children(t.daemon.pid) if role(pid)}


def together(t: Trial, seconds: float) -> dict[str, float]:
    """All kinds of floods at once; the memory (MB) after a pause."""
    with flooded(t.setup.endpoint, tuple(KINDS), seconds + 120.0):
        time.sleep(seconds)
    time.sleep(PAUSE_S)
    t.wait_until_it_moves()
    return memory(t)


def main(minutes: float = 10.0) -> int:
    """Prints the table; 1 if a process did not return to its memory, or was kept from its work."""
    with tempfile.TemporaryDirectory() as folder, trial(Path(folder), COOL) as t:
        fresh = memory(t)
        before = together(t, WARM_UP_S)
        peak = PeakMemory(t.daemon.pid)
        with peak.sampled():
            after = together(t, 60.0 * minutes)
        broken = sorted(set(t.daemon.codes()) & set(BROKEN))
    print(f"{'MB':<8}" + "".join(f"{name:>10}" for name in ("fresh", "before", "most", "after", "ratio")))
    for name in ROLES[:-1]:
        figures = fresh[name], before[name], peak.peak[name], after[name]
        print(f"{name:<8}" + "".join(f"{figure:>10.1f}" for figure in figures) + f"{after[name] / before[name]:>10.3f}")
    print(f"kept from their work: {', '.join(broken) or 'none'}")
    return bool(broken) or any(after[name] > ALLOWED * before[name] for name in ROLES[:-1])


if __name__ == "__main__":
    sys.exit(main(*map(float, sys.argv[1:])))
