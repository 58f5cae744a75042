"""Speed and punctuality of the daemon, in real processes on a simulated board.

`python -m validation.daemon_performance [--minutes 10] [--kills 100] [--only PART]`: the worst value counts.
"""

from __future__ import annotations

import argparse
import os
import platform
import statistics
import sys
from collections.abc import Callable, Mapping, Sequence

from rich.console import Console
from rich.table import Table

from lrm_math.errors import LrmError
from validation.daemon_performance import faults, timing
from validation.daemon_performance.measurement import PerformanceFigure


def parts(minutes: float, kills: int) -> Mapping[str, Callable[[], list[PerformanceFigure]]]:
    """Parts of the measurement by name."""
    return {
        "starts": lambda: timing.starts(5),
        "idle": lambda: timing.idle(20),
        "estops": lambda: faults.estops(30),
        "hang-ups": lambda: faults.hang_ups(20),
        "leases": lambda: faults.leases(10),
        "child-kills": lambda: faults.child_kills(kills),
        "api-kills": lambda: faults.api_kills(kills),
        "lateness": lambda: timing.lateness(minutes),
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
    said = f"[red]missed[/red], {missed} of {len(figure.values)}" if missed else "reached"
    return f"{figure.goal:.4g}", said


def table_of(figures: Sequence[PerformanceFigure]) -> Table:
    """One part's figures, in columns that are the same for every part."""
    table = Table()
    for name, width in (("what", 51), ("min", 6), ("median", 6), ("max", 6), ("", 2), ("at most", 7), ("", 17)):
        table.add_column(name, width=width, justify="right" if width in (6, 7) else "left")
    for figure in figures:
        table.add_row(*row(figure))
    return table


def main() -> int:
    """Measures and prints; exit code 1 if an invariant was broken or a part failed, not for a missed goal."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    p.add_argument("--minutes", type=float, default=10.0, help="how long lateness is measured (default: %(default)g)")
    p.add_argument("--kills", type=int, default=100, help="of each process (default: %(default)s)")
    p.add_argument("--only", choices=list(parts(0, 0)), metavar="PART", help=", ".join(parts(0, 0)))
    options = p.parse_args()
    chosen = {
        n: run for n, run in parts(options.minutes, options.kills).items() if options.only in (None, n)
    }  # fmt: skip
    console, broken = Console(width=120), 0
    console.print("The daemon in real processes on a simulated board")
    for name, run in chosen.items():
        with console.status(name):
            try:
                figures = run()
            except (AssertionError, LrmError) as error:
                broken += 1
                console.print(f"[red]{name}: {error}[/red]")
                continue
        console.print(table_of(figures))
    console.print(f"Python {platform.python_version()}, {platform.release()}, {os.cpu_count()} processors, ", end="")
    console.print(f"load {os.getloadavg()[0]:.1f}")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
