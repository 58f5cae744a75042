"""Speed and punctuality of the daemon, in real processes on a simulated board: the worst value counts.

`python -m bench.daemon_performance [--minutes 10] [--kills 100] [--only PART]`. Parts `direct` and `cube`: the
daemon with the thesis's model (option 1) answers inverse kinematics by this method while the arm moves.
"""

from __future__ import annotations

import os
import platform
import statistics
import sys
from collections.abc import Callable, Mapping

from bench.daemon_performance import faults, timing
from bench.daemon_performance.measurement import PerformanceFigure
from lrm_math.errors import LrmError
from validation.options import Count, asked
from validation.tables import markdown_table

COLUMNS = ("what", "min", "median", "max", "unit", "at most", "")


def parts(
    minutes: float, kills: int, seconds: float, per_s: float
) -> Mapping[str, Callable[[], list[PerformanceFigure]]]:
    """Parts of the measurement by name."""
    thesis = timing.THESIS_MODEL
    return {
        "starts": lambda: timing.starts(5),
        "idle": lambda: timing.idle(20),
        "estops": lambda: faults.estops(30),
        "hang-ups": lambda: faults.hang_ups(20),
        "leases": lambda: faults.leases(10),
        "child-kills": lambda: faults.child_kills(kills),
        "api-kills": lambda: faults.api_kills(kills),
        "lateness": lambda: timing.beside_queries(60 * minutes),
        "direct": lambda: timing.beside_queries(seconds, "direct", per_s, thesis),
        "cube": lambda: timing.beside_queries(seconds, "cube", per_s, thesis),
    }


def row(figure: PerformanceFigure) -> tuple[str, ...]:
    """One line of the table: a single value stands under max."""
    values = figure.values
    three = (min(values), statistics.median(values), max(values)) if values else ()
    cells = [f"{value:.3g}" if value < 1000 else f"{value:.0f}" for value in three] or ["none"]
    cells = ["", "", cells[-1]] if len(values) < 2 else cells
    return (figure.what, *cells, figure.unit, *_verdict(figure))


def _verdict(figure: PerformanceFigure) -> tuple[str, str]:
    if figure.goal is None:
        return "", ""
    missed = sum(value > figure.goal for value in figure.values)
    return f"{figure.goal:.4g}", f"missed, {missed} of {len(figure.values)}" if missed else "reached"


def main() -> int:
    """Measures and prints; exit code 1 if an invariant was broken or a part failed, not for a missed goal."""
    options = asked(
        __doc__,
        minutes=(10.0, "how long lateness is measured"),
        kills=(Count(100), "of each process"),
        only=("", "one part", ["", *parts(0, 0, 0, 0)]),
        seconds=(60.0, "of queries by each method"),
        per_s=(timing.QUERIES_PER_S, "of these queries"),
    )
    broken = 0
    for name, run in parts(options.minutes, options.kills, options.seconds, options.per_s).items():
        if options.only in ("", name):
            try:
                print(f"{name}\n\n{markdown_table(COLUMNS, map(row, run()))}\n", flush=True)
            except (AssertionError, LrmError) as error:
                broken += 1
                print(f"{name}: {error}\n", flush=True)
    load = f"load {os.getloadavg()[0]:.1f}"
    print(f"Python {platform.python_version()}, {platform.release()}, {os.cpu_count()} processors, {load}")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
